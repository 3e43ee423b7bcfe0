#include "gantry/fusion/poses_file.h"

#include <gtest/gtest.h>

#include "foundation/expect_input_error.h"
#include "foundation/temporary_folder.h"

namespace gantry {
namespace {

const std::string kUnit = "1 0 0 0\n0 1 0 0\n0 0 1 0\n0 0 0 1\n";

TEST(PosesFile, ReadsWhatItWrote) {
  const TemporaryFolder folder;
  const std::vector<Pose> poses = {Pose::Identity(),
                                   pose_from_position_rpy({1.0 / 3, -2e-7, 512.125}, {0.1, -1.2, 3.0}),
                                   pose_from_position_rpy({-1e5, 1e-9, 0.1}, {-3.1, 0.7, -0.2})};
  write_poses(folder / "POSES.txt", poses);
  const std::vector<Pose> read = read_poses(folder / "POSES.txt", poses.size());
  ASSERT_EQ(read.size(), poses.size());
  for (size_t i = 0; i < poses.size(); ++i) {
    EXPECT_EQ(read[i].translation(), poses[i].translation());
    // Rotations are made orthonormal again: the last bits may differ.
    EXPECT_LT((read[i].linear() - poses[i].linear()).norm(), 1e-15 * 8);
  }
}

TEST(PosesFile, MetresAreBroughtToMillimetres) {
  const TemporaryFolder folder;
  const auto path = folder.write("m.txt", "0 -1 0 0.25\n1 0 0 -1.5\n0 0 1 2\n0 0 0 1\n");
  const Pose pose = read_poses(path, 1, 1000)[0];
  EXPECT_EQ(pose.translation(), Eigen::Vector3d(250, -1500, 2000));
  EXPECT_TRUE(pose.linear().isApprox(read_poses(path, 1)[0].linear(), 1e-15));
}

TEST(PosesFile, CommentsAndBlankLinesMayStandAnywhere) {
  const TemporaryFolder folder;
  const auto path =
      folder.write("p.txt", "# first\r\n\n1 0 0 5 # x\r\n\n0 1 0 6\n# between\n0 0 1 7\n  \t\n0 0 0 1");
  const std::vector<Pose> poses = read_poses(path, 1);
  ASSERT_EQ(poses.size(), 1u);
  EXPECT_EQ(poses[0].translation(), Eigen::Vector3d(5, 6, 7));
}

TEST(PosesFile, MistakesAreNamedWithTheirLine) {
  const TemporaryFolder folder;
  const auto expect_mistake = [&](const std::string& text, int line, const std::string& what) {
    const auto path = folder.write("p.txt", text);
    expect_input_error([&] { read_poses(path, 1); }, {"p.txt:" + std::to_string(line) + ":", what});
  };
  expect_mistake("1 0 0 0\n0 1 0\n0 0 1 0\n0 0 0 1\n", 2, "four finite numbers, found '0 1 0'");
  expect_mistake("# c\n\n1 0 0 x\n0 1 0 0\n0 0 1 0\n0 0 0 1\n", 3, "found '1 0 0 x'");
  expect_mistake("1 0 0 nan\n0 1 0 0\n0 0 1 0\n0 0 0 1\n", 1, "four finite numbers");
  expect_mistake("1 0 0 inf\n0 1 0 0\n0 0 1 0\n0 0 0 1\n", 1, "four finite numbers");
  expect_mistake(
      "\x7f"
      "ELF\x02 \xff\n",
      1, "found '?ELF? ?'");  // a message stays one line of text
  expect_mistake("1 0 0 0\n0 1 0 0\n0 0 1 0 9\n0 0 0 1\n", 3, "'9'");
  expect_mistake("1 0 0 0\n0 2 0 0\n0 0 1 0\n0 0 0 1\n", 4, "not a rotation");
  expect_mistake("1 0 0 0\n0 1 0 0\n0 0 -1 0\n0 0 0 1\n", 4, "not a rotation");
  expect_mistake("1 0 0 0\n0 1 0 0\n0 0 1 0\n0 0 0 2\n", 4, "'0 0 0 1'");
  expect_mistake("1 0 0 0\n0 1 0 0\n0 0 1 0\n", 3, "middle of a pose");
}

TEST(PosesFile, TheNumberOfPosesMustBeThatOfTheScans) {
  const TemporaryFolder folder;
  const auto path = folder.write("p.txt", kUnit + kUnit);
  EXPECT_EQ(read_poses(path, 2).size(), 2u);
  expect_input_error([&] { read_poses(path, 3); }, {"p.txt", "2 poses", "3 scans"});
  expect_input_error([&] { read_poses(path, 1); }, {"p.txt", "2 poses", "1 scans"});
}

TEST(PosesFile, MissingOrUnwritableFilesAreInputErrors) {
  const TemporaryFolder folder;
  expect_input_error([&] { read_poses(folder / "none.txt", 1); }, {"none.txt", "cannot be opened"});
  expect_input_error([&] { read_poses(folder.path(), 1); }, {"cannot be opened"});
  expect_input_error([&] { write_poses(folder / "no/where.txt", {}); }, {"where.txt", "cannot be written"});
}

}  // namespace
}  // namespace gantry
