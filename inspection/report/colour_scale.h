#pragma once

#include <Eigen/Core>
#include <string>
#include <vector>

namespace gantry::report {

/// Deviation to colour: green at zero, over yellow to red where there is too much material, over cyan
/// to blue where some is missing. The hue turns at the tolerance (yellow, cyan); the ends are reached
/// at twice the tolerance. Interpolated in OKLab (Ottosson 2020), where equal steps look equal.
class ColourScale {
 public:
  explicit ColourScale(double tolerance_mm);

  double tolerance_mm() const { return tolerance_mm_; }
  double limit_mm() const { return 2 * tolerance_mm_; }
  /// sRGB, each channel 0..1. Beyond the limits the colour stays that of the end.
  const Eigen::Vector3f& operator()(double deviation_mm) const;

 private:
  double tolerance_mm_;
  std::vector<Eigen::Vector3f> table_;
};

/// "#rrggbb".
std::string hex(const Eigen::Vector3f& srgb);

/// Surface that nobody saw: hatched with the second.
inline const Eigen::Vector3f kUnseenColour(0.70f, 0.715f, 0.74f), kUnseenLineColour(0.53f, 0.545f, 0.57f);
/// Surface that was seen, where only that matters.
inline const Eigen::Vector3f kSeenColour(0.36f, 0.63f, 0.70f);

}  // namespace gantry::report
