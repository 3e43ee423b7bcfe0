#include "gantry/hal/modbus_drives.h"

#include <arpa/inet.h>
#include <gtest/gtest.h>
#include <netinet/in.h>
#include <poll.h>
#include <sys/socket.h>
#include <unistd.h>

#include <atomic>
#include <chrono>
#include <condition_variable>
#include <functional>
#include <map>
#include <mutex>
#include <numbers>
#include <optional>
#include <thread>
#include <vector>

#include "gantry/sim/twin/modbus_drives.h"
#include "hal/axis_conformance.h"

namespace gantry {
namespace {

constexpr double kPi = std::numbers::pi;
constexpr double kStepsPerRadian = 36'000 / (2 * kPi);  // 0.01 degrees a step.

// ---- Against the twin's drives, over the wire -----------------------------------------------------

/// An axis on a drive of the twin: both on one virtual clock, between them Modbus TCP on loopback.
class TwinRig final : public AxisRig {
 public:
  TwinRig(const std::string& profile, AxisKind kind, const StageDynamics& dynamics, const AxisLimits& limits)
      : stage_(dynamics, 11), server_("127.0.0.1", 0, clock_) {
    const bool rotary = kind == AxisKind::kRotary;
    server_.add({profile, kUnit, rotary ? 1.0 / kStepsPerRadian : 0.01}, stage_);
    server_.start();
    ModbusDriveConfig config;
    config.axis = rotary ? "tilt" : "linear";
    config.kind = kind;
    config.profile = profile;
    config.host = "127.0.0.1";
    config.port = server_.port();
    config.unit = kUnit;
    config.counts_per_axis_unit = rotary ? kStepsPerRadian : 0;
    config.response_timeout_s = 2.0;  // Loaded test machines; nothing here is about time-outs.
    axis_.emplace(make_modbus_drive(config, nullptr, clock_), kind, limits, clock_);
  }

  Axis& axis() override { return *axis_; }
  Clock& clock() override { return clock_; }
  bool raise_alarm() override {
    server_.raise_alarm(kUnit, 0x30);
    return true;
  }
  bool set_emergency_stop(bool active) override {
    server_.set_emergency_stop(kUnit, active);
    return true;
  }

 private:
  static constexpr int kUnit = 3;
  VirtualClock clock_;
  SimulatedStage stage_;
  ModbusDriveServer server_;
  std::optional<Axis> axis_;
};

const bool iai_registered = register_axis_conformance("IaiRoboCylinder", [] {
  return std::make_unique<TwinRig>(
      "iai_robo_cylinder", AxisKind::kLinear,
      StageDynamics{.travel_min = -5,
                    .travel_max = 305,
                    .max_speed = 200,
                    .max_acceleration = 2000,
                    .homing_speed = 20,
                    .encoder_resolution = 0.001,
                    .repeatability_sigma = 0.005},
      AxisLimits{.lower = 0, .upper = 300, .speed = 100, .acceleration = 1000, .in_position = 0.06});
});

const bool az_registered = register_axis_conformance("OrientalMotorAz", [] {
  return std::make_unique<TwinRig>(
      "oriental_motor_az", AxisKind::kRotary,
      StageDynamics{.travel_min = -1.1 * kPi,
                    .travel_max = 1.1 * kPi,
                    .max_speed = 2,
                    .max_acceleration = 10,
                    .homing_speed = 0.5,
                    .encoder_resolution = 1e-5,
                    .repeatability_sigma = 5e-5},
      AxisLimits{.lower = -kPi, .upper = kPi, .speed = 1, .acceleration = 5, .in_position = 0.002});
});

// ---- Against a server that misbehaves -------------------------------------------------------------

using Bytes = std::vector<uint8_t>;

/// A TCP server on a free loopback port that hands each complete request (7 bytes of header and what they
/// announce) to `answer`, one thread per connection. Closing it closes every connection.
class RawServer {
 public:
  /// Gets the request and the number of the connection, from 1; sends with say(), or closes by returning
  /// false.
  using Answer = std::function<bool(const Bytes& request, int connection, int socket)>;

