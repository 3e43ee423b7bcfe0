#include "report/report_json.h"

#include <algorithm>
#include <nlohmann/json.hpp>

#include "report/section_chart.h"

namespace gantry::report {
namespace {

using Json = nlohmann::ordered_json;

template <typename Matrix>
Json rows(const Matrix& matrix) {
  Json json = Json::array();
  for (Eigen::Index r = 0; r < matrix.rows(); ++r) {
    Json row = Json::array();
    for (Eigen::Index c = 0; c < matrix.cols(); ++c) row.push_back(matrix(r, c));
    json.push_back(row);
  }
  return json;
}

Json vector3(const Eigen::Vector3d& v) {
  return Json{v.x(), v.y(), v.z()};
}

Json defect_json(const Defect& d) {
  return {{"id", d.id},
          {"centre_mm", vector3(d.centre_mm)},
          {"extent_mm", vector3(d.extent_mm)},
          {"area_mm2", d.area_mm2},
          {"peak_mm", d.peak_mm},
          {"mean_mm", d.mean_mm},
          {"uncertainty_mm", d.uncertainty_mm},
          {"peak_at_mm", vector3(d.peak_at_mm)},
          {"normal", vector3(d.normal)},
          {"points", d.points},
          {"certain", d.certain},
          {"class", to_string(d.kind)},
          {"words", d.words},
          {"face", d.face},
          {"face_words", d.face_words},
          {"extra_mm3", d.extra_mm3},
          {"missing_mm3", d.missing_mm3},
          {"signed_mean_mm", d.signed_mean_mm},
          {"mean_uncertainty_mm", d.mean_uncertainty_mm}};
}

Json unjudged_json(const UnjudgedRegion& u) {
  Json json{{"class", to_string(u.kind)},
            {"area_mm2", u.area_mm2},
            {"centre_mm", vector3(u.centre_mm)},
            {"extent_mm", vector3(u.extent_mm)},
            {"normal", vector3(u.normal)}};
  if (u.kind == DefectClass::kNoData) {
    json["face"] = u.face;
    json["face_words"] = u.face_words;
    json["face_share"] = u.face_share;
    json["behind_fixture"] = u.behind_fixture;
  } else {
    json["points"] = u.points;
  }
  return json;
}

Json surface_json(const std::vector<SurfaceStatistics>& patches) {
  Json json = Json::array();
  for (const SurfaceStatistics& s : patches)
    json.push_back({{"name", s.name},
                    {"words", s.words},
                    {"centre_mm", vector3(s.centre_mm)},
                    {"normal", vector3(s.normal)},
                    {"area_mm2", s.area_mm2},
                    {"seen", s.seen},
                    {"points", s.points},
                    {"mean_mm", s.mean_mm},
                    {"sigma_mm", s.sigma_mm},
                    {"p05_mm", s.p05_mm},
                    {"p95_mm", s.p95_mm},
                    {"min_mm", s.min_mm},
                    {"max_mm", s.max_mm},
                    {"uncertainty_mm", s.uncertainty_mm}});
  return json;
}

Json alignment_json(const AlignmentResult& a) {
  Json json = {{"cad_from_cloud", rows(a.cad_from_cloud.matrix())},
               {"covariance", rows(a.covariance)},
               {"held_covariance", rows(a.held_covariance)},
               {"rms_before_mm", a.rms_before_mm},
               {"rms_after_mm", a.rms_after_mm},
               {"inlier_fraction", a.inlier_fraction},
               {"masked_fraction", a.masked_fraction},
               {"masked_regions", a.masked_regions},
               {"iterations", a.iterations},
               {"mask_rounds", a.mask_rounds},
               {"converged", a.converged},
               {"status", a.status}};
  json["free_motions"] = Json::array();
  for (const FreeMotion& m : a.free_motions)
    json["free_motions"].push_back({{"words", m.words}, {"twist", rows(m.twist.transpose())[0]}});
  json["equivalent_poses"] = Json::array();
  for (const EquivalentPose& e : a.equivalents)
    json["equivalent_poses"].push_back({{"words", e.words}, {"motion", rows(e.motion.matrix())}});
  json["datums"] = Json::array();
  for (const DatumFit& d : a.datums)
    json["datums"].push_back({{"name", d.name},
                              {"words", d.words},
                              {"fixes", d.fixes},
                              {"points", d.points},
                              {"rms_mm", d.rms_mm},
                              {"offset_mm", d.offset_mm},
                              {"tilt_deg", d.tilt_deg}});
  return json;
}

Json distribution_json(const Distribution& d) {
  const auto gaussian = [](const Gaussian& g, double misfit) {
    return Json{{"mean_mm", g.mean_mm}, {"sigma_mm", g.sigma_mm}, {"kolmogorov_smirnov", misfit}};
  };
  Json json{
      {"gaussian", gaussian(d.all, d.all_misfit)}, {"gaussian_of_bulk", gaussian(d.bulk, d.bulk_misfit)},
      {"weibull_of_magnitudes", nullptr},          {"magnitude_p50_mm", d.magnitude_p50_mm},
      {"magnitude_p95_mm", d.magnitude_p95_mm},    {"magnitude_p99_mm", d.magnitude_p99_mm}};
  if (d.weibull)
    json["weibull_of_magnitudes"] = {{"shape", d.weibull->shape},
                                     {"scale_mm", d.weibull->scale_mm},
                                     {"kolmogorov_smirnov", d.weibull_misfit}};
  return json;
}

Json section_json(const Section& section, double tolerance_mm) {
  const SectionStatistics s = section_statistics(section);
  return {{"name", std::string(1, section.letter)},
          {"axis", std::string(1, "xyz"[section.axis])},
          {"offset_mm", section.offset_mm},
          {"through_defect", section.through > 0 ? Json(section.through) : Json(nullptr)},
          {"drawn_times", exaggeration(section, tolerance_mm)},
          {"within_mm", section.slab_mm},
          {"count", s.count},
          {"mean_mm", s.mean},
          {"min_mm", s.min},
          {"max_mm", s.max}};
}

Json reference_json(const InspectionResult& result, size_t triangles) {
  const MeshTopology& t = result.topology;
  return {{"triangles", triangles},
          {"watertight", t.watertight()},
          {"words", t.text()},
          {"shells", t.shells},
          {"boundary_edges", t.boundary_edges},
          {"nonmanifold_edges", t.nonmanifold_edges},
          {"inconsistent_edges", t.inconsistent_edges},
          {"degenerate_triangles", t.degenerate_triangles},
          {"points_beside_border", result.beside_border}};
}

/// Name to value; a list of values where a name (a drive) occurs more than once.
Json traceability_json(const Traceability& traceability) {
  Json json = Json::object();
  for (const auto& [name, value] : traceability.entries) {
    Json& entry = json[name];
    if (entry.is_null()) {
      entry = value;
    } else {
      if (!entry.is_array()) entry = Json::array({entry});
      entry.push_back(value);
    }
  }
  return json;
}

}  // namespace

std::string report_json(const InspectionResult& result, const InspectionOptions& options,
                        const Traceability& traceability, const ReportFacts& facts) {
  Json json;
  json["verdict"] = to_string(result.verdict);
  json["reason"] = result.reason;
  json["title"] = traceability.title;
  json["created"] = traceability.created;
  json["simulated"] = traceability.simulated;
  json["tolerance_mm"] = options.tolerance_mm;
  json["guard_band_sigmas"] = options.guard_band;
  const DeviationStatistics& s = result.statistics;
  json["statistics"] = {{"count", s.count},    {"mean_mm", s.mean},
                        {"sigma_mm", s.sigma}, {"rms_mm", s.rms},
                        {"min_mm", s.min},     {"max_mm", s.max},
                        {"p05_mm", s.p05},     {"p50_mm", s.p50},
                        {"p95_mm", s.p95},     {"within_tolerance", s.within_tolerance}};
  json["distribution"] = distribution_json(facts.distribution);
  json["reference"] = reference_json(result, facts.triangles);
  json["coverage"] = result.coverage;
  json["surface_mm2"] = facts.surface_mm2;
  json["coverage_by_side"] = Json::array();
  for (const SideCoverage& side : facts.sides)
    json["coverage_by_side"].push_back(
        {{"towards", side.towards}, {"area_mm2", side.area_mm2}, {"seen", side.seen}});
  const auto count = [&](PointClass c) {
    return std::count(result.point_class.begin(), result.point_class.end(), c);
  };
  json["point_classes"] = {{"judged", count(PointClass::kJudged)},
                           {"fixture", count(PointClass::kFixture)},
                           {"far", count(PointClass::kFar)}};
  const UncertaintyBudget& budget = result.budget;
  json["uncertainty"] = {{"typical_mm", kCoverageFactor95 * budget.combined()},
                         {"coverage", 0.95},
                         {"noise_sigma_mm", budget.noise},
                         {"scan_poses_sigma_mm", result.poses_known ? Json(budget.scan_poses) : Json(nullptr)},
                         {"alignment_sigma_mm", budget.alignment},
                         {"sensor_sigma_mm", budget.sensor}};
  json["alignment"] = alignment_json(result.alignment);
  json["defects"] = Json::array();
  for (const Defect& d : result.defects) json["defects"].push_back(defect_json(d));
  json["doubtful"] = Json::array();
  for (const Defect& d : result.doubtful) json["doubtful"].push_back(defect_json(d));
  json["unseen_mm2"] = result.unseen_mm2;
  json["unseen"] = Json::array();
  for (const UnjudgedRegion& u : result.unseen) json["unseen"].push_back(unjudged_json(u));
  json["fixture_regions"] = Json::array();
  for (const UnjudgedRegion& u : result.fixture_regions) json["fixture_regions"].push_back(unjudged_json(u));
  json["faces"] = surface_json(result.faces);
  json["regions"] = surface_json(result.regions);
  json["sections"] = Json::array();
  for (const Section& section : facts.sections)
    json["sections"].push_back(section_json(section, options.tolerance_mm));
  json["traceability"] = traceability_json(traceability);
  // Text that is not UTF-8 (a file name) must not cost the report.
  return json.dump(2, ' ', false, Json::error_handler_t::replace) + "\n";
}

}  // namespace gantry::report
