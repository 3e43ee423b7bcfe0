// The twin's I/O module as any Modbus client sees it (libmodbus here), and the contacts behind it.

#include <gtest/gtest.h>
#include <modbus.h>

#include <array>
#include <memory>

#include "foundation/expect_input_error.h"
#include "gantry/sim/twin/modbus_drives.h"

namespace gantry {
namespace {

constexpr int kUnit = 10;

struct IoModuleTest : ::testing::Test {
  IoModuleTest() {
    server.add_io_module(kUnit, contacts);
    server.start();
    client.reset(modbus_new_tcp("127.0.0.1", server.port()));
    modbus_set_slave(client.get(), kUnit);
    modbus_set_response_timeout(client.get(), 5, 0);
    EXPECT_EQ(modbus_connect(client.get()), 0);
  }

  /// Inputs 0 to 15 as a word of ones and zeros, the first input first.
  std::string inputs() {
    std::array<uint8_t, 16> bits{};
    if (modbus_read_input_bits(client.get(), 0, 16, bits.data()) != 16) return modbus_strerror(errno);
    std::string text;
    for (const uint8_t bit : bits) text += bit ? '1' : '0';
    return text;
  }

  VirtualClock clock;
  SafetyContacts contacts{{{"emergency stop", {0, 1}}, {"door", {4, 2}}, {"curtain", {15}}}, clock};
  ModbusDriveServer server{"127.0.0.1", 0, clock};
  std::unique_ptr<modbus_t, void (*)(modbus_t*)> client{nullptr, [](modbus_t* context) {
                                                          modbus_close(context);
                                                          modbus_free(context);
                                                        }};
};

TEST_F(IoModuleTest, ReleasedIsOneAndWhatIsNotWiredIsZero) {
  EXPECT_EQ(inputs(), "1110100000000001");
}

TEST_F(IoModuleTest, PressedDevicesOpenTheirContactsOneAfterTheOther) {
  contacts.press("emergency stop");
  EXPECT_EQ(inputs(), "0010100000000001");
  contacts.press("door", 0.2);  // channel 4 first, channel 2 by 0.2 s later
  EXPECT_EQ(inputs(), "0010000000000001");
  clock.sleep_s(0.1);
  EXPECT_EQ(inputs(), "0010000000000001");
  clock.sleep_s(0.11);
  EXPECT_EQ(inputs(), "0000000000000001");
  contacts.release("door", 0.1);
  EXPECT_EQ(inputs(), "0000100000000001");
  clock.sleep_s(0.05);
  contacts.press("door");  // while closing
  EXPECT_EQ(inputs(), "0000000000000001");
  clock.sleep_s(1);
  EXPECT_EQ(inputs(), "0000000000000001");
  contacts.release("door");
  contacts.release("emergency stop");
  EXPECT_EQ(inputs(), "1110100000000001");
}

TEST_F(IoModuleTest, BrokenWiresStuckContactsAndAMissingSupplyAreUndoneByMending) {
  contacts.break_wire(1);
  EXPECT_EQ(inputs(), "1010100000000001");
  contacts.stick(0);
  contacts.press("emergency stop");
  EXPECT_EQ(inputs(), "1010100000000001") << "welded shut";
  contacts.mend(0);
  contacts.release("emergency stop");
  contacts.mend(1);
  EXPECT_EQ(inputs(), "1110100000000001");
  contacts.set_supply(false);
  EXPECT_EQ(inputs(), "0000000000000000");
  contacts.set_supply(true);
  EXPECT_EQ(inputs(), "1110100000000001");
}

TEST_F(IoModuleTest, AnythingButFunctionTwoWithinSixteenInputsIsAnException) {
  std::array<uint8_t, 32> bits{};
  std::array<uint16_t, 2> words{};
  EXPECT_EQ(modbus_read_input_bits(client.get(), 15, 2, bits.data()), -1);
  EXPECT_EQ(errno, EMBXILADD);
  EXPECT_EQ(modbus_read_input_bits(client.get(), 16, 1, bits.data()), -1);
  EXPECT_EQ(errno, EMBXILADD);
  EXPECT_EQ(modbus_read_bits(client.get(), 0, 1, bits.data()), -1);
  EXPECT_EQ(errno, EMBXILFUN);
  EXPECT_EQ(modbus_read_registers(client.get(), 0, 1, words.data()), -1);
  EXPECT_EQ(errno, EMBXILFUN);
  EXPECT_EQ(modbus_write_bit(client.get(), 0, 1), -1);
  EXPECT_EQ(errno, EMBXILFUN);
  EXPECT_EQ(modbus_write_registers(client.get(), 0, 1, words.data()), -1);
  EXPECT_EQ(errno, EMBXILFUN);
  EXPECT_EQ(inputs(), "1110100000000001");
}

TEST_F(IoModuleTest, WrongWiringAndInjectionAreRefused) {
  expect_input_error([&] { contacts.press("window"); }, {"'window'"});
  expect_input_error([&] { contacts.break_wire(3); }, {"channel 3"});
  expect_input_error([&] { SafetyContacts({{"a", {0}}, {"a", {1}}}, clock); }, {"'a'"});
  expect_input_error([&] { SafetyContacts({{"a", {0}}, {"b", {0}}}, clock); }, {"channel 0", "twice"});
  SafetyContacts far({{"far", {16}}}, clock);
  expect_input_error([&] { server.add_io_module(11, far); }, {"'far'", "16"});
  expect_input_error([&] { server.add_io_module(kUnit, contacts); }, {"unit 10", "twice"});
  expect_input_error([&] { server.raise_alarm(kUnit, 1); }, {"no motor"});
  expect_input_error([&] { server.set_emergency_stop(kUnit, true); }, {"no motor"});
}

}  // namespace
}  // namespace gantry
