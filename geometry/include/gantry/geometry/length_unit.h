#pragma once

#include <Eigen/Core>
#include <string>
#include <vector>

namespace gantry {

/// The units of length that files come in: "mm", "cm", "m", "inch".
const std::vector<std::string>& length_units();
/// One of them in mm: 25.4 for "inch". Throws InputError for any other name.
double millimetres_in(const std::string& unit);

/// How large a file's content is, read in the unit that was stated for it: what a mistaken unit shows in.
struct SizedFile {
  std::string name;         ///< As messages call it: "bracket.stl".
  Eigen::Vector3f size_mm;  ///< Of its bounding box, after conversion from `unit`.
  std::string unit = "mm";  ///< The stated one.
  std::string option;       ///< That states it: "--reference-unit". Empty: the file must be in mm.
};

/// The size of the box that holds 99 % of the points along each axis: a few strays do not count.
Eigen::Vector3f bulk_size(const std::vector<Eigen::Vector3f>& points);

/// A question, in words that end in advice, when the whole is less than 2 mm or more than 20 m across:
/// "bracket.stl is 0.12 x 0.08 x 0.06 mm: is it in metres? then give --reference-unit m". Empty: the size is
/// plausible.
std::string questioned_size(const SizedFile& file);

/// How many times as large `a` is as `b`, by the diagonals of their boxes.
double size_ratio(const SizedFile& a, const SizedFile& b);

/// Says that `a` and `b`, which should show the same part, differ in size by more than `factor` either way,
/// and which other unit of one of them would make them alike. Empty: they do not.
std::string questioned_sizes(const SizedFile& a, const SizedFile& b, double factor);

}  // namespace gantry
