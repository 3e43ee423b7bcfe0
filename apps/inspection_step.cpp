#include "inspection_step.h"

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

void print_summary(const InspectionResult& result, const InspectionOptions& options, size_t triangles,
                   const std::filesystem::path& report) {
  const DeviationStatistics& s = result.statistics;
  std::printf("\n%s  %s\n\n", std::string(to_string(result.verdict)).c_str(), result.reason.c_str());
  std::printf("  deviation  mean %+.4f mm, sigma %.4f mm, %.2f %% of %zu points within ±%.3f mm\n", s.mean,
              s.sigma, 100 * s.within_tolerance, s.count, options.tolerance_mm);
  std::printf("  coverage   %.1f %% of the CAD surface\n", 100 * result.coverage);
  print_reference(result, triangles);
  if (options.align) print_alignment(result.alignment);
  if (!result.defects.empty()) {
    std::printf(
        "\n  defect       peak ± U (mm)   area (mm2)   centre x, y, z (mm)        extent x, y, z (mm)\n");
    for (const Defect& d : result.defects)
      std::printf("  %4d      %+8.3f ± %.3f   %10.1f   %7.2f %7.2f %7.2f   %7.2f %7.2f %7.2f\n", d.id,
                  d.peak_mm, d.uncertainty_mm, d.area_mm2, d.centre_mm.x(), d.centre_mm.y(), d.centre_mm.z(),
                  d.extent_mm.x(), d.extent_mm.y(), d.extent_mm.z());
  }
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
                                {"centre_mm", {d.centre_mm.x(), d.centre_mm.y(), d.centre_mm.z()}}});
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
