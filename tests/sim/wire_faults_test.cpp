// Faults on the twin's wires, seen by a client that has none of the project's code.
#include "gantry/sim/twin/wire_faults.h"

#include <modbus.h>

#include "sim/modbus_client.h"

namespace gantry {
namespace {

std::vector<int> fates(WireFaults& faults, int count) {
  std::vector<int> all;
  for (int i = 0; i < count; ++i) {
    const auto fate = faults.next(1 + i % 2);
    all.push_back(fate ? static_cast<int>(*fate) : -1);
  }
  return all;
}

TEST(WireFaults, TheSameSeedGivesTheSameFaults) {
  WireFaults first(5), second(5), other(6);
  for (WireFaults* faults : {&first, &second, &other}) {
    faults->set_probability(WireFault::kDropReply, 0.2);
    faults->set_probability(WireFault::kCorruptReply, 0.1);
  }
  const auto expected = fates(first, 500);
  EXPECT_EQ(fates(second, 500), expected);
  EXPECT_NE(fates(other, 500), expected);
  second.reseed(5);
  EXPECT_EQ(fates(second, 500), expected);
  EXPECT_NEAR(std::count(expected.begin(), expected.end(), static_cast<int>(WireFault::kDropReply)), 100, 35);
}

TEST(WireFaults, PlannedOnesComeOnceAndAllIsReversible) {
  WireFaults faults;
  faults.plan(WireFault::kTruncateReply, 1);
  faults.plan(WireFault::kException, 1, 2);
  EXPECT_EQ(faults.next(2), std::nullopt);
  EXPECT_EQ(faults.next(1), WireFault::kTruncateReply);
  EXPECT_EQ(faults.next(1), WireFault::kException);
  EXPECT_EQ(faults.next(1), WireFault::kException);
  EXPECT_EQ(faults.next(1), std::nullopt);
  faults.set_silent(2, true);
  EXPECT_EQ(faults.next(2), WireFault::kLoseRequest);
  faults.set_silent(2, false);
  EXPECT_EQ(faults.next(2), std::nullopt);
  faults.set_probability(WireFault::kDropReply, 1);
  faults.plan(WireFault::kException, 1);
  faults.clear();
  EXPECT_EQ(faults.next(1), std::nullopt);
  EXPECT_THROW(faults.set_probability(WireFault::kDropReply, 1.5), InputError);
  EXPECT_THROW(faults.set_delay_s(-1), InputError);
}

TEST_F(ModbusDrives, FaultsOnTcp) {
  WireFaults& faults = server_.wire_faults();
  const Bytes request = bytes("00 01 00 00 00 06 01 03 90 05 00 01");
  const Bytes reply = bytes("00 01 00 00 00 05 01 03 02 20 00");
  const auto next = [&](WireFault fault) {
    faults.plan(fault, kIai);
    Connection one(server_.port());
    one.send(request);
    // Whatever comes, then the answer to a second, healthy request behind it.
    Bytes got = one.receive(fault == WireFault::kDuplicateReply ? 22 : 0);
    one.send(request);
    const Bytes more = one.receive(11);
    got.insert(got.end(), more.begin(), more.end());
    return got;
  };
  EXPECT_EQ(next(WireFault::kDropReply), reply);
  EXPECT_EQ(next(WireFault::kLoseRequest), reply);
  EXPECT_EQ(next(WireFault::kDuplicateReply).size(), 33u);
  EXPECT_EQ(hex(next(WireFault::kException)).substr(0, 26), "00 01 00 00 00 03 01 83 06");
  const Bytes cut = next(WireFault::kTruncateReply);
  EXPECT_NE(cut, reply) << "the beginning of one and of another";
  const Bytes wrong = next(WireFault::kCorruptReply);
  int bits = 0;
  for (size_t i = 0; i < reply.size(); ++i) bits += __builtin_popcount(wrong[i] ^ reply[i]);
  EXPECT_EQ(bits, 1);
  EXPECT_TRUE(std::equal(reply.begin() + 7, reply.end(), wrong.begin() + 7)) << "in the header";
}

TEST_F(ModbusDrives, AnUnpluggedTcpServerComesBackAtItsPort) {
  EXPECT_EQ(status(), 0x2000);
  server_.set_plugged(false);
  EXPECT_TRUE(client().closed_by_server());
  server_.set_plugged(true);
  client_.reset();
  EXPECT_EQ(status(), 0x2000);
}

TEST(SerialLine, LibmodbusAsClientAgrees) {
  VirtualClock clock;
  SimulatedStage linear({-200, 300, 200, 2000, 50, 0.01, 0.002, 0.15}, 7),
      tilt({-1, 1, 1, 5, 0.3, 1e-4, 0, 0.15}, 8);
  ModbusDriveServer server(TwinSerialLine{{}, 115200, true}, clock);
  server.add({"iai_robo_cylinder", 1, 0.01}, linear);
  server.add({"oriental_motor_az", 2, 0.001}, tilt);
  server.start();
  modbus_t* context = modbus_new_rtu(server.device().c_str(), 115200, 'N', 8, 1);
  ASSERT_EQ(modbus_connect(context), 0) << modbus_strerror(errno);
  modbus_set_response_timeout(context, 2, 0);
  uint16_t words[10] = {};
  modbus_set_slave(context, 1);
  EXPECT_EQ(modbus_write_bit(context, 0x0403, 1), 1) << modbus_strerror(errno);
  const auto begin = std::chrono::steady_clock::now();
  EXPECT_EQ(modbus_read_registers(context, 0x9000, 10, words), 10);
  const std::chrono::duration<double> spent = std::chrono::steady_clock::now() - begin;
  EXPECT_GT(spent.count(), (8 + 25) * 11 / 115200.0) << "the bytes need their time";
  EXPECT_EQ(words[5], 0x3008);
  modbus_set_slave(context, 2);
  EXPECT_EQ(modbus_read_registers(context, 0x007E, 2, words), 2);
  EXPECT_EQ(words[1], 0x4020);
  modbus_set_slave(context, 3);  // Nobody.
  modbus_set_response_timeout(context, 0, 50'000);
  EXPECT_EQ(modbus_read_registers(context, 0x007E, 2, words), -1);
  EXPECT_EQ(errno, ETIMEDOUT);
  modbus_close(context);
  modbus_free(context);
}

TEST(SerialLine, TheLinkIsMadeAndGoesAndNeverReplacesAFile) {
  VirtualClock clock;
  const auto folder = std::filesystem::temp_directory_path() / ("gantry_serial_" + std::to_string(getpid()));
  std::filesystem::create_directory(folder);
  {
    ModbusDriveServer server(TwinSerialLine{folder / "line", 115200, false}, clock);
    server.start();
    EXPECT_EQ(std::filesystem::read_symlink(folder / "line"), server.device());
    server.set_plugged(false);
    EXPECT_FALSE(std::filesystem::exists(folder / "line"));
    EXPECT_TRUE(server.device().empty());
    server.set_plugged(true);
    EXPECT_EQ(std::filesystem::read_symlink(folder / "line"), server.device());
  }
  EXPECT_FALSE(std::filesystem::exists(std::filesystem::symlink_status(folder / "line")));
  std::fclose(std::fopen((folder / "file").c_str(), "w"));
  ModbusDriveServer refused(TwinSerialLine{folder / "file", 115200, false}, clock);
  EXPECT_THROW(refused.start(), InputError);
  EXPECT_TRUE(std::filesystem::is_regular_file(folder / "file"));
  ModbusDriveServer nowhere(TwinSerialLine{folder / "no/such/folder", 115200, false}, clock);
  EXPECT_THROW(nowhere.start(), InputError);
  std::filesystem::remove_all(folder);
}

TEST(CommunicationTimeout, AnAzThatHearsNothingStoppedThen) {
  VirtualClock clock;
  SimulatedStage stage({-200, 300, 200, 2000, 50, 0.01, 0, 0.15}, 7);
  ModbusDriveServer server("127.0.0.1", 0, clock);
  server.add({"oriental_motor_az", 1, 0.01, 0x1000}, stage);
  server.start();
  Connection client(server.port());
  client.write(1, "10 10 00 00 02 04 00 00 01 F4");  // 500 ms
  client.write(1, "10 00 7C 00 02 04 00 00 00 10");
  for (int i = 0; i < 200; ++i) {
    clock.sleep_s(0.3);
    client.read(1, 0x007F, 1);
  }
  EXPECT_EQ(client.read32(1, 0x0080), 0);
  client.write(1, "10 00 58 00 10 20 " + hex32(0) + " " + hex32(1) + " " + hex32(20000) + " " + hex32(2000) +
                      " " + hex32(100'000) + " " + hex32(100'000) + " " + hex32(1000) + " " + hex32(1));
  clock.sleep_s(3);
  EXPECT_EQ(client.read32(1, 0x0080), 0x85);
  EXPECT_NEAR(client.read32(1, 0x0120), 1000, 25) << "20 mm/s for the half second that it still trusted";
  EXPECT_FALSE(stage.observe(clock.now_s()).servo_on);
}

}  // namespace
}  // namespace gantry
