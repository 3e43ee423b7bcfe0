#include "gantry/inspection/report.h"

#include <tbb/parallel_for.h>

#include <algorithm>

#include "gantry/foundation/error.h"
#include "gantry/geometry/point_cloud_file.h"
#include "report/page.h"
#include "report/renderer.h"
#include "report/report_json.h"
#include "report/surface_model.h"
#include "report/text.h"
#include "report/viewer.h"

namespace gantry {
namespace {

// These keep the page small, whatever the size of the cloud, of the CAD model and of the list of defects.
constexpr size_t kMostCloseUps = 16;
constexpr size_t kMostTriangles = 160000;  // of the interactive view

void write_deviations(const std::filesystem::path& path, const InspectionResult& result) {
  const std::vector<float> defect(result.defect_id.begin(), result.defect_id.end());
  write_point_cloud(
      path, result.cloud,
      {{"deviation", result.deviation_mm}, {"uncertainty", result.uncertainty_mm}, {"defect", defect}});
}

/// The side from which a defect's peak is seen: along the region's normal, which for a region on both
/// faces of a sheet may belong to the face that the peak is not on.
Eigen::Vector3f peak_side(const Defect& defect, const report::MeasuredSurface& measured) {
  const Eigen::Vector3f peak = defect.peak_at_mm.cast<float>(), normal = defect.normal.cast<float>();
  const report::Surfel* nearest = nullptr;
  for (const auto* surfels : {&measured.on_cad, &measured.off_cad})
    for (const report::Surfel& s : *surfels)
      if (s.defect == defect.id &&
          (!nearest || (s.position - peak).squaredNorm() < (nearest->position - peak).squaredNorm()))
        nearest = &s;
  const bool usable = normal.allFinite() && normal.norm() > 1e-3f;
  if (!nearest) return usable ? normal : Eigen::Vector3f(Eigen::Vector3f::UnitZ());
  if (!usable) return nearest->normal;
  return normal.dot(nearest->normal) < 0 ? Eigen::Vector3f(-normal) : normal;
}

}  // namespace

std::filesystem::path write_report(const std::filesystem::path& folder, const InspectionResult& result,
                                   const SignedDistance& reference, const InspectionOptions& options,
                                   const Traceability& traceability) {
  if (!(options.tolerance_mm > 0)) throw InputError("a report needs a tolerance greater than 0 mm");
  write_deviations(folder / "deviations.ply", result);

  const RayScene cad(reference.mesh());
  const report::ColourScale colours(options.tolerance_mm);
  const report::MeasuredSurface measured = report::measured_surface(result, reference, options);
  const report::ReportFacts facts{report::distribution(result),
                                  report::sections(reference.mesh(), measured, result.defects),
                                  report::coverage_sides(reference.mesh(), measured),
                                  reference.mesh().surface_area(), reference.mesh().triangles.size()};
  report::write_file(folder / "report.json", report::report_json(result, options, traceability, facts));

  std::vector<report::Picture> overviews, coverage_views, close_ups;
  std::vector<report::Image> images;
  for (auto& [name, camera] : report::overview_cameras(cad.mesh())) {
    report::Rendering rendering = report::render(cad, measured, colours, camera);
    overviews.push_back(
        {name, camera, {}, report::place_labels(camera, rendering, measured, result.defects)});
    images.push_back(std::move(rendering.image));
  }
  for (auto& [name, camera] : report::coverage_cameras(cad.mesh())) {
    coverage_views.push_back({name, camera, {}, {}});
    images.push_back(report::render(cad, measured, colours, camera, report::Colouring::kCoverage).image);
  }
  for (size_t i = 0; i < std::min(result.defects.size(), kMostCloseUps); ++i) {
    const Defect& defect = result.defects[i];
    const report::Camera camera = report::close_up_camera(defect, peak_side(defect, measured), cad);
    const Eigen::Vector2f peak = camera.project(defect.peak_at_mm.cast<float>()).head<2>();
    close_ups.push_back({"Defect " + std::to_string(defect.id), camera, {}, {{defect.id, peak, peak}}, true});
    images.push_back(report::render(cad, measured, colours, camera).image);
  }
  std::vector<report::Picture*> pictures;
  for (auto* list : {&overviews, &coverage_views, &close_ups})
    for (report::Picture& picture : *list) pictures.push_back(&picture);
  tbb::parallel_for(size_t{0}, images.size(), [&](size_t i) { pictures[i]->png = report::png(images[i]); });

  const std::string viewer =
      report::viewer_data(report::surface_model(cad.mesh(), measured, options.tolerance_mm, kMostTriangles),
                          measured, colours, result.defects, facts.sections);
  const std::filesystem::path html = folder / "report.html";
  report::write_file(html, report::page({result, options, traceability, facts, overviews, coverage_views,
                                         close_ups, viewer, measured.reach_mm}));
  return html;
}

}  // namespace gantry
