#include "modbus/drive_profile.h"

#include <gtest/gtest.h>

#include "foundation/expect_input_error.h"
#include "foundation/temporary_folder.h"
#include "gantry/hal/drive_profile.h"
#include "hal/modbus_servers.h"

namespace gantry {
namespace {

std::string shipped(const std::string& name) {
  for (const EmbeddedProfile& profile : embedded_profiles())
    if (name == profile.name) return profile.text;
  return {};
}

TEST(DriveProfile, TheShippedOnesLoad) {
  EXPECT_EQ(shipped_drive_profiles(), (std::vector<std::string>{"iai_robo_cylinder", "kinco_fd",
                                                                "leadshine_cs2rs", "oriental_motor_az"}));
  for (const std::string& name : shipped_drive_profiles()) {
    const DriveProfileFacts facts = drive_profile_facts(name);
    EXPECT_FALSE(facts.model.empty());
    EXPECT_TRUE(facts.linear);
    EXPECT_EQ(facts.rotary, name != "iai_robo_cylinder");
    EXPECT_EQ(facts.counts_fixed, name == "iai_robo_cylinder");
    EXPECT_EQ(facts.counts_motor_revolutions, name == "leadshine_cs2rs");
    EXPECT_NE(shipped(name).find("\nsource:"), std::string::npos) << "where its numbers come from";
  }
}

TEST(DriveProfile, AnUnknownNameIsAnsweredWithTheList) {
  try {
    load_drive_profile("acme");
    ADD_FAILURE() << "accepted";
  } catch (const InputError& error) {
    EXPECT_NE(std::string(error.what()).find("'acme'; there is: iai_robo_cylinder, kinco_fd"),
              std::string::npos)
        << error.what();
  }
}

TEST(DriveProfile, OneThatIsBasedOnAnotherChangesWhatItSays) {
  const DriveProfile base = load_drive_profile("kinco_fd");
  const DriveProfile mine = parse_drive_profile(
      "based_on: kinco_fd\n"
      "model: Acme\n"
      "moves: linear\n"
      "word_order: BADC\n"
      "status: [{ first: 0x3700, count: 2 }, { first: 0x41, count: 1 }, { first: 0x3B00, count: 2 },\n"
      "         { first: 0x6D00, count: 2 }]\n"
      "registers: { status_word: { address: 0x41, type: u16 } }\n"
      "bits: { homed: { register: digital_inputs, bit: 17, active_low: true } }\n"
      "numbers: { standstill_speed: 5 }\n",
      "mine.yaml");
  EXPECT_EQ(mine.model, "Acme");
  EXPECT_EQ(mine.kind, base.kind);
  EXPECT_FALSE(mine.rotary);
  EXPECT_EQ(mine.word_order, WordOrder::kBADC);
  EXPECT_EQ(mine.status.size(), 4u);
  EXPECT_EQ(mine.reg("status_word").address, 0x41);
  EXPECT_EQ(mine.reg("target").address, base.reg("target").address);
  EXPECT_EQ(mine.bit("homed").word.address, 0x6D00);
  EXPECT_TRUE(mine.bit("homed").active_low);
  EXPECT_EQ(mine.number("standstill_speed"), 5);
  EXPECT_EQ(mine.number("speed_per_count_s"), 16.384);
}

TEST(DriveProfile, ABitFollowsItsRegisterWhenThatMoves) {
  const DriveProfile mine = parse_drive_profile(
      "based_on: leadshine_cs2rs\n"
      "status: [{ first: 0x2003, count: 1 }, { first: 0x602A, count: 5 }]\n"
      "registers: { status: { address: 0x2003, type: u16 } }\n",
      "mine.yaml");
  EXPECT_EQ(mine.bit("running").word.address, 0x2003);
}

struct ProfileMistake {
  const char *name, *base, *find, *replace, *expected;
};

class ProfileMistakes : public testing::TestWithParam<ProfileMistake> {};

TEST_P(ProfileMistakes, AreRefusedWithLineAndKey) {
  const ProfileMistake& mistake = GetParam();
  std::string text = shipped(mistake.base);
  const size_t at = text.find(mistake.find);
  ASSERT_NE(at, std::string::npos);
  text.replace(at, std::string(mistake.find).size(), mistake.replace);
  try {
    parse_drive_profile(text, "p.yaml");
    ADD_FAILURE() << "accepted";
  } catch (const InputError& error) {
    EXPECT_EQ(std::string(error.what()).rfind("p.yaml:", 0), 0u) << error.what();
    EXPECT_NE(std::string(error.what()).find(mistake.expected), std::string::npos) << error.what();
  }
}

INSTANTIATE_TEST_SUITE_P(
    All, ProfileMistakes,
    testing::Values(
        ProfileMistake{"NoModel", "kinco_fd", "model: Kinco FD", "#", "missing key 'model'"},
        ProfileMistake{"UnknownKind", "kinco_fd", "kind: cia402", "kind: cia403", "kind: expected"},
        ProfileMistake{"KindOfAnother", "kinco_fd", "kind: cia402", "kind: pr_path", "missing key 'status'"},
        ProfileMistake{"UnknownKey", "kinco_fd", "moves: both", "moves: both\ncolour: red", "colour"},
        ProfileMistake{"UnknownOrder", "kinco_fd", "word_order: CDAB", "word_order: ACBD", "word_order"},
        ProfileMistake{"MissingRegister", "kinco_fd", "  mode:  ", "  node:  ", "missing key 'mode'"},
        ProfileMistake{"UnknownRegister", "kinco_fd",
                       "  mode:  ", "  node: { address: 1, type: u16 }\n  mode:", "registers.node"},
        ProfileMistake{"AddressTooLarge", "kinco_fd", "0x3100", "0x13100", "registers.control_word.address"},
        ProfileMistake{"AddressOfLetters", "kinco_fd", "0x3100", "top", "registers.control_word.address"},
        ProfileMistake{"PairBehindTheEnd", "kinco_fd", "0x4000", "0xFFFF", "registers.target.address"},
        ProfileMistake{"UnknownType", "kinco_fd", "type: i16", "type: i8", "registers.mode.type"},
        ProfileMistake{"BitOfNoRegister", "kinco_fd", "register: status_word", "register: status",
                       "bits.homed.register: there is no register 'status'"},
        ProfileMistake{"BitBeyondItsRegister", "kinco_fd", "bit: 15", "bit: 16", "bits.homed.bit"},
        ProfileMistake{"BitOutsideTheRanges", "kinco_fd", "{ first: 0x6D00, count: 2 }",
                       "{ first: 0x6D00, count: 1 }", "status: the register of bit 'emergency_stop'"},
        ProfileMistake{"PositionOutsideTheRanges", "kinco_fd", "  - { first: 0x3700, count: 2 }\n", "",
                       "status: register 'position'"},
        ProfileMistake{"RangeTooLong", "iai_robo_cylinder", "count: 10", "count: 126", "status[0].count"},
        ProfileMistake{"BlockWithAHole", "oriental_motor_az", "0x005E", "0x0070",
                       "'speed' must follow directly on 'target'"},
        ProfileMistake{"NegativeNumber", "kinco_fd", "16.384", "-16.384", "numbers.speed_per_count_s"},
        ProfileMistake{"TimeoutWithoutUnit", "kinco_fd", "registers:\n",
                       "registers:\n  communication_timeout: { address: 1, type: u16 }\n",
                       "needs 'communication_timeout_unit_s'"},
        ProfileMistake{"BaseThatIsNotShipped", "kinco_fd", "model: Kinco FD", "based_on: acme", "based_on"},
        ProfileMistake{"BaseAndKind", "kinco_fd", "model: Kinco FD", "based_on: kinco_fd", "kind"}),
    [](const auto& p) { return p.param.name; });

TEST(DriveProfile, ACommunicationTimeoutIsWhereTheProfileSays) {
  const TemporaryFolder folder;
  const auto file = folder.write("mine.yaml",
                                 "based_on: iai_robo_cylinder\n"
                                 "registers: { communication_timeout: { address: 0x0A10, type: u32 } }\n"
                                 "numbers: { communication_timeout_unit_s: 0.001 }\n");
  RegisterServer server;
  VirtualClock clock;
  ModbusDriveConfig config;
  config.axis = "linear";
  config.profile = file.string();
  config.host = "127.0.0.1";
  config.port = server.port();
  const auto drive = make_modbus_drive(config, nullptr, clock);
  ASSERT_TRUE(drive->set_communication_timeout(70.0005));
  EXPECT_EQ(server.get(0x0A10), 1);
  EXPECT_EQ(server.get(0x0A11), 70001 - 65536) << "rounded up";
  ASSERT_TRUE(drive->set_communication_timeout(0));
  EXPECT_EQ(server.get(0x0A11), 0);
  EXPECT_FALSE(drive->set_communication_timeout(-1));
  EXPECT_FALSE(drive->set_communication_timeout(1e9));

  config.profile = "iai_robo_cylinder";
  const auto refused = make_modbus_drive(config, nullptr, clock)->set_communication_timeout(1);
  ASSERT_FALSE(refused);
  EXPECT_EQ(refused.error().kind, FaultKind::kRefused);
  EXPECT_NE(refused.error().message.find("has no communication time-out"), std::string::npos);
}

}  // namespace
}  // namespace gantry
