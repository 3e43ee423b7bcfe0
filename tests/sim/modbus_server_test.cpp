#include <modbus.h>

#include "sim/modbus_client.h"

namespace gantry {
namespace {

TEST_F(ModbusDrives, IllegalRequestsGetTheStandardsExceptions) {
  const struct {
    int unit;
    const char* pdu;
    const char* reply;
  } cases[] = {
      {kIai, "04 90 00 00 01", "84 01"},  // functions that the drives do not have
      {kIai, "0F 04 03 00 01 01 01", "8F 01"},
      {kIai, "2B 0E 01 00", "AB 01"},
      {kIai, "03", "83 03"},  // truncated inside its frame
      {kIai, "03 90 00 00", "83 03"},
      {kIai, "03 90 00 00 01 00", "83 03"},  // too long
      {kIai, "03 90 00 00 00", "83 03"},     // quantities
      {kIai, "03 90 00 00 7E", "83 03"},
      {kIai, "01 01 00 00 00", "81 03"},
      {kIai, "02 01 00 07 D1", "82 03"},
      {kIai, "05 04 03 00 01", "85 03"},              // coil value
      {kIai, "10 99 00 00 02 03 00 00 00", "90 03"},  // byte count
      {kIai, "10 99 00 00 02 04 00 00 00", "90 03"},
      {kIai, "10 99 00 00 02 03 00 00 00 00", "90 03"},
      {kIai, "10 99 00 00 00 00", "90 03"},
      {kIai, "03 90 0C 00 01", "83 02"},  // addresses
      {kIai, "03 90 00 00 0D", "83 02"},
      {kIai, "03 00 00 00 01", "83 02"},
      {kIai, "03 FF FF 00 02", "83 02"},
      {kIai, "01 00 FF 00 01", "81 02"},
      {kIai, "01 01 2F 00 02", "81 02"},
      {kIai, "05 04 02 FF 00", "85 02"},
      {kIai, "05 01 03 FF 00", "85 02"},
      {kIai, "06 90 02 00 00", "86 02"},  // read-only
      {kIai, "06 99 00 00 00", "86 02"},  // half a 32-bit register
      {kIai, "10 99 01 00 02 04 00 00 00 00", "90 02"},
      {kIai, "10 99 00 00 0A 14 00 00 00 00 00 00 00 00 00 00 00 00 00 00 00 00 00 00 00 00", "90 02"},
      {kAz, "01 00 00 00 01", "81 01"},
      {kAz, "05 00 7D FF 00", "85 01"},
      {kAz, "03 00 57 00 02", "83 02"},
      {kAz, "03 00 67 00 02", "83 02"},
      {kAz, "06 00 7F 00 00", "86 02"},
      {kAz, "10 00 7C 00 04 08 00 00 00 00 00 00 00 00", "90 02"},
      {3, "03 90 00 00 01", "83 0B"},  // nobody there
      {0, "03 90 00 00 01", "83 0B"},
  };
  for (const auto& c : cases) EXPECT_EQ(client().ask(c.unit, c.pdu), c.reply) << c.pdu;
  EXPECT_EQ(status(), 0x2000);
  EXPECT_EQ(alarm(), 0);
}

TEST_F(ModbusDrives, UnitsAreIndependent) {
  home_linear();
  EXPECT_FALSE(output(4));
  server_.raise_alarm(kAz, 0x30);
  EXPECT_EQ(az_alarm(), 0x30);
  EXPECT_EQ(alarm(), 0);
  EXPECT_THROW(server_.raise_alarm(9, 1), InputError);
}

TEST_F(ModbusDrives, LibmodbusClientAgrees) {
  modbus_t* context = modbus_new_tcp("127.0.0.1", server_.port());
  ASSERT_EQ(modbus_connect(context), 0) << modbus_strerror(errno);
  modbus_set_slave(context, kIai);
  EXPECT_EQ(modbus_write_bit(context, 0x0403, 1), 1);
  uint16_t words[10] = {};
  EXPECT_EQ(modbus_read_registers(context, 0x9000, 10, words), 10);
  EXPECT_EQ(words[5], 0x3008);
  uint8_t bits[16] = {};
  EXPECT_EQ(modbus_read_input_bits(context, 0x0100, 16, bits), 16);
  EXPECT_EQ(bits[3], 1);
  EXPECT_EQ(modbus_read_registers(context, 0x8000, 1, words), -1);
  EXPECT_EQ(errno, EMBXILADD);
  modbus_close(context);
  modbus_free(context);
}

TEST_F(ModbusDrives, HalfAFrameDoesNotDisturbOthersAndIsCompletedLater) {
  Connection slow(server_.port());
  slow.send(bytes("00 01 00 00 00 06 01 03"));
  const auto begin = std::chrono::steady_clock::now();
  for (int i = 0; i < 20; ++i) EXPECT_EQ(status(), 0x2000);
  EXPECT_LT(std::chrono::steady_clock::now() - begin, std::chrono::seconds(2));
  slow.send(bytes("90 02 00 01"));
  EXPECT_EQ(hex(slow.receive_frame()), "00 01 00 00 00 05 01 03 02 00 00");
}

TEST_F(ModbusDrives, PipelinedRequestsAreAnsweredInOrder) {
  Bytes burst;
  for (int i = 0; i < 50; ++i) {
    const Bytes frame = bytes(hex16(i) + " 00 00 00 06 01 03 90 05 00 01");
    burst.insert(burst.end(), frame.begin(), frame.end());
  }
  client().send(burst);
  for (int i = 0; i < 50; ++i)
    EXPECT_EQ(hex(client().receive_frame()), hex16(i) + " 00 00 00 05 01 03 02 20 00");
}

TEST_F(ModbusDrives, BytesThatAreNotModbusCloseTheConnection) {
  for (const char* nonsense : {"00 01 00 01 00 06 01 03 90 00 00 01", "00 01 00 00 00 01 01",
                               "00 01 00 00 FF FF 01 03", "47 45 54 20 2F 20"}) {
    Connection bad(server_.port());
    bad.send(bytes(nonsense));
    EXPECT_TRUE(bad.closed_by_server()) << nonsense;
    EXPECT_EQ(status(), 0x2000);
  }
}

TEST_F(ModbusDrives, SurvivesGarbageAndBrokenConnections) {
  std::mt19937 random(3);
  std::uniform_int_distribution<int> any_byte(0, 255);
  std::uniform_int_distribution<int> any_length(1, 600);
  for (int i = 0; i < 300; ++i) {
    Connection rude(server_.port());
    Bytes garbage(static_cast<size_t>(any_length(random)));
    for (uint8_t& byte : garbage) byte = static_cast<uint8_t>(any_byte(random));
    rude.send(garbage);
  }
  EXPECT_EQ(status(), 0x2000);
}

TEST_F(ModbusDrives, EveryFramedRequestGetsOneReply) {
  std::mt19937 random(4);
  const auto draw = [&](int max) { return std::uniform_int_distribution<int>(0, max)(random); };
  const int starts[] = {0x0058, 0x0066, 0x007C, 0x0100, 0x0400, 0x0D00, 0x9000, 0x9900};
  for (int i = 0; i < 3000; ++i) {
    Bytes pdu{static_cast<uint8_t>(draw(3) ? 1 + draw(16) : draw(255))};
    const int address = starts[draw(7)] + draw(12);
    const Bytes rest = bytes(hex16(address) + " 00 " + hex({static_cast<uint8_t>(draw(9))}));
    pdu.insert(pdu.end(), rest.begin(), rest.end());
    for (int n = draw(24); n > 0; --n) pdu.push_back(static_cast<uint8_t>(draw(255)));
    const Bytes reply = bytes(client().ask(1 + draw(1), hex(pdu)));
    ASSERT_GE(reply.size(), 2u) << hex(pdu);
    ASSERT_EQ(reply[0] & 0x7F, pdu[0] & 0x7F) << hex(pdu);
    clock_.sleep_s(0.05);
  }
}

TEST_F(ModbusDrives, ManyClientsAtOnce) {
  std::vector<std::unique_ptr<Connection>> clients;
  for (int i = 0; i < 20; ++i) clients.push_back(std::make_unique<Connection>(server_.port()));
  for (auto& c : clients) EXPECT_EQ(c->read(kIai, 0x9005, 1)[0], 0x2000);
  clients.erase(clients.begin(), clients.begin() + 10);
  for (auto& c : clients) EXPECT_EQ(c->read(kIai, 0x9005, 1)[0], 0x2000);
}

TEST_F(ModbusDrives, MoreClientsThanItServesWaitForTheirTurn) {
  std::vector<std::unique_ptr<Connection>> clients;
  for (int i = 0; i < 33; ++i) clients.push_back(std::make_unique<Connection>(server_.port()));
  for (int i = 0; i < 32; ++i) EXPECT_EQ(clients[static_cast<size_t>(i)]->read(kIai, 0x9005, 1)[0], 0x2000);
  clients.erase(clients.begin());
  EXPECT_EQ(clients.back()->read(kIai, 0x9005, 1)[0], 0x2000);
}

TEST(ModbusDriveServer, StopsPromptlyWithClientsConnected) {
  VirtualClock clock;
  SimulatedStage stage({0, 100, 10, 100, 10, 0.01, 0, 0.1}, 1);
  auto server = std::make_unique<ModbusDriveServer>("127.0.0.1", 0, clock);
  server->add({"iai_robo_cylinder", 1, 0.01}, stage);
  server->start();
  Connection idle(server->port());
  idle.read(1, 0x9005, 1);
  idle.send(bytes("00 01 00 00 00 06"));
  const auto begin = std::chrono::steady_clock::now();
  server.reset();
  EXPECT_LT(std::chrono::steady_clock::now() - begin, std::chrono::seconds(1));
  EXPECT_TRUE(idle.closed_by_server());
}

TEST(ModbusDriveServer, NamesWhatIsWrongWithItsConfiguration) {
  VirtualClock clock;
  SimulatedStage stage({0, 100, 10, 100, 10, 0.01, 0, 0.1}, 1);
  ModbusDriveServer first("127.0.0.1", 0, clock);
  first.start();
  ModbusDriveServer second("127.0.0.1", first.port(), clock);
  try {
    second.start();
    FAIL() << "the port is taken";
  } catch (const InputError& error) {
    EXPECT_NE(std::string(error.what()).find("127.0.0.1:" + std::to_string(first.port())), std::string::npos)
        << error.what();
  }
  for (const char* address : {"0.0.0.0", "192.168.1.1", "localhost", ""})
    EXPECT_THROW(ModbusDriveServer(address, 0, clock), InputError) << address;
  EXPECT_THROW(ModbusDriveServer("127.0.0.1", 70000, clock), InputError);
  EXPECT_THROW(first.add({"kuka", 1, 0.01}, stage), InputError);
  EXPECT_THROW(first.add({"iai_robo_cylinder", 0, 0.01}, stage), InputError);
  EXPECT_THROW(first.add({"iai_robo_cylinder", 248, 0.01}, stage), InputError);
  EXPECT_THROW(first.add({"iai_robo_cylinder", 1, 0.02}, stage), InputError);
  EXPECT_THROW(first.add({"oriental_motor_az", 1, 0.0}, stage), InputError);
  first.add({"iai_robo_cylinder", 1, 0.01}, stage);
  EXPECT_THROW(first.add({"oriental_motor_az", 1, 0.01}, stage), InputError);
}

}  // namespace
}  // namespace gantry
