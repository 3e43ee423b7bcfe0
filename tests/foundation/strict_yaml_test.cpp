#include "gantry/foundation/strict_yaml.h"

#include <gtest/gtest.h>

#include <functional>
#include <numbers>

#include "foundation/expect_input_error.h"
#include "foundation/temporary_folder.h"

namespace gantry {
namespace {

using Read = std::function<void(StrictYaml&)>;

void expect_error(const std::string& text, const Read& read, const std::vector<std::string>& parts) {
  SCOPED_TRACE(text);
  expect_input_error(
      [&] {
        StrictYaml yaml = StrictYaml::parse(text, "cell.yaml");
        read(yaml);
      },
      parts);
}

const Read kNothing = [](StrictYaml&) {};

TEST(StrictYaml, ReadsEveryKindOfValue) {
  StrictYaml yaml = StrictYaml::parse(
      "speed_mm_s: 12.5\ncount: 3\non: true\nname: rotary stage\nmode: fast\ntilt_deg: 90\n"
      "axis: [0, -1, 2.5]\nrange: [-3, 4]\nlist: [1, 2, 3, 4]\ndrive: {unit: 7}\njoints: [{a: 1}, {a: 2}]\n",
      "cell.yaml");
  EXPECT_EQ(yaml.number("speed_mm_s", {0, 12.5}), 12.5);  // ends of the range are included
  EXPECT_EQ(yaml.integer("count", 3, 3), 3);
  EXPECT_TRUE(yaml.boolean_or("on", false));
  EXPECT_EQ(yaml.text("name"), "rotary stage");
  EXPECT_EQ(yaml.choice("mode", {"slow", "fast"}), "fast");
  EXPECT_DOUBLE_EQ(yaml.angle_deg("tilt_deg", {0, 90}), std::numbers::pi / 2);  // the range is in degrees
  EXPECT_EQ(yaml.vector3("axis"), Eigen::Vector3d(0, -1, 2.5));
  EXPECT_EQ(yaml.interval("range"), Eigen::Vector2d(-3, 4));
  EXPECT_EQ(yaml.numbers("list"), (std::vector<double>{1, 2, 3, 4}));
  StrictYaml drive = yaml.map("drive");
  EXPECT_EQ(drive.integer("unit", 1, 247), 7);
  std::vector<StrictYaml> joints = yaml.maps("joints", 2);
  ASSERT_EQ(joints.size(), 2u);
  EXPECT_EQ(joints[0].number("a"), 1);
  EXPECT_EQ(joints[1].number("a"), 2);
  EXPECT_NO_THROW(yaml.finish());
}

TEST(StrictYaml, FallbacksServeOnlyWhereTheKeyIsAbsent) {
  StrictYaml yaml = StrictYaml::parse("a: 1\nb: text\n", "cell.yaml");
  EXPECT_EQ(yaml.number_or("absent", 5), 5);
  EXPECT_EQ(yaml.number_or("a", 5), 1);
  EXPECT_EQ(yaml.integer_or("absent", 6, 0, 9), 6);
  EXPECT_EQ(yaml.integer_or("a", 6, 0, 9), 1);
  EXPECT_EQ(yaml.text_or("absent", "x"), "x");
  EXPECT_EQ(yaml.text_or("b", "x"), "text");
  EXPECT_TRUE(yaml.boolean_or("absent", true));
  EXPECT_DOUBLE_EQ(yaml.angle_deg_or("absent_deg", 180), std::numbers::pi);
  EXPECT_EQ(yaml.vector3_or("absent", {1, 2, 3}), Eigen::Vector3d(1, 2, 3));
  EXPECT_FALSE(yaml.map_if_present("absent").has_value());
  // A key that is present but wrong is never replaced by the fallback.
  expect_error("a: fast", [](auto& y) { y.number_or("a", 5); }, {"cell.yaml:1:", "a", "'fast'"});
  expect_error("a:", [](auto& y) { y.number_or("a", 5); }, {"cell.yaml:1:", "a"});
  expect_error("a: 7", [](auto& y) { y.map_if_present("a"); }, {"cell.yaml:1:", "a", "mapping"});
}

TEST(StrictYaml, MissingKeyIsNamed) {
  expect_error("b: 1", [](auto& y) { y.number("speed_mm_s"); }, {"cell.yaml:1:", "speed_mm_s", "missing"});
  expect_error("b: 1\ndrive:\n  unit: 1\n", [](auto& y) { y.map("drive").text("port"); },
               {"cell.yaml:3:", "drive", "port", "missing"});
  expect_error("axes:\n  - a: 1\n  - b: 1\n", [](auto& y) { y.maps("axes")[1].number("a"); },
               {"cell.yaml:3:", "axes[1]", "'a'"});
}

TEST(StrictYaml, UnknownKeyIsNamedWithItsLineAndWhatIsKnown) {
  const Read read = [](auto& y) {
    y.number("speed");
    y.leave_to_others("sensor");
    y.finish();
  };
  expect_error("speed: 1\nsensor: {x: 1}\nsped: 2\n", read, {"cell.yaml:3:", "sped", "unknown", "speed"});
  StrictYaml clean = StrictYaml::parse("speed: 1\nsensor: {x: 1}\n", "cell.yaml");
  EXPECT_NO_THROW(read(clean));
}

TEST(StrictYaml, KeyGivenTwiceIsAnErrorAtAnyDepth) {
  expect_error("a: 1\nb: 2\na: 3\n", kNothing, {"cell.yaml:", "a", "twice"});
  expect_error("d:\n  a: 1\n  a: 3\n", [](auto& y) { y.map("d"); }, {"cell.yaml:", "d.a", "twice"});
}

TEST(StrictYaml, WrongTypeTellsWhatWasFound) {
  expect_error("x: 1\na: fast", [](auto& y) { y.number("a"); }, {"cell.yaml:2:", "a:", "number", "'fast'"});
  expect_error("a: 5 mm", [](auto& y) { y.number("a"); }, {"cell.yaml:1:", "a:", "'5 mm'"});
  expect_error("a: [1]", [](auto& y) { y.number("a"); }, {"cell.yaml:1:", "a:", "list"});
  expect_error("a: {b: 1}", [](auto& y) { y.number("a"); }, {"cell.yaml:1:", "a:", "mapping"});
  expect_error("a: 1.5", [](auto& y) { y.integer("a", 0, 9); }, {"cell.yaml:1:", "a:", "whole", "1.5"});
  expect_error("a: maybe", [](auto& y) { y.boolean_or("a", true); }, {"cell.yaml:1:", "a:", "'maybe'"});
  expect_error("a: [1]", [](auto& y) { y.text("a"); }, {"cell.yaml:1:", "a:", "text"});
  expect_error("a: ''", [](auto& y) { y.text("a"); }, {"cell.yaml:1:", "a:", "text"});
  expect_error("a: 1", [](auto& y) { y.map("a"); }, {"cell.yaml:1:", "a:", "mapping"});
  expect_error("a: 1", [](auto& y) { y.maps("a"); }, {"cell.yaml:1:", "a:", "list"});
  expect_error("a: [1]", [](auto& y) { y.maps("a"); }, {"cell.yaml:1:", "a:", "entry 0", "mapping"});
  expect_error("a: []", [](auto& y) { y.maps("a"); }, {"cell.yaml:1:", "a:", "at least 1"});
  expect_error("a: 1", [](auto& y) { y.numbers("a"); }, {"cell.yaml:1:", "a:", "list"});
  expect_error("a: [1, x, 3]", [](auto& y) { y.vector3("a"); }, {"cell.yaml:1:", "a:", "'x'"});
  expect_error("[a, b]: 1", kNothing, {"cell.yaml:1:", "key"});
}

TEST(StrictYaml, OutOfRangeTellsTheRange) {
  const Read read = [](auto& y) { y.number("a", {0, 10}); };
  expect_error("a: 10.001", read, {"cell.yaml:1:", "a:", "from 0 to 10", "10.001"});
  expect_error("a: -0.1", read, {"cell.yaml:1:", "a:", "from 0 to 10", "-0.1"});
  expect_error("a: 248", [](auto& y) { y.integer("a", 1, 247); }, {"cell.yaml:1:", "a:", "247", "248"});
  expect_error("a_deg: 91",
               [](auto& y) {
                 y.angle_deg("a_deg", {0, 90});
               },
               {"cell.yaml:1:", "a_deg:", "90", "91"});
}

TEST(StrictYaml, NumbersThatAreNotFiniteAreRefused) {
  for (const char* value : {".nan", ".inf", "-.inf", "nan", "inf", "1e999"}) {
    expect_error(std::string("a: ") + value, [](auto& y) { y.number("a"); },
                 {"cell.yaml:1:", "a:", "number"});
    expect_error(std::string("a: [0, 0, ") + value + "]", [](auto& y) { y.vector3("a"); },
                 {"cell.yaml:1:", "a:", "number"});
  }
}

TEST(StrictYaml, ListsMustHaveTheRightLengthAndIntervalsTheRightOrder) {
  expect_error("a: [1, 2]", [](auto& y) { y.vector3("a"); }, {"cell.yaml:1:", "a:", "three", "2"});
  expect_error("a: [1, 2, 3, 4]", [](auto& y) { y.vector3("a"); }, {"cell.yaml:1:", "a:", "three", "4"});
  expect_error("a: [1]", [](auto& y) { y.interval("a"); }, {"cell.yaml:1:", "a:", "two", "1"});
  expect_error("a: [4, -3]", [](auto& y) { y.interval("a"); },
               {"cell.yaml:1:", "a:", "lower < upper", "[4, -3]"});
  expect_error("a: [4, 4]", [](auto& y) { y.interval("a"); }, {"cell.yaml:1:", "a:", "lower < upper"});
}

TEST(StrictYaml, ChoiceListsWhatIsAllowed) {
  expect_error("a: medium",
               [](auto& y) {
                 y.choice("a", {"slow", "fast"});
               },
               {"cell.yaml:1:", "a:", "slow, fast", "'medium'"});
}

TEST(StrictYaml, TextThatIsNotOneYamlMappingIsRefused) {
  expect_error("", kNothing, {"cell.yaml", "mapping"});
  expect_error("# only a comment\n", kNothing, {"cell.yaml", "mapping"});
  expect_error("just words", kNothing, {"cell.yaml", "mapping", "'just words'"});
  expect_error("- 1\n- 2\n", kNothing, {"cell.yaml", "mapping", "a list of 2"});
  expect_error("a: 1\nb: [1, 2\n", kNothing, {"cell.yaml:", "YAML"});
  expect_error("a: 1\n b: 2\n", kNothing, {"cell.yaml:2:", "YAML"});
  expect_error("a: 1\n---\nb: 2\n", kNothing, {"cell.yaml:2:", "one"});
  // yaml-cpp never gets past these.
  expect_error(",", kNothing, {"cell.yaml:1:", "YAML"});
  expect_error("# a comment\n, b\na: 1\n", kNothing, {"cell.yaml:", "YAML"});
  expect_error(std::string("\x89PNG\r\n\x1a\n\0\0\0\rIHDR", 16), kNothing, {"cell.yaml"});
}

TEST(StrictYaml, FilesThatCannotBeReadAreNamed) {
  const TemporaryFolder folder;
  std::filesystem::create_directory(folder / "directory.yaml");
  expect_input_error([&] { StrictYaml::load(folder / "absent.yaml"); }, {(folder / "absent.yaml").string()});
  expect_input_error([&] { StrictYaml::load(folder / "directory.yaml"); },
                     {(folder / "directory.yaml").string()});
  const auto empty = folder.write("empty.yaml", "");
  expect_input_error([&] { StrictYaml::load(empty); }, {empty.string(), "mapping"});
  const auto file = folder.write("cell.yaml", "a: 1\nb: 2\n");
  expect_input_error([&] { StrictYaml::load(file).map("b"); }, {file.string() + ":2:", "b"});
}

TEST(StrictYaml, RelativePathsStartAtTheFile) {
  const TemporaryFolder folder;
  StrictYaml yaml =
      StrictYaml::load(folder.write("cell.yaml", "a: parts/x.stl\nb: ../y.stl\nc: /abs/z.stl\n"));
  EXPECT_EQ(yaml.path("a"), folder / "parts/x.stl");
  EXPECT_EQ(yaml.path("b"), folder.path().parent_path() / "y.stl");
  EXPECT_EQ(yaml.path("c"), "/abs/z.stl");
}

}  // namespace
}  // namespace gantry