  explicit RawServer(Answer answer, int port = 0) : answer_(std::move(answer)) {
    listener_ = socket(AF_INET, SOCK_STREAM, 0);
    const int yes = 1;
    setsockopt(listener_, SOL_SOCKET, SO_REUSEADDR, &yes, sizeof yes);
    sockaddr_in address{};
    address.sin_family = AF_INET;
    address.sin_addr.s_addr = htonl(INADDR_LOOPBACK);
    address.sin_port = htons(static_cast<uint16_t>(port));
    socklen_t size = sizeof address;
    if (bind(listener_, reinterpret_cast<sockaddr*>(&address), size) != 0 || listen(listener_, 8) != 0)
      throw std::runtime_error("the test server cannot listen");
    getsockname(listener_, reinterpret_cast<sockaddr*>(&address), &size);
    port_ = ntohs(address.sin_port);
    acceptor_ = std::thread([this] { accept_all(); });
  }

  ~RawServer() {
    shutdown(listener_, SHUT_RDWR);
    acceptor_.join();
    ::close(listener_);
    drop_connections();
    for (auto& thread : threads_) thread.join();
    for (const int socket : sockets_) ::close(socket);
  }

  int port() const { return port_; }
  int connections() const { return connections_; }

  void drop_connections() {
    std::lock_guard lock(mutex_);
    for (const int socket : sockets_) shutdown(socket, SHUT_RDWR);
  }

  static void say(int socket, const Bytes& bytes) {
    (void)!send(socket, bytes.data(), bytes.size(), MSG_NOSIGNAL);
  }

 private:
  void accept_all() {
    for (;;) {
      const int socket = accept(listener_, nullptr, nullptr);
      if (socket < 0) return;
      std::lock_guard lock(mutex_);
      sockets_.push_back(socket);
      threads_.emplace_back([this, socket, number = ++connections_] { serve(socket, number); });
    }
  }

  void serve(int socket, int number) {
    for (;;) {
      Bytes request(6);
      if (recv(socket, request.data(), 6, MSG_WAITALL) != 6) break;
      const size_t rest = request[4] << 8 | request[5];
      request.resize(6 + rest);
      if (recv(socket, request.data() + 6, rest, MSG_WAITALL) != static_cast<ssize_t>(rest)) break;
      if (!answer_(request, number, socket)) break;
    }
    shutdown(socket, SHUT_RDWR);
  }

  Answer answer_;
  int listener_ = -1;
  int port_ = 0;
  std::atomic<int> connections_{0};
  std::mutex mutex_;
  std::vector<int> sockets_;
  std::vector<std::thread> threads_;
  std::thread acceptor_;
};

/// Header and PDU of an answer to `request`.
Bytes frame(const Bytes& request, const Bytes& pdu) {
  Bytes bytes{request[0], request[1], 0, 0, 0, static_cast<uint8_t>(pdu.size() + 1), request[6]};
  for (const uint8_t byte : pdu) bytes.push_back(byte);
  return bytes;
}

/// What a well-behaved IAI drive answers; reads of the status block give `position` counts, servo on, homed.
Bytes proper(const Bytes& request, uint8_t position = 0) {
  if (request[7] != 0x03) return frame(request, Bytes(request.begin() + 7, request.begin() + 12));
  Bytes pdu{0x03, 20};
  pdu.resize(22, 0);
  pdu[5] = position;
  pdu[12] = 0x10;  // 9005: servo on
  pdu[13] = 0x18;  // homed, positioned
  return frame(request, pdu);
}

constexpr double kTimeout_s = 0.15;

std::unique_ptr<Drive> iai_at(int port, Clock& clock, int unit = 2,
                              std::shared_ptr<ModbusBus> bus = nullptr) {
  ModbusDriveConfig config;
  config.axis = "linear";
  config.profile = "iai_robo_cylinder";
  config.host = "127.0.0.1";
  config.port = port;
  config.unit = unit;
  config.in_position_mm = 0.1;
  config.response_timeout_s = kTimeout_s;
  return make_modbus_drive(config, std::move(bus), clock);
}

double seconds_of(const std::function<void()>& action) {
  const auto begin = std::chrono::steady_clock::now();
  action();
  return std::chrono::duration<double>(std::chrono::steady_clock::now() - begin).count();
}

// Slack of the time limits for a machine that is busy with other things.
constexpr double kSlack_s = 0.5;

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
                      " unit 2): no connection: Connection refused; is the drive powered and the address in "
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
            "the drive refused the read of register 9000h (exception 2, illegal data address)");
  code = 3;
  refused = drive->halt();
  ASSERT_FALSE(refused);
  EXPECT_EQ(refused.error().message,
            "the drive refused the write to coil 042Ch (exception 3, illegal data value)");
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

// ---- Drives that take their time to react ---------------------------------------------------------

/// Holding registers that the test sets; writes are kept and acknowledged, nothing else happens.
class RegisterServer {
 public:
  RegisterServer()
      : server_([this](const Bytes& request, int, int socket) {
          RawServer::say(socket, frame(request, answer(request)));
          return true;
        }) {}

