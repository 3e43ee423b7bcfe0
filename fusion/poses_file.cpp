#include "gantry/fusion/poses_file.h"

#include <cctype>
#include <cmath>
#include <cstdio>
#include <fstream>
#include <sstream>

#include "gantry/foundation/error.h"

namespace gantry {
namespace {

/// For a message: one line of it, whatever was in the file.
std::string shown(std::string text) {
  constexpr size_t kLongest = 60;
  for (char& c : text)
    if (!std::isprint(static_cast<unsigned char>(c))) c = c == '\t' ? ' ' : '?';
  return "'" + (text.size() > kLongest ? text.substr(0, kLongest) + "..." : text) + "'";
}

}  // namespace

std::vector<Pose> read_poses(const std::filesystem::path& path, size_t expected, double unit_mm) {
  std::ifstream file(path);
  if (!file || std::filesystem::is_directory(path))
    throw InputError(path.string() + ": cannot be opened for reading");
  std::vector<Pose> poses;
  Eigen::Matrix4d matrix;
  int row = 0, line_number = 0;
  const auto fail = [&](const std::string& message) {
    throw InputError(path.string() + ":" + std::to_string(line_number) + ": " + message);
  };
  for (std::string line; std::getline(file, line);) {
    ++line_number;
    line = line.substr(0, line.find('#'));
    if (line.find_first_not_of(" \t\r") == std::string::npos) continue;
    std::istringstream numbers(line);
    for (int column = 0; column < 4; ++column)
      if (!(numbers >> matrix(row, column)) || !std::isfinite(matrix(row, column)))
        fail("expected four finite numbers, found " + shown(line));
    std::string rest;
    if (numbers >> rest) fail("expected four numbers only, found also " + shown(rest));
    if (++row < 4) continue;
    row = 0;
    const Eigen::Matrix3d r = matrix.topLeftCorner<3, 3>();
    if ((r * r.transpose() - Eigen::Matrix3d::Identity()).norm() > 1e-3 || r.determinant() < 0)
      fail("this 4x4 is not rigid: its upper left 3x3 is not a rotation");
    if ((matrix.row(3) - Eigen::RowVector4d(0, 0, 0, 1)).norm() > 1e-9)
      fail("expected '0 0 0 1' as the fourth row");
    Pose pose = Pose::Identity();
    pose.linear() = Eigen::Quaterniond(r).normalized().toRotationMatrix();
    pose.translation() = unit_mm * matrix.topRightCorner<3, 1>();
    poses.push_back(pose);
  }
  if (row != 0) fail("the file ends in the middle of a pose");
  if (poses.size() != expected)
    throw InputError(path.string() + ": holds " + std::to_string(poses.size()) + " poses, but there are " +
                     std::to_string(expected) + " scans");
  return poses;
}

void write_poses(const std::filesystem::path& path, const std::vector<Pose>& poses) {
  std::ofstream file(path);
  file << "# world_from_scan, row-major 4x4, mm; one block for each scan\n";
  char text[128];
  for (const Pose& pose : poses) {
    for (int row = 0; row < 4; ++row) {
      std::snprintf(text, sizeof text, "%.17g %.17g %.17g %.17g\n", pose(row, 0), pose(row, 1), pose(row, 2),
                    pose(row, 3));
      file << text;
    }
    file << "\n";
  }
  if (!file.flush()) throw InputError(path.string() + ": cannot be written");
}

}  // namespace gantry
