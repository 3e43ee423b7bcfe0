// Safety inputs over Modbus TCP: the backend against the twin's I/O module, and against bytes of the
// specification.

#include <arpa/inet.h>
#include <gtest/gtest.h>
#include <netinet/in.h>
#include <sys/socket.h>
#include <unistd.h>

#include <thread>

#include "foundation/expect_input_error.h"
#include "gantry/hal/modbus_safety_inputs.h"
#include "gantry/sim/twin/modbus_drives.h"

namespace gantry {
namespace {

constexpr int kUnit = 10;

ModbusSafetyInputsConfig config_for(int port, std::vector<int> channels) {
  ModbusSafetyInputsConfig config;
  config.host = "127.0.0.1";
  config.port = port;
  config.unit = kUnit;
  config.channels = std::move(channels);
  config.response_timeout_s = 2;  // Loaded test machines; nothing here is about time-outs.
  return config;
}

std::vector<SafetyDevice> devices() {
  return {{"emergency stop", {9, 2}}, {"door", {5}}};
}

TEST(ModbusSafetyInputs, LevelsComeInTheOrderAskedFor) {
  VirtualClock clock;
  SafetyContacts contacts(devices(), clock);
  ModbusDriveServer server("127.0.0.1", 0, clock);
  server.add_io_module(kUnit, contacts);
  server.start();
  const auto inputs = make_modbus_safety_inputs(config_for(server.port(), {9, 2, 5}), nullptr);
  EXPECT_EQ(inputs->read().value(), std::vector<bool>({true, true, true}));
  contacts.break_wire(2);
  EXPECT_EQ(inputs->read().value(), std::vector<bool>({true, false, true}));
  contacts.press("door");
  EXPECT_EQ(inputs->read().value(), std::vector<bool>({true, false, false}));
  contacts.mend(2);
  contacts.press("emergency stop");
  EXPECT_EQ(inputs->read().value(), std::vector<bool>({false, false, false}));
  contacts.release("door");
  EXPECT_EQ(inputs->read().value(), std::vector<bool>({false, false, true}));
}

TEST(ModbusSafetyInputs, FaultsNameTheModule) {
  VirtualClock clock;
  SafetyContacts contacts(devices(), clock);
  ModbusDriveServer server("127.0.0.1", 0, clock);
  server.add_io_module(kUnit, contacts);
  server.start();
  const auto beyond = make_modbus_safety_inputs(config_for(server.port(), {2, 16}), nullptr)->read();
  ASSERT_FALSE(beyond);
  EXPECT_EQ(beyond.error().kind, FaultKind::kRefused);
  EXPECT_NE(beyond.error().text().find("unit 10"), std::string::npos);
  EXPECT_NE(beyond.error().text().find("discrete input 0002h"), std::string::npos) << beyond.error().text();
  ModbusSafetyInputsConfig absent = config_for(server.port(), {2});
  absent.unit = 11;
  EXPECT_EQ(make_modbus_safety_inputs(absent, nullptr)->read().error().kind, FaultKind::kUnreachable);
}

TEST(ModbusSafetyInputs, AModuleThatComesBackIsReadAgainAndTheReadingHasItsAge) {
  VirtualClock clock;
  SafetyContacts contacts(devices(), clock);
  std::optional<ModbusDriveServer> server;
  server.emplace("127.0.0.1", 0, clock);
  server->add_io_module(kUnit, contacts);
  server->start();
  const int port = server->port();
  SafetyInputsChannel channel(make_modbus_safety_inputs(config_for(port, {9, 2, 5}), nullptr), clock);
  EXPECT_FALSE(channel.latest().valid);
  clock.sleep_s(1);
  channel.service();
  EXPECT_TRUE(channel.latest().valid);
  EXPECT_EQ(channel.latest().count, 3u);
  EXPECT_EQ(channel.latest().sampled_at_s, 1);
  EXPECT_TRUE(channel.latest().closed[1]);

  server.reset();  // the module loses its power
  clock.sleep_s(1);
  channel.service();
  EXPECT_EQ(channel.latest().sampled_at_s, 1) << "a failed reading publishes nothing";
  EXPECT_EQ(channel.health().faults, 1u);
  EXPECT_NE(channel.health().last_fault.find("safety inputs"), std::string::npos);

  server.emplace("127.0.0.1", port, clock);
  contacts.press("emergency stop");
  server->add_io_module(kUnit, contacts);
  server->start();
  clock.sleep_s(1);
  channel.service();
  EXPECT_EQ(channel.latest().sampled_at_s, 3);
  EXPECT_FALSE(channel.latest().closed[1]);
  EXPECT_EQ(channel.health().readings, 3u);
}

TEST(ModbusSafetyInputs, TheExampleOfTheSpecificationIsUnderstood) {
  // Modbus Application Protocol V1.1b3, 6.2: inputs 197 to 218 are read (PDU address C4h, 22 inputs); AC DB
  // 35 is the answer.
  const int listener = socket(AF_INET, SOCK_STREAM, 0);
  sockaddr_in address{};
  address.sin_family = AF_INET;
  address.sin_addr.s_addr = htonl(INADDR_LOOPBACK);
  socklen_t size = sizeof address;
  ASSERT_EQ(bind(listener, reinterpret_cast<sockaddr*>(&address), size), 0);
  ASSERT_EQ(listen(listener, 1), 0);
  getsockname(listener, reinterpret_cast<sockaddr*>(&address), &size);
  std::vector<uint8_t> asked(12);
  std::thread module([&] {
    const int client = accept(listener, nullptr, nullptr);
    (void)!recv(client, asked.data(), asked.size(), MSG_WAITALL);
    const std::vector<uint8_t> answer{asked[0], asked[1], 0, 0, 0, 6, kUnit, 0x02, 0x03, 0xAC, 0xDB, 0x35};
    (void)!send(client, answer.data(), answer.size(), MSG_NOSIGNAL);
    ::close(client);
  });
  std::vector<int> channels;
  for (int channel = 196; channel <= 217; ++channel) channels.push_back(channel);
  const auto levels =
      make_modbus_safety_inputs(config_for(ntohs(address.sin_port), channels), nullptr)->read();
  module.join();
  ::close(listener);
  EXPECT_EQ(std::vector<uint8_t>(asked.begin() + 6, asked.end()),
            std::vector<uint8_t>({kUnit, 0x02, 0x00, 0xC4, 0x00, 0x16}));
  ASSERT_TRUE(levels) << levels.error().text();
  std::string text;
  for (const bool level : *levels) text += level ? '1' : '0';
  EXPECT_EQ(text, "0011010111011011101011");
}

TEST(ModbusSafetyInputs, ConfigurationsThatCannotBeRightAreRefused) {
  const auto refused = [](auto edit, const std::string& part) {
    ModbusSafetyInputsConfig config = config_for(502, {1, 2});
    edit(config);
    expect_input_error([&] { make_modbus_safety_inputs(config, nullptr); }, {part});
  };
  refused([](auto& c) { c.host = ""; }, "host");
  refused([](auto& c) { c.port = 0; }, "port 0");
  refused([](auto& c) { c.unit = 248; }, "unit 248");
  refused([](auto& c) { c.channels = {}; }, "channels");
  refused([](auto& c) { c.channels = std::vector<int>(33, 1); }, "33");
  refused([](auto& c) { c.channels = {-1}; }, "channel -1");
  refused([](auto& c) { c.channels = {0, 2000}; }, "too far apart");
  refused([](auto& c) { c.response_timeout_s = 0; }, "timeout");
}

/// Inputs that deliver what a test says.
class ScriptedInputs final : public SafetyInputs {
 public:
  const std::string& device() const override { return device_; }
  Result<std::vector<bool>> read() override { return std::vector<bool>(count, true); }
  size_t count = 2;

