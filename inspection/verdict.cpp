#include "verdict.h"

#include <algorithm>
#include <cstdio>

namespace gantry {
namespace {

constexpr double kLeastFit = 0.3;  ///< A fit to fewer of the points than this is no alignment.

template <typename... Values>
std::string text(const char* format, Values... values) {
  char buffer[240];
  std::snprintf(buffer, sizeof buffer, format, values...);
  return buffer;
}

/// "1 region is", "3 regions are".
std::string regions_are(size_t count) {
  return std::to_string(count) + (count == 1 ? " region is" : " regions are");
}

/// What a PASS does not speak of.
std::string unseen_words(const InspectionResult& result) {
  if (result.unseen.empty()) return "";
  const UnjudgedRegion& largest = result.unseen.front();
  return text(" Not seen, and not judged: %.0f mm², the largest piece %.0f mm² of ", result.unseen_mm2,
              largest.area_mm2) +
         largest.face + ".";
}

struct Decision {
  Verdict verdict;
  std::string reason;
};

Decision decision_on(const InspectionResult& result, const InspectionOptions& options) {
  const AlignmentResult& alignment = result.alignment;
  const double tolerance = options.tolerance_mm;
  const auto count = [&](const auto& wanted) {
    return static_cast<size_t>(std::count_if(result.defects.begin(), result.defects.end(), wanted));
  };
  const size_t certain = count([](const Defect& d) { return d.certain; });
  const auto is_residue = [](const Defect& d) { return d.kind == DefectClass::kRegistrationResidue; };
  if (!result.doubt.empty())
    return {Verdict::kUndecided, "The cloud is not to be relied on: " + result.doubt + "."};
  if (options.align && !alignment.converged && alignment.inlier_fraction < kLeastFit)
    return {Verdict::kUndecided,
            "The alignment to the CAD model failed: is the cloud of this part, in this frame and unit?"};
  if (certain > 0) {
    const auto largest =
        std::find_if(result.defects.begin(), result.defects.end(), [](const Defect& d) { return d.certain; });
    return {Verdict::kFail,
            regions_are(certain) + text(" out of tolerance (±%.3f mm); the largest deviates by %+.3f mm.",
                                        tolerance, largest->peak_mm)};
  }
  if (options.align && !alignment.converged)
    return {Verdict::kUndecided,
            "The alignment to the CAD model is not to be relied on: " + alignment.status + "."};
  if (result.statistics.count == 0)
    return {Verdict::kUndecided,
            "No point could be judged: none lies near the CAD surface, or all are too few."};
  if (result.coverage < options.min_coverage)
    return {Verdict::kUndecided,
            text("Only %.0f %% of the CAD surface was seen; at least %.0f %% is asked for.",
                 100 * result.coverage, 100 * options.min_coverage)};
  const auto residue = std::find_if(result.defects.begin(), result.defects.end(), is_residue);
  if (residue != result.defects.end())
    return {Verdict::kUndecided,
            regions_are(count(is_residue)) +
                " out of tolerance by how scans were registered, not by the part: " + residue->words + "."};
  if (!result.defects.empty())
    return {Verdict::kUndecided,
            regions_are(result.defects.size()) +
                text(" out of tolerance (±%.3f mm), but by less than the guard band.", tolerance)};
  if (!result.doubtful.empty())
    return {Verdict::kUndecided,
            regions_are(result.doubtful.size()) + text(" within the tolerance (±%.3f mm) by less than the "
                                                       "guard band; the largest deviates by %+.3f mm.",
                                                       tolerance, result.doubtful.front().peak_mm)};
  return {Verdict::kPass,
          text("All of the inspected surface (%.0f %% of the CAD surface) is within ±%.3f mm.",
               100 * result.coverage, tolerance) +
              unseen_words(result)};
}

}  // namespace

std::string_view to_string(Verdict verdict) {
  switch (verdict) {
    case Verdict::kPass:
      return "PASS";
    case Verdict::kFail:
      return "FAIL";
    case Verdict::kUndecided:
      return "UNDECIDED";
  }
  return "UNDECIDED";
}

void internal::decide(InspectionResult& result, const InspectionOptions& options) {
  Decision decision = decision_on(result, options);
  result.verdict = decision.verdict;
  result.reason = std::move(decision.reason);
}

}  // namespace gantry
