// POSES.txt.

#include <sstream>

#include "fuzz.h"
#include "gantry/fusion/poses_file.h"

std::vector<std::string> gantry::fuzz::seeds() {
  const std::vector<Pose> poses = {Pose::Identity(), pose_from_position_rpy({1, -2e3, 3.5}, {0.5, -1, 3})};
  const TemporaryFolder folder;
  write_poses(folder / "poses.txt", poses);
  return {TemporaryFolder::read(folder / "poses.txt"),
          "# by hand\r\n\n1 0 0 0  # a comment\n\t0 1 0 0\n0 0 1 1e3\n0 0 0 1\n-1 0 0 0\n0 -1 0 0\n0 0 1 "
          ".5\n0 0 0 1"};
}

int LLVMFuzzerTestOneInput(const uint8_t* data, size_t size) {
  using namespace gantry;
  static const fuzz::InputFile file("poses.txt");
  const auto& path = file.write(fuzz::text_of(data, size));
  fuzz::value_or_input_error([&] {
    for (const Pose& pose : read_poses(path, 2))
      if (!pose.matrix().allFinite() || std::abs(pose.linear().determinant() - 1) > 1e-6)
        throw std::logic_error("a pose that is not rigid");
  });
  return 0;
}