 private:
  std::string device_ = "scripted";
};

TEST(SafetyInputsChannel, MoreChannelsThanFitAreAFaultNotAnOverrun) {
  VirtualClock clock;
  auto inputs = std::make_unique<ScriptedInputs>();
  ScriptedInputs& script = *inputs;
  SafetyInputsChannel channel(std::move(inputs), clock);
  script.count = SafetyInputsSnapshot::kMaxChannels + 1;
  channel.service();
  EXPECT_FALSE(channel.latest().valid);
  EXPECT_EQ(channel.health().faults, 1u);
  script.count = SafetyInputsSnapshot::kMaxChannels;
  channel.service();
  EXPECT_EQ(channel.latest().count, SafetyInputsSnapshot::kMaxChannels);
}

TEST(SafetyInputsChannel, ReadersOnOtherThreadsSeeWholeReadings) {
  // Levels alternate all together: a torn copy would show both.
  class Alternating final : public SafetyInputs {
   public:
    const std::string& device() const override { return device_; }
    Result<std::vector<bool>> read() override { return std::vector<bool>(32, on_ = !on_); }

   private:
    std::string device_ = "alternating";
    bool on_ = false;
  };
  SteadyClock clock;
  SafetyInputsChannel channel(std::make_unique<Alternating>(), clock);
  std::jthread writer([&channel](const std::stop_token& stop) {
    while (!stop.stop_requested()) channel.service();
  });
  size_t torn = 0, backwards = 0;
  double last_s = 0;
  while (channel.health().readings < 5000) {
    const SafetyInputsSnapshot seen = channel.latest();
    for (size_t c = 1; c < seen.count; ++c) torn += seen.closed[c] != seen.closed[0];
    backwards += seen.sampled_at_s < last_s;
    last_s = seen.sampled_at_s;
  }
  EXPECT_EQ(torn, 0u);
  EXPECT_EQ(backwards, 0u);
}

}  // namespace
}  // namespace gantry
