// Modbus TCP against a server that misbehaves.
#include <condition_variable>
#include <optional>

#include "hal/modbus_servers.h"

namespace gantry {
namespace {

TEST(ModbusWire, AMoveIsTheFrameOfTheManual) {
  Bytes last;
  std::mutex mutex;
  RawServer server([&](const Bytes& request, int, int socket) {
    {
      std::lock_guard lock(mutex);
      last = request;
    }
    RawServer::say(socket, proper(request));
    return true;
  });
  SteadyClock clock;
  const auto drive = iai_at(server.port(), clock, 1);
  // The example of IAI's manual: to 50 mm, band 0.1 mm, 100 mm/s, 0.3 G.
  const auto moved = drive->start_move({50, 100, 0.3 * 9806.65});
  ASSERT_TRUE(moved) << moved.error().text();
  const Bytes expected{0x01, 0x10, 0x99, 0x00, 0x00, 0x09, 0x12, 0x00, 0x00, 0x13, 0x88, 0x00, 0x00,
                       0x00, 0x0A, 0x00, 0x00, 0x27, 0x10, 0x00, 0x1E, 0x00, 0x00, 0x00, 0x00};
  std::lock_guard lock(mutex);
  EXPECT_EQ(Bytes(last.begin() + 6, last.end()), expected);
}

TEST(ModbusWire, NobodyListeningIsToldAtOnceAndClearly) {
  int free_port = 0;
  {
    RawServer server([](const Bytes&, int, int) { return false; });
    free_port = server.port();
  }
  SteadyClock clock;
  const auto drive = iai_at(free_port, clock);
  EXPECT_LT(seconds_of([&] {
              const auto connected = drive->connect();
              ASSERT_FALSE(connected);
              EXPECT_EQ(connected.error().kind, FaultKind::kUnreachable);
              EXPECT_EQ(
                  connected.error().text(),
                  "axis linear (IAI ROBO Cylinder at 127.0.0.1:" + std::to_string(free_port) +
                      " unit 2): no connection: Connection refused; is the device powered and the address in "
                      "CELL.yaml right? [unreachable]");
            }),
            kSlack_s);
}

// A listener whose queue is full drops further requests to connect: the same silence as that of a machine
// that is switched off.
TEST(ModbusWire, ASilentAddressFailsWithinTheTimeLimit) {
  const int listener = socket(AF_INET, SOCK_STREAM, 0);
  sockaddr_in address{};
  address.sin_family = AF_INET;
  address.sin_addr.s_addr = htonl(INADDR_LOOPBACK);
  socklen_t size = sizeof address;
  ASSERT_EQ(bind(listener, reinterpret_cast<sockaddr*>(&address), size), 0);
  ASSERT_EQ(listen(listener, 0), 0);
  getsockname(listener, reinterpret_cast<sockaddr*>(&address), &size);
  const int filler = socket(AF_INET, SOCK_STREAM, 0);
  ASSERT_EQ(connect(filler, reinterpret_cast<sockaddr*>(&address), size), 0);

  SteadyClock clock;
  const auto drive = iai_at(ntohs(address.sin_port), clock);
  const double duration_s = seconds_of([&] {
    const auto connected = drive->connect();
    ASSERT_FALSE(connected);
    EXPECT_EQ(connected.error().kind, FaultKind::kUnreachable);
    EXPECT_NE(connected.error().message.find("timed out"), std::string::npos) << connected.error().text();
  });
  EXPECT_GT(duration_s, 0.9);
  EXPECT_LT(duration_s, 1.0 + kSlack_s);
  close(filler);
  close(listener);
}

struct BadAnswer {
  const char* name;
  std::function<void(const Bytes& request, int socket)> say;
  FaultKind kind;
  const char* text;   ///< Part of the message.
  double duration_s;  ///< How long it may take, apart from kSlack_s.
};

Bytes changed(Bytes answer, size_t index, int difference) {
  answer[index] = static_cast<uint8_t>(answer[index] + difference);
  return answer;
}

class ModbusBadAnswer : public testing::TestWithParam<BadAnswer> {};

TEST_P(ModbusBadAnswer, IsAFaultAndTheNextReadIsRightAgain) {
  RawServer server([](const Bytes& request, int connection, int socket) {
    if (connection == 1) {
      GetParam().say(request, socket);
    } else {
      RawServer::say(socket, proper(request, 77));
    }
    return true;
  });
  SteadyClock clock;
  const auto drive = iai_at(server.port(), clock);
  const double duration_s = seconds_of([&] {
    const auto status = drive->read_status();
    ASSERT_FALSE(status);
    EXPECT_EQ(status.error().kind, GetParam().kind) << status.error().text();
    EXPECT_NE(status.error().message.find(GetParam().text), std::string::npos) << status.error().text();
    EXPECT_EQ(status.error().device, drive->info().text());
  });
  EXPECT_LT(duration_s, GetParam().duration_s + kSlack_s);
  const auto again = drive->read_status();
  ASSERT_TRUE(again) << again.error().text();
  EXPECT_EQ(again->position, 0.77);
  EXPECT_EQ(server.connections(), 2);
}

INSTANTIATE_TEST_SUITE_P(
    All, ModbusBadAnswer,
    testing::Values(
        BadAnswer{"None", [](const Bytes&, int) {}, FaultKind::kTimeout, "no complete answer", kTimeout_s},
        BadAnswer{"Truncated",
                  [](const Bytes& request, int socket) {
                    Bytes answer = proper(request);
                    answer.resize(15);
                    RawServer::say(socket, answer);
                  },
                  FaultKind::kTimeout, "no complete answer", kTimeout_s},
        // Every byte comes in time, all of them together do not: 29 times 50 ms.
        BadAnswer{"Dripping",
                  [](const Bytes& request, int socket) {
                    for (const uint8_t byte : proper(request)) {
                      RawServer::say(socket, {byte});
                      std::this_thread::sleep_for(std::chrono::milliseconds(50));
                    }
                  },
                  FaultKind::kTimeout, "no complete answer", kTimeout_s},
        BadAnswer{
            "OfAnotherTransaction",
            [](const Bytes& request, int socket) { RawServer::say(socket, changed(proper(request), 1, 1)); },
            FaultKind::kProtocol, "transaction number", 0},
        BadAnswer{
            "OfAnotherProtocol",
            [](const Bytes& request, int socket) { RawServer::say(socket, changed(proper(request), 3, 1)); },
            FaultKind::kProtocol, "protocol number", 0},
        BadAnswer{
            "WithAWrongLength",
            [](const Bytes& request, int socket) { RawServer::say(socket, changed(proper(request), 5, 2)); },
            FaultKind::kProtocol, "length field", 0},
        BadAnswer{
            "OfAnotherUnit",
            [](const Bytes& request, int socket) { RawServer::say(socket, changed(proper(request), 6, 1)); },
            FaultKind::kProtocol, "its unit is 3, expected 2", 0},
        BadAnswer{
            "OfAnotherFunction",
            [](const Bytes& request, int socket) { RawServer::say(socket, changed(proper(request), 7, 1)); },
            FaultKind::kProtocol, "function code", 0},
        BadAnswer{"WithTooFewRegisters",
                  [](const Bytes& request, int socket) {
                    Bytes pdu{0x03, 18};
                    pdu.resize(20);
                    RawServer::say(socket, frame(request, pdu));
                  },
                  FaultKind::kProtocol, "its size is 20, expected 22", 0},
        BadAnswer{"ClosedInstead", [](const Bytes&, int socket) { shutdown(socket, SHUT_RDWR); },
                  FaultKind::kUnreachable, "was closed", 0},
        BadAnswer{"ClosedInTheMiddle",
                  [](const Bytes& request, int socket) {
                    Bytes answer = proper(request);
                    answer.resize(10);
                    RawServer::say(socket, answer);
                    shutdown(socket, SHUT_RDWR);
                  },
                  FaultKind::kUnreachable, "was closed", 0}),
    [](const auto& p) { return p.param.name; });

TEST(ModbusWire, ALateAnswerIsNeverTakenForTheNextOne) {
  std::mutex mutex;
  std::condition_variable changed_state;
  bool gave_up = false, late_sent = false;
  RawServer server([&](const Bytes& request, int connection, int socket) {
    std::unique_lock lock(mutex);
    if (connection == 1) {
      changed_state.wait_for(lock, std::chrono::seconds(10), [&] { return gave_up; });
      RawServer::say(socket, proper(request, 11));
      late_sent = true;
      changed_state.notify_all();
    } else {
      changed_state.wait_for(lock, std::chrono::seconds(10), [&] { return late_sent; });
      RawServer::say(socket, proper(request, 22));
    }
    return true;
  });
  SteadyClock clock;
  const auto drive = iai_at(server.port(), clock);
  const auto lost = drive->read_status();
  ASSERT_FALSE(lost);
  EXPECT_EQ(lost.error().kind, FaultKind::kTimeout);
  {
    std::lock_guard lock(mutex);
    gave_up = true;
  }
  changed_state.notify_all();
  for (int i = 0; i < 3; ++i) {
    const auto status = drive->read_status();
    ASSERT_TRUE(status) << status.error().text();
    EXPECT_EQ(status->position, 0.22);
  }
}

TEST(ModbusWire, AnAnswerThatNobodyAskedForIsNeverTakenForTheNextOne) {
  RawServer server([](const Bytes& request, int connection, int socket) {
    const Bytes answer = proper(request, static_cast<uint8_t>(connection));
    Bytes next = changed(answer, 1, 1);  // What the next request on this connection would expect, but stale.
    if (connection == 1) {
      Bytes both = answer;
      both.insert(both.end(), next.begin(), next.end());
      RawServer::say(socket, both);
    } else {
      RawServer::say(socket, answer);
    }
    return true;
  });
  SteadyClock clock;
  const auto drive = iai_at(server.port(), clock);
  ASSERT_TRUE(drive->read_status());
  const auto status = drive->read_status();
  ASSERT_TRUE(status) << status.error().text();
  EXPECT_EQ(status->position, 0.02);
}

TEST(ModbusWire, AnExceptionNamesRegisterAndReasonAndKeepsTheConnection) {
  std::atomic<uint8_t> code{2};
  RawServer server([&](const Bytes& request, int, int socket) {
    RawServer::say(socket,
                   code ? frame(request, {static_cast<uint8_t>(request[7] | 0x80), code}) : proper(request));
    return true;
  });
  SteadyClock clock;
  const auto drive = iai_at(server.port(), clock);
  auto refused = drive->connect();
  ASSERT_FALSE(refused);
  EXPECT_EQ(refused.error().kind, FaultKind::kRefused);
  EXPECT_EQ(refused.error().message,
            "the device refused the read of register 9000h (exception 2, illegal data address)");
  code = 3;
  refused = drive->halt();
  ASSERT_FALSE(refused);
  EXPECT_EQ(refused.error().message,
            "the device refused the write to coil 042Ch (exception 3, illegal data value)");
  code = 0x0B;
  refused = drive->connect();
  ASSERT_FALSE(refused);
  EXPECT_EQ(refused.error().kind, FaultKind::kUnreachable);
  EXPECT_NE(refused.error().message.find("no unit 2 (exception 11, gateway target does not respond)"),
            std::string::npos)
      << refused.error().text();
  code = 0;
  EXPECT_TRUE(drive->read_status());
  EXPECT_EQ(server.connections(), 1);
}

TEST(ModbusWire, AWriteThatIsAcknowledgedWronglyIsAFault) {
  RawServer server([](const Bytes& request, int, int socket) {
    RawServer::say(socket, request[7] == 0x03 ? proper(request) : changed(proper(request), 9, 1));
    return true;
  });
  SteadyClock clock;
  const auto drive = iai_at(server.port(), clock);
  for (const auto& done : {drive->halt(), drive->start_move({1, 1, 1})}) {
    ASSERT_FALSE(done);
    EXPECT_EQ(done.error().kind, FaultKind::kProtocol);
    EXPECT_NE(done.error().message.find("echoed byte"), std::string::npos) << done.error().text();
  }
}

TEST(ModbusWire, AConnectionClosedWhileIdleCostsNothing) {
  RawServer server([](const Bytes& request, int, int socket) {
    RawServer::say(socket, proper(request));
    return true;
  });
  SteadyClock clock;
  const auto drive = iai_at(server.port(), clock);
  ASSERT_TRUE(drive->read_status());
  server.drop_connections();
  const auto status = drive->read_status();
  ASSERT_TRUE(status) << status.error().text();
  EXPECT_EQ(server.connections(), 2);
}

TEST(ModbusWire, ADriveThatComesBackNeedsNoRestart) {
  const auto answer = [](const Bytes& request, int, int socket) {
    RawServer::say(socket, proper(request));
    return true;
  };
  auto server = std::make_unique<RawServer>(answer);
  const int port = server->port();
  SteadyClock clock;
  const auto drive = iai_at(port, clock);
  ASSERT_TRUE(drive->connect());
  server.reset();
  const auto gone = drive->read_status();
  ASSERT_FALSE(gone);
  EXPECT_EQ(gone.error().kind, FaultKind::kUnreachable);
  server = std::make_unique<RawServer>(answer, port);
  const auto back = drive->read_status();
  EXPECT_TRUE(back) << back.error().text();
}

TEST(ModbusWire, ACommandIsNeverSentTwice) {
  std::atomic<int> moves{0};
  RawServer server([&](const Bytes& request, int, int socket) {
    if (request[7] == 0x10) {
      ++moves;
      return false;  // Carried out, but the connection dies before the acknowledgement.
    }
    RawServer::say(socket, proper(request));
    return true;
  });
  SteadyClock clock;
  const auto drive = iai_at(server.port(), clock);
  EXPECT_FALSE(drive->start_move({1, 1, 1}));
  EXPECT_TRUE(drive->read_status());
  EXPECT_EQ(moves, 1);
}

TEST(ModbusWire, UnitsOnOneBusDoNotMixUpAndASilentOneFaultsAlone) {
  constexpr uint8_t kSilent = 9;
  RawServer server([](const Bytes& request, int, int socket) {
    if (request[6] != kSilent) RawServer::say(socket, proper(request, request[6]));
    return true;
  });
  SteadyClock clock;
  const auto bus = make_modbus_bus("127.0.0.1", server.port());
  std::atomic<int> bad{0};
  std::vector<std::thread> threads;
  for (int unit = 1; unit <= 3; ++unit) {
    threads.emplace_back([&, unit] {
      const auto drive = iai_at(server.port(), clock, unit, bus);
      for (int i = 0; i < 200; ++i) {
        const auto status = drive->read_status();
        if (!status || std::abs(status->position - unit / 100.0) > 1e-9) ++bad;
      }
    });
  }
  const auto silent = iai_at(server.port(), clock, kSilent, bus);
  for (int i = 0; i < 3; ++i) {
    const auto status = silent->read_status();
    ASSERT_FALSE(status);
    EXPECT_EQ(status.error().kind, FaultKind::kTimeout);
    EXPECT_NE(status.error().message.find("unit 9"), std::string::npos);
  }
  for (auto& thread : threads) thread.join();
  EXPECT_EQ(bad, 0);
}

}  // namespace
}  // namespace gantry
