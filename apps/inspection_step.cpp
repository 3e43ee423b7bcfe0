#include "inspection_step.h"

#include <algorithm>
#include <cmath>
#include <cstdio>

#include "gantry/foundation/error.h"

namespace gantry {
namespace {

void print_alignment(const AlignmentResult& a) {
  std::printf("  alignment  residual %.3f mm before, %.4f mm after best fit on %.1f %% of the points\n",
              a.rms_before_mm, a.rms_after_mm, 100 * a.inlier_fraction);
  if (a.masked_regions > 0)
    std::printf("             %d %s left out of it as no noise: %.1f %% of the points\n", a.masked_regions,
                a.masked_regions == 1 ? "region" : "regions", 100 * a.masked_fraction);
  for (const DatumFit& d : a.datums)
    std::printf("  datum %-4s %s; %zu points, rms %.4f mm; left: %.4f mm, %.4f degrees\n", d.name.c_str(),
                d.words.c_str(), d.points, d.rms_mm, d.offset_mm, d.tilt_deg);
  if (!a.free_motions.empty()) std::printf("  free       %s\n", a.free_text().c_str());
  if (!a.equivalents.empty()) std::printf("  symmetry   %s\n", a.symmetry_text().c_str());
}

void print_reference(const InspectionResult& result, size_t triangles) {
  std::printf("  reference  %zu triangles, %s\n", triangles, result.topology.text().c_str());
  if (result.beside_border > 0)
    std::printf("             %zu points lie beside its border and were not judged\n", result.beside_border);
}

std::string text_of(const Eigen::Vector3d& v) {
  char text[80];
  std::snprintf(text, sizeof text, "(%.2f, %.2f, %.2f)", v.x(), v.y(), v.z());
  return text;
}

void print_defects(const std::vector<Defect>& defects) {
  if (defects.empty()) return;
  std::printf(
      "\n  defect  class                    peak ± U (mm)     mean ± U (mm)  area (mm2)  extra, missing "
      "(mm3)  "
      "CAD face\n");
  for (const Defect& d : defects) {
    std::printf("  %6d  %-20s  %+8.3f ± %.3f  %+8.3f ± %.3f  %10.1f  %9.1f  %9.1f  %s\n", d.id,
                std::string(to_string(d.kind)).c_str(), d.peak_mm, d.uncertainty_mm, d.signed_mean_mm,
                d.mean_uncertainty_mm, d.area_mm2, d.extra_mm3, d.missing_mm3, d.face.c_str());
    std::printf("          %s; %s\n", d.words.c_str(), d.face_words.c_str());
    std::printf("          centre %s, extent %s mm%s\n", text_of(d.centre_mm).c_str(),
                text_of(d.extent_mm).c_str(), d.certain ? "" : ", not certain: within the guard band");
  }
}

void print_doubtful(const std::vector<Defect>& doubtful) {
  if (doubtful.empty()) return;
  std::printf(
      "\n  in doubt  within the tolerance as measured, but by less than the guard band:\n"
      "             peak ± U (mm)  area (mm2)  centre x, y, z (mm)            CAD face\n");
  for (const Defect& d : doubtful)
    std::printf("          %+8.3f ± %.3f  %10.1f  %-29s  %s\n", d.peak_mm, d.uncertainty_mm, d.area_mm2,
                text_of(d.centre_mm).c_str(), d.face.c_str());
}

/// What nothing is claimed about, so that a PASS cannot be read as more than it is.
void print_unjudged(const InspectionResult& result, const InspectionOptions& options) {
  constexpr size_t kMost = 8;
  const auto more = [&](size_t count) {
    if (count > kMost) std::printf("          and %zu more: report.json\n", count - kMost);
  };
  if (!result.unseen.empty()) {
    std::printf("\n  no data   %.0f mm2 of the CAD surface, of which in pieces of %.0f mm2 or more:\n",
                result.unseen_mm2, options.min_unseen_area_mm2);
    std::printf("          area (mm2)  %-27s  %-27s  CAD face\n", "centre x, y, z (mm)",
                "extent x, y, z (mm)");
    for (size_t i = 0; i < std::min(kMost, result.unseen.size()); ++i) {
      const UnjudgedRegion& u = result.unseen[i];
      std::printf("          %10.1f  %-27s  %-27s  %s, %.0f %% of it%s\n", u.area_mm2,
                  text_of(u.centre_mm).c_str(), text_of(u.extent_mm).c_str(), u.face.c_str(),
                  100 * u.face_share, u.behind_fixture ? ", at the fixture" : "");
    }
    more(result.unseen.size());
  }
  if (!result.fixture_regions.empty()) {
    std::printf("\n  fixture   not judged:\n");
    for (size_t i = 0; i < std::min(kMost, result.fixture_regions.size()); ++i) {
      const UnjudgedRegion& u = result.fixture_regions[i];
      std::printf("          %10.1f  %-27s  %-27s  %zu points\n", u.area_mm2, text_of(u.centre_mm).c_str(),
                  text_of(u.extent_mm).c_str(), u.points);
    }
    more(result.fixture_regions.size());
  }
}

void print_uncertainty(const InspectionResult& result) {
  const UncertaintyBudget& u = result.budget;
  char poses[32] = "unknown";
  if (result.poses_known) std::snprintf(poses, sizeof poses, "%.4f", u.scan_poses);
  std::printf("  certain to ±%.4f mm (95 %%) at a typical point\n", kCoverageFactor95 * u.combined());
  std::printf("             standard: noise %.4f, scan poses %s, alignment %.4f, sensor %.4f mm\n", u.noise,
              poses, u.alignment, u.sensor);
}

void print_summary(const InspectionResult& result, const InspectionOptions& options, size_t triangles,
                   const std::filesystem::path& report) {
  const DeviationStatistics& s = result.statistics;
  std::printf("\n%s  %s\n\n", std::string(to_string(result.verdict)).c_str(), result.reason.c_str());
  std::printf("  deviation  mean %+.4f mm, sigma %.4f mm, %.2f %% of %zu points within ±%.3f mm\n", s.mean,
              s.sigma, 100 * s.within_tolerance, s.count, options.tolerance_mm);
  std::printf("  coverage   %.1f %% of the CAD surface\n", 100 * result.coverage);
  print_reference(result, triangles);
  print_uncertainty(result);
  if (options.align) print_alignment(result.alignment);
  print_defects(result.defects);
  print_doubtful(result.doubtful);
  print_unjudged(result, options);
  std::printf("\n  report     %s\n", report.c_str());
}

}  // namespace

ExitCode inspect_and_report(const PointCloud& cloud, const TriangleMesh& reference,
                            const InspectionOptions& options, const Traceability& traceability,
                            const std::filesystem::path& folder, bool json) {
  const SignedDistance distance(reference);
  const InspectionResult result = inspect(cloud, distance, options);
  std::filesystem::create_directories(folder);
  const std::filesystem::path report = write_report(folder, result, distance, options, traceability);
  if (json) {
    nlohmann::json out{
        {"verdict", to_string(result.verdict)}, {"reason", result.reason}, {"report", report.string()}};
    out["reference"] = {{"triangles", reference.triangles.size()},
                        {"words", result.topology.text()},
                        {"points_beside_border", result.beside_border}};
    out["defects"] = nlohmann::json::array();
    for (const Defect& d : result.defects)
      out["defects"].push_back({{"id", d.id},
                                {"peak_mm", d.peak_mm},
                                {"uncertainty_mm", d.uncertainty_mm},
                                {"area_mm2", d.area_mm2},
                                {"class", to_string(d.kind)},
                                {"face", d.face},
                                {"centre_mm", {d.centre_mm.x(), d.centre_mm.y(), d.centre_mm.z()}}});
    out["doubtful_regions"] = result.doubtful.size();
    out["unseen_mm2"] = result.unseen_mm2;
    out["unseen_regions"] = result.unseen.size();
    std::printf("%s\n", out.dump().c_str());
  } else {
    print_summary(result, options, reference.triangles.size(), report);
  }
  switch (result.verdict) {
    case Verdict::kPass:
      return ExitCode::kPass;
    case Verdict::kFail:
      return ExitCode::kFail;
    case Verdict::kUndecided:
      return ExitCode::kUndecided;
  }
  return ExitCode::kUndecided;
}

}  // namespace gantry
