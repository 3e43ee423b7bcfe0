#include "pcd_tag.h"

#include <cmath>
#include <cstdlib>
#include <fstream>
#include <iomanip>
#include <sstream>
#include <vector>

#include "gantry/foundation/error.h"

namespace gantry::internal {
namespace {

constexpr const char* kCalibration = "calibration";
constexpr const char* kIndependent = "independent";
constexpr const char* kShared = "shared";

void write_line(std::ostream& out, const char* key, const Vector6d& numbers) {
  out << "# gantry " << key;
  for (const double number : numbers) out << ' ' << number;
  out << '\n';
}

/// Exactly `count` finite numbers, the rest of a line.
std::vector<double> numbers_of(std::istream& words, size_t count, const std::string& what) {
  std::vector<double> numbers;
  for (std::string word; words >> word;) {
    char* end = nullptr;
    numbers.push_back(std::strtod(word.c_str(), &end));
    if (*end != '\0' || !std::isfinite(numbers.back()))
      throw InputError(what + ": expected a number, found '" + word + "'");
  }
  if (numbers.size() != count)
    throw InputError(what + ": expected " + std::to_string(count) + " numbers, found " +
                     std::to_string(numbers.size()));
  return numbers;
}

}  // namespace

std::string pcd_tag_comments(const UncertainPose& pose) {
  std::ostringstream out;
  out << std::setprecision(17);
  if (!pose.calibration_id.empty()) out << "# gantry " << kCalibration << ' ' << pose.calibration_id << '\n';
  for (int row = 0; row < 6; ++row) write_line(out, kIndependent, pose.independent.row(row));
  for (const auto& column : pose.shared_factor.colwise()) write_line(out, kShared, column);
  return out.str();
}

bool read_pcd_tag(const std::filesystem::path& path, UncertainPose& pose) {
  std::ifstream file(path, std::ios::binary);
  std::vector<Vector6d> independent, shared;
  for (std::string line; std::getline(file, line);) {
    std::istringstream words(line);
    std::string word, key;
    words >> word;
    if (word == "DATA") break;
    if (word != "#" || !(words >> word >> key) || word != "gantry") continue;
    const std::string what = path.string() + ": comment '# gantry " + key + "'";
    if (key == kCalibration) {
      std::getline(words >> std::ws, pose.calibration_id);
    } else if (key == kIndependent || key == kShared) {
      const std::vector<double> v = numbers_of(words, 6, what);
      (key == kShared ? shared : independent).emplace_back(Eigen::Map<const Vector6d>(v.data()));
    }
  }
  if (independent.empty() && shared.empty()) return false;
  if (independent.size() != 6)
    throw InputError(path.string() +
                     ": comment '# gantry independent': expected the 6 rows of a covariance, found " +
                     std::to_string(independent.size()));
  for (int row = 0; row < 6; ++row) pose.independent.row(row) = independent[static_cast<size_t>(row)];
  pose.shared_factor.resize(6, static_cast<Eigen::Index>(shared.size()));
  for (size_t k = 0; k < shared.size(); ++k) pose.shared_factor.col(static_cast<Eigen::Index>(k)) = shared[k];
  return true;
}

}  // namespace gantry::internal
