#include "free_space_check.h"

#include <algorithm>
#include <cmath>
#include <string>

#include "joint/judgement.h"
#include "joint/words.h"

namespace gantry::internal {
namespace {

/// As in method "joint": right results stay below a tenth of it.
constexpr double kWorstViolation = 0.01;
/// Fewer pixels say nothing of a fraction.
constexpr size_t kLeastTested = 100;

double median(std::vector<double> values) {
  if (values.empty()) return 0;
  const auto middle = values.begin() + static_cast<std::ptrdiff_t>(values.size() / 2);
  std::nth_element(values.begin(), middle, values.end());
  return *middle;
}

}  // namespace

void check_free_space(std::span<const RangeSurface> scans, Registration& registration) {
  if (scans.size() < 2) return;
  JointProblem problem;
  problem.scans = scans;
  std::vector<double> noise, spacing, residuals;
  Poses poses;
  for (size_t i = 0; i < scans.size(); ++i) {
    noise.push_back(scans[i].noise_mm);
    spacing.push_back(scans[i].spacing_mm);
    poses.push_back(registration.part_from_sensor[i].mean * scans[i].sensor_from_grid);
  }
  problem.noise_mm = median(noise);
  problem.spacing_mm = median(spacing);
  for (const PairReport& pair : registration.pairs)
    if (pair.kept) residuals.push_back(pair.rms_mm);
  const Evidence evidence = gather_evidence(problem, poses, median(residuals));

  std::string violating;
  for (size_t i = 0; i < scans.size(); ++i) {
    const Agreement& a = evidence.scans[i].agreement;
    const size_t on_data = a.tested - a.background;
    ScanReport report;
    report.rms_mm = a.matched > 0 ? std::sqrt(a.squares / static_cast<double>(a.matched)) : 0;
    report.matches = a.matched;
    report.free_space_violation =
        static_cast<double>(a.in_front) / static_cast<double>(std::max<size_t>(1, on_data));
    report.opposite_contact =
        static_cast<double>(a.contact) / static_cast<double>(std::max<size_t>(1, on_data));
    report.connected = evidence.scans[i].connected;
    if (on_data >= kLeastTested && evidence.scans[i].violation > kWorstViolation)
      violating += (violating.empty() ? "" : ", ") + scans[i].name;
    registration.scans.push_back(report);
  }
  if (registration.reason.empty() && !violating.empty())
    registration.reason = text("surface lies where another scan looked through, up to %.1f %% of a scan: ",
                               100 * evidence.worst_violation) +
                          violating;
}

}  // namespace gantry::internal