  int port() const { return server_.port(); }
  void set(uint16_t address, uint16_t value) {
    std::lock_guard lock(mutex_);
    registers_[address] = value;
  }
  uint16_t get(uint16_t address) {
    std::lock_guard lock(mutex_);
    return registers_[address];
  }
  /// Everything that was written there, in order.
  std::vector<uint16_t> written(uint16_t address) {
    std::lock_guard lock(mutex_);
    return written_[address];
  }

 private:
  Bytes answer(const Bytes& request) {
    std::lock_guard lock(mutex_);
    const auto word = [&](size_t i) { return static_cast<uint16_t>(request[i] << 8 | request[i + 1]); };
    const uint16_t first = word(8), count = word(10);
    if (request[7] == 0x03) {
      Bytes pdu{0x03, static_cast<uint8_t>(2 * count)};
      for (int i = 0; i < count; ++i) {
        const uint16_t value = registers_[static_cast<uint16_t>(first + i)];
        pdu.push_back(static_cast<uint8_t>(value >> 8));
        pdu.push_back(static_cast<uint8_t>(value & 0xFF));
      }
      return pdu;
    }
    if (request[7] == 0x10) {
      for (size_t i = 0; i < count; ++i) {
        const auto address = static_cast<uint16_t>(first + i);
        registers_[address] = word(13 + 2 * i);
        written_[address].push_back(registers_[address]);
      }
    }
    return Bytes(request.begin() + 7, request.begin() + 12);
  }

  std::mutex mutex_;
  std::map<uint16_t, uint16_t> registers_;
  std::map<uint16_t, std::vector<uint16_t>> written_;
  RawServer server_;
};

class SlowDrive : public testing::Test {
 protected:
  DriveStatus read() {
    const auto status = drive->read_status();
    EXPECT_TRUE(status) << status.error().text();
    return status.value_or(DriveStatus{});
  }

