#include "gantry/geometry/length_unit.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <cstdio>

#include "gantry/foundation/error.h"

namespace gantry {
namespace {

struct Unit {
  const char *name, *plural;
  double mm;
};
/// The likeliest mistakes first.
constexpr std::array<Unit, 4> kUnits{
    {{"m", "metres", 1000}, {"mm", "millimetres", 1}, {"inch", "inches", 25.4}, {"cm", "centimetres", 10}}};

constexpr double kLeastAcross_mm = 2, kMostAcross_mm = 20'000;
constexpr double kAlike = 1.6;  ///< Boxes about a part turned by any angle differ by no more than sqrt(3).

bool plausible(double across_mm) {
  return across_mm >= kLeastAcross_mm && across_mm <= kMostAcross_mm;
}

std::string size_text(const Eigen::Vector3f& size_mm) {
  char text[100];
  std::snprintf(text, sizeof text, "%.3g x %.3g x %.3g mm", static_cast<double>(size_mm.x()),
                static_cast<double>(size_mm.y()), static_cast<double>(size_mm.z()));
  return text;
}

std::string advice(const SizedFile& file, const Unit& unit) {
  const std::string question = "is " + file.name + " in " + unit.plural + "? ";
  if (file.option.empty()) return question + "It is read in mm: export it anew";
  return question + "Then give " + file.option + " " + unit.name;
}

}  // namespace

const std::vector<std::string>& length_units() {
  static const std::vector<std::string> names{"mm", "cm", "m", "inch"};
  return names;
}

double millimetres_in(const std::string& unit) {
  for (const Unit& u : kUnits)
    if (unit == u.name) return u.mm;
  throw InputError("'" + unit + "' is no unit of length: mm, cm, m or inch is expected");
}

Eigen::Vector3f bulk_size(const std::vector<Eigen::Vector3f>& points) {
  Eigen::Vector3f size = Eigen::Vector3f::Zero();
  if (points.empty()) return size;
  constexpr size_t kEnough = 200'000;
  const size_t step = 1 + points.size() / kEnough;
  std::vector<float> values;
  for (int axis = 0; axis < 3; ++axis) {
    values.clear();
    for (size_t i = 0; i < points.size(); i += step) values.push_back(points[i][axis]);
    const auto left_out = static_cast<std::ptrdiff_t>(values.size() / 200);
    const auto low = values.begin() + left_out, high = values.end() - 1 - left_out;
    std::nth_element(values.begin(), low, values.end());
    const float least = *low;
    std::nth_element(values.begin(), high, values.end());
    size[axis] = *high - least;
  }
  return size;
}

std::string questioned_size(const SizedFile& file) {
  const double across_mm = file.size_mm.norm();
  if (plausible(across_mm)) return {};
  const std::string is = file.name + " is " + size_text(file.size_mm) + ": ";
  for (const Unit& unit : kUnits)
    if (unit.name != file.unit && plausible(across_mm / millimetres_in(file.unit) * unit.mm))
      return is + advice(file, unit);
  return is + "is that its true size?";
}

double size_ratio(const SizedFile& a, const SizedFile& b) {
  return static_cast<double>(a.size_mm.norm()) / static_cast<double>(b.size_mm.norm());
}

std::string questioned_sizes(const SizedFile& a, const SizedFile& b, double factor) {
  const double ratio = size_ratio(a, b);
  if (ratio <= factor && ratio >= 1 / factor) return {};
  char text[80];
  std::snprintf(text, sizeof text, " is about %.3g times as large as ", ratio > 1 ? ratio : 1 / ratio);
  const SizedFile &large = ratio > 1 ? a : b, &small = ratio > 1 ? b : a;
  std::string words = large.name + " (" + size_text(large.size_mm) + ")" + text + small.name + " (" +
                      size_text(small.size_mm) + ")";
  // One of the two in another unit: the change that leaves both at a plausible size and makes them alike.
  for (const Unit& unit : kUnits)
    for (const SizedFile* file : {&small, &large}) {
      const SizedFile& other = file == &small ? large : small;
      if (file->option.empty() || file->unit == unit.name) continue;
      const double across_mm = file->size_mm.norm() / millimetres_in(file->unit) * unit.mm;
      const double then = across_mm / static_cast<double>(other.size_mm.norm());
      if (plausible(across_mm) && plausible(other.size_mm.norm()) && then < kAlike && then > 1 / kAlike)
        return words + ": " + advice(*file, unit);
    }
  return words + ": do they show the same part, in the units that were given?";
}

}  // namespace gantry