  RegisterServer server;
  VirtualClock clock;
  std::unique_ptr<Drive> drive;
};

class SlowIai : public SlowDrive {
 protected:
  static constexpr uint16_t kOn = 0x1000, kHomed = 0x0010, kPend = 0x0008, kMoving = 0x0020;
  SlowIai() {
    drive = iai_at(server.port(), clock);
    server.set(0x9005, kOn | kHomed | kPend);
  }
};

TEST_F(SlowIai, AMoveIsNotInPositionBeforeItShows) {
  ASSERT_TRUE(drive->start_move({50, 100, 1000}));
  for (int i = 0; i < 3; ++i) {
    EXPECT_FALSE(read().in_position);
    EXPECT_TRUE(read().moving);
  }
  server.set(0x9005, kOn | kHomed);
  server.set(0x9007, kMoving);
  EXPECT_TRUE(read().moving);
  server.set(0x9001, 4'995);
  server.set(0x9005, kOn | kHomed | kPend);  // The band is reached, the motion goes on.
  EXPECT_FALSE(read().in_position);
  server.set(0x9007, 0);
  EXPECT_TRUE(read().in_position);
  EXPECT_FALSE(read().moving);
}

TEST_F(SlowIai, AMoveWithinTheBandEndsEvenIfNoMotionWasSeen) {
  ASSERT_TRUE(drive->start_move({0.05, 100, 1000}));
  EXPECT_FALSE(read().in_position);
  clock.sleep_s(0.3);
  EXPECT_TRUE(read().in_position);
  ASSERT_TRUE(drive->start_move({0.0, 100, 1000}));  // Where it stands.
  EXPECT_TRUE(read().in_position);
}

TEST_F(SlowIai, ACommandThatIsIgnoredNeverCountsAsArrived) {
  ASSERT_TRUE(drive->start_move({50, 100, 1000}));
  clock.sleep_s(10);
  EXPECT_FALSE(read().in_position);
  EXPECT_FALSE(read().moving);
}

TEST_F(SlowIai, HomingAgainIsNotOverBeforeItShows) {
  for (const uint16_t pend : {kPend, uint16_t{0}}) {
    server.set(0x9005, kOn | kHomed | pend);
    ASSERT_TRUE(drive->start_homing());
    EXPECT_TRUE(read().moving);
    server.set(0x9005, kOn);
    EXPECT_FALSE(read().homed);
    server.set(0x9005, kOn | kHomed | kPend);
    EXPECT_TRUE(read().homed);
    EXPECT_FALSE(read().moving);
  }
}

TEST_F(SlowIai, AHaltedMoveIsNotInPositionEvenAtItsTarget) {
  ASSERT_TRUE(drive->start_move({50, 100, 1000}));
  ASSERT_TRUE(drive->halt());
  server.set(0x9001, 5'000);
  clock.sleep_s(1);
  EXPECT_FALSE(read().in_position);
}

TEST_F(SlowIai, APausedDriveIsNotGivenACommandToRunLater) {
  server.set(0x9005, kOn | kHomed | 0x0020);
  const auto moved = drive->start_move({50, 100, 1000});
  ASSERT_FALSE(moved);
  EXPECT_EQ(moved.error().kind, FaultKind::kRefused);
  EXPECT_EQ(server.get(0x9901), 0);
  const auto homed = drive->start_homing();
  ASSERT_FALSE(homed);
  EXPECT_EQ(homed.error().kind, FaultKind::kRefused);
}

class SlowAz : public SlowDrive {
 protected:
  static constexpr uint16_t kHomed = 0x0010, kReady = 0x0020, kAlarm = 0x0080, kMove = 0x2000,
                            kInPos = 0x4000;
  static constexpr uint16_t kStop = 0x0020, kFree = 0x0040, kAlarmReset = 0x0080;
  SlowAz() {
    ModbusDriveConfig config;
    config.axis = "tilt";
    config.kind = AxisKind::kRotary;
    config.profile = "oriental_motor_az";
    config.host = "127.0.0.1";
    config.port = server.port();
    config.counts_per_axis_unit = 1000;
    drive = make_modbus_drive(config, nullptr, clock);
    server.set(0x007F, kHomed | kReady | kInPos);
  }
};

TEST_F(SlowAz, AMoveIsNotInPositionBeforeItShows) {
  ASSERT_TRUE(drive->start_move({-1.5, 0.5, 2}));
  EXPECT_EQ(server.get(0x005B), 1);  // Absolute.
  EXPECT_EQ(server.get(0x005C), 0xFFFF);
  EXPECT_EQ(server.get(0x005D), 0x10000 - 1500);
  EXPECT_EQ(server.get(0x005F), 500);   // Hz
  EXPECT_EQ(server.get(0x0061), 2000);  // 0.001 kHz/s
  EXPECT_EQ(server.get(0x0063), 2000);
  EXPECT_EQ(server.get(0x0067), 1);
  EXPECT_FALSE(read().in_position);
  EXPECT_TRUE(read().moving);
  server.set(0x007F, kHomed | kMove);
  server.set(0x0122, 0xFFFF);
  server.set(0x0123, 0x10000 - 1500);  // The command arrives before the motor.
  EXPECT_FALSE(read().in_position);
  server.set(0x0120, 0xFFFF);
  server.set(0x0121, 0x10000 - 1499);
  server.set(0x007F, kHomed | kReady | kInPos);
  const auto status = read();
  EXPECT_TRUE(status.in_position);
  EXPECT_FALSE(status.moving);
  EXPECT_EQ(status.position, -1.499);
}

TEST_F(SlowAz, ACommandThatIsIgnoredNeverCountsAsArrived) {
  ASSERT_TRUE(drive->start_move({1.5, 0.5, 2}));
  clock.sleep_s(10);
  EXPECT_FALSE(read().in_position);
  EXPECT_FALSE(read().moving);
}

TEST_F(SlowAz, HomingAgainIsNotOverBeforeItShows) {
  ASSERT_TRUE(drive->start_homing());
  EXPECT_TRUE(read().moving);
  server.set(0x007F, kMove);
  EXPECT_TRUE(read().moving);
  server.set(0x007F, kHomed | kReady | kInPos);
  EXPECT_FALSE(read().moving);
  EXPECT_TRUE(read().homed);
}

TEST_F(SlowAz, NothingIsStartedWhileTheDriveIsNotReady) {
  server.set(0x007F, kHomed | kInPos);
  const auto moved = drive->start_move({1.5, 0.5, 2});
  ASSERT_FALSE(moved);
  EXPECT_EQ(moved.error().kind, FaultKind::kRefused);
  EXPECT_NE(moved.error().message.find("not ready"), std::string::npos);
  EXPECT_EQ(server.get(0x0067), 0);
  EXPECT_FALSE(drive->start_homing());
  EXPECT_EQ(server.get(0x007D), 0);
}

TEST_F(SlowAz, StopStaysOnUntilTheNextStartAndNeverPowersTheMotor) {
  ASSERT_TRUE(drive->halt());
  EXPECT_EQ(server.get(0x007D), kStop);
  ASSERT_TRUE(drive->start_move({1.5, 0.5, 2}));
  EXPECT_EQ(server.get(0x007D), 0);
  ASSERT_TRUE(drive->set_servo(false));
  ASSERT_TRUE(drive->halt());
  EXPECT_EQ(server.get(0x007D), kFree | kStop);
}

TEST_F(SlowAz, AlarmAndEmergencyStopAreToldApart) {
  server.set(0x007F, kHomed | kAlarm);
  server.set(0x0081, 0x30);
  EXPECT_EQ(read().alarm, 0x30);
  EXPECT_FALSE(read().emergency_stop);
  EXPECT_FALSE(read().servo_on);
  server.set(0x0081, 0x68);
  EXPECT_TRUE(read().emergency_stop);
  ASSERT_TRUE(drive->reset_alarm());
  EXPECT_EQ(server.written(0x007D), (std::vector<uint16_t>{kFree, kFree | kAlarmReset, kFree}))
      << "a rising edge, and never without FREE: a reset must not power the motor";
}

// ---- Configuration --------------------------------------------------------------------------------

TEST(ModbusDriveConfigTest, MistakesAreRejectedByName) {
  SteadyClock clock;
  ModbusDriveConfig good;
  good.axis = "tilt";
  good.kind = AxisKind::kRotary;
  good.profile = "oriental_motor_az";
  good.host = "127.0.0.1";
  good.counts_per_axis_unit = kStepsPerRadian;
  EXPECT_NO_THROW(make_modbus_drive(good, nullptr, clock));
  for (auto break_it : {+[](ModbusDriveConfig& c) { c.profile = "acme"; },
                        +[](ModbusDriveConfig& c) { c.profile = "iai_robo_cylinder"; },  // Rotary.
                        +[](ModbusDriveConfig& c) { c.host = ""; },                      //
                        +[](ModbusDriveConfig& c) { c.port = 70'000; },                  //
                        +[](ModbusDriveConfig& c) { c.unit = 0; },                       //
                        +[](ModbusDriveConfig& c) { c.unit = 248; },                     //
                        +[](ModbusDriveConfig& c) { c.counts_per_axis_unit = 0; },       //
                        +[](ModbusDriveConfig& c) { c.response_timeout_s = 0; }}) {
    ModbusDriveConfig config = good;
    break_it(config);
    try {
      make_modbus_drive(config, nullptr, clock);
      ADD_FAILURE() << "accepted";
    } catch (const InputError& error) {
      EXPECT_NE(std::string(error.what()).find("axis tilt"), std::string::npos);
    }
  }
}

TEST(ModbusDriveConfigTest, WhatTheRegistersCannotHoldIsRefusedBeforeItIsSent) {
  SteadyClock clock;
  const auto drive = iai_at(1, clock);  // Nobody listens there: an attempt to send would say so.
  for (const MoveCommand& command :
       {MoveCommand{3e7, 1, 1}, MoveCommand{1, 1e5, 1}, MoveCommand{1, 1, 1e8}, MoveCommand{1, 0, 1},
        MoveCommand{1, 1, -1}, MoveCommand{std::nan(""), 1, 1}}) {
    const auto moved = drive->start_move(command);
    ASSERT_FALSE(moved);
    EXPECT_EQ(moved.error().kind, FaultKind::kLimit) << moved.error().text();
  }
}

}  // namespace
}  // namespace gantry
