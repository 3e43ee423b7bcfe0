#include "defects/find_defects.h"

#include <tbb/parallel_for.h>

#include <algorithm>
#include <cmath>
#include <limits>
#include <numbers>

#include "defects/classify.h"
#include "defects/residue.h"
#include "gantry/geometry/point_index.h"

namespace gantry::internal {
namespace {

constexpr size_t kPeakNeighbours = 3;

/// Which of +-x, +-y, +-z a point's normal is nearest to, as 0 to 5.
size_t main_direction(const PointCloud& cloud, size_t i) {
  if (!cloud.has_normals()) return 0;
  const Eigen::Vector3f& n = cloud.normals[i];
  Eigen::Index axis;
  n.cwiseAbs().maxCoeff(&axis);
  return static_cast<size_t>(2 * axis + (n[axis] < 0));
}

/// The largest deviation around a point, on its tangent plane and no further away than its neighbours are.
/// Only where the CAD surface lies sideways (material in a missing hole): the deviation then changes as
/// fast as the position does, while along the normal the tangent plane would overshoot. And only between
/// points: beyond the rim of what was measured there is nothing to climb to.
float climb(const InspectionResult& result, const LocalSurface& surface, const SignedDistance& reference,
            const InspectionOptions& options, size_t i) {
  float best = result.deviation_mm[i];
  if (!result.cloud.has_normals() || surface.rim[i]) return best;
  const Eigen::Vector3f normal = result.cloud.normals[i];
  const Eigen::Vector3f u = normal.unitOrthogonal(), v = normal.cross(u);
  const auto min_cosine = static_cast<float>(std::cos(options.max_angle_rad));
  const auto start =
      reference(surface.points[i], normal, min_cosine, static_cast<float>(options.max_distance_mm));
  if (!start || std::abs((surface.points[i] - start->closest).dot(normal)) > 0.5f * std::abs(start->distance))
    return best;
  constexpr int kDirections = 16;
  for (int ring = 1; ring <= 5; ++ring) {
    const auto radius = static_cast<float>(0.25 * ring * surface.spacing_mm);
    for (int k = 0; k < kDirections; ++k) {
      const float angle = static_cast<float>(2 * std::numbers::pi * k / kDirections);
      const Eigen::Vector3f p = surface.points[i] + radius * (std::cos(angle) * u + std::sin(angle) * v);
      const auto value = reference(p, normal, min_cosine, static_cast<float>(options.max_distance_mm));
      if (value && std::abs(value->distance) > std::abs(best)) best = value->distance;
    }
  }
  return best;
}

float median(std::vector<float> values) {
  const auto middle = values.begin() + static_cast<std::ptrdiff_t>(values.size() / 2);
  std::nth_element(values.begin(), middle, values.end());
  return *middle;
}

struct Peak {
  size_t point;
  float deviation;
};

/// The peak of a region: the point around which the median deviation of its nearest neighbours on the
/// same face is largest, and the median of what can be climbed to from each of them. Points on the rim
/// of the measured surface are extrapolations and count only where there is nothing else.
Peak find_peak(const InspectionResult& result, const LocalSurface& surface, const SignedDistance& reference,
               const InspectionOptions& options, const std::vector<size_t>& members) {
  std::vector<size_t> inner;
  for (size_t i : members)
    if (!surface.rim[i]) inner.push_back(i);
  const std::vector<size_t>& candidates = inner.empty() ? members : inner;
  std::vector<Eigen::Vector3f> points;
  for (size_t i : candidates) points.push_back(surface.points[i]);
  const PointIndex index(points);
  const auto neighbours_of = [&](size_t c) {
    std::vector<PointIndex::Neighbour> near;
    index.nearest(points[c], 2 * kPeakNeighbours, static_cast<float>(4 * surface.spacing_mm), near);
    std::vector<size_t> same_face;
    for (const auto& n : near) {
      const size_t j = candidates[n.index];
      const bool facing = !result.cloud.has_normals() ||
                          result.cloud.normals[candidates[c]].dot(result.cloud.normals[j]) > 0.5f;
      if (facing && same_face.size() < kPeakNeighbours) same_face.push_back(j);
    }
    return same_face;
  };
  std::vector<float> medians(candidates.size());
  tbb::parallel_for(size_t{0}, candidates.size(), [&](size_t c) {
    std::vector<float> deviations;
    for (size_t j : neighbours_of(c)) deviations.push_back(result.deviation_mm[j]);
    medians[c] = deviations.size() < 3 ? 0 : median(std::move(deviations));
  });
  const auto largest = std::max_element(medians.begin(), medians.end(),
                                        [](float a, float b) { return std::abs(a) < std::abs(b); });
  const auto c = static_cast<size_t>(largest - medians.begin());
  std::vector<float> climbed;
  for (size_t j : neighbours_of(c)) climbed.push_back(climb(result, surface, reference, options, j));
  return {candidates[c], median(std::move(climbed))};
}

/// Who measured each point, and what residue is told by.
class Residue {
 public:
  explicit Residue(const DefectScene& scene) : sources_(scene.sources) {
    if (!sources_ || sources_->scans.size() < 2) return;
    const size_t n = scene.feet.point.size();
    normals_.assign(n, Eigen::Vector3f::Zero());
    deviation_.assign(n, std::numeric_limits<float>::quiet_NaN());
    scan_.assign(n, kManyScans);
    tbb::parallel_for(size_t{0}, n, [&](size_t i) {
      if (scene.feet.triangle[i] < 0) return;
      normals_[i] = scene.foot_normal(i);
      // As it was measured: smoothing mixes the scans.
      deviation_[i] = (scene.result.cloud.points[i] - scene.feet.point[i]).dot(normals_[i]);
      for (const CloudSources::Share& share : sources_->of(i))
        if (share.fraction() >= kOwnShare) scan_[i] = share.scan;
    });
    // Where scans contradict each other within the radius of smoothing nothing is judged: look across that.
    const double beside = 3 * std::max(scene.options.averaging_radius_mm, 2 * scene.surface.spacing_mm);
    finder_.emplace(ScanDeviations{scene.feet.point, normals_, deviation_, scan_}, scene.options.tolerance_mm,
                    beside);
  }

  void judge(Defect& defect, const std::vector<size_t>& members) const {
    const auto scan = finder_ ? finder_->scan_that_explains(members) : std::nullopt;
    if (!scan) return;
    defect.kind = DefectClass::kRegistrationResidue;
    defect.certain = false;
    defect.words = "scan " + sources_->scans[*scan] + " lies off the others, which find the surface good";
  }

 private:
  static constexpr double kOwnShare = 0.6;  ///< A point is a scan's own with so much of it.

  const CloudSources* sources_;  ///< Null: not known.
  std::vector<Eigen::Vector3f> normals_;
  std::vector<float> deviation_;
  std::vector<uint16_t> scan_;
  std::optional<ResidueFinder> finder_;
};

using Found = std::vector<std::pair<Defect, std::vector<size_t>>>;

/// The figures of a region; what it is, is told by classify().
Defect describe(const DefectScene& scene, const std::vector<size_t>& members) {
  const InspectionResult& result = scene.result;
  const PointCloud& cloud = result.cloud;
  Defect defect;
  const RegionExtent extent = measure_region(scene, members);
  defect.points = members.size();
  defect.area_mm2 = extent.area_mm2;
  defect.extra_mm3 = extent.extra_mm3;
  defect.missing_mm3 = extent.missing_mm3;
  Eigen::Vector3d sum = Eigen::Vector3d::Zero();
  Eigen::AlignedBox3d box;
  std::array<Eigen::Vector3d, 6> facing;
  facing.fill(Eigen::Vector3d::Zero());
  double magnitudes = 0, deviations = 0, uncertainties = 0;
  for (size_t i : members) {
    const Eigen::Vector3d p = cloud.points[i].cast<double>();
    sum += p;
    box.extend(p);
    magnitudes += std::abs(result.deviation_mm[i]);
    deviations += result.deviation_mm[i];
    uncertainties += result.uncertainty_mm[i];
    if (cloud.has_normals()) facing[main_direction(cloud, i)] += cloud.normals[i].cast<double>();
  }
  const double count = static_cast<double>(members.size());
  defect.centre_mm = sum / count;
  defect.extent_mm = box.sizes();
  defect.mean_mm = magnitudes / count;
  defect.signed_mean_mm = deviations / count;
  defect.mean_uncertainty_mm = kCoverageFactor95 * uncertainties / count;
  const Peak peak = find_peak(result, scene.surface, scene.reference, scene.options, members);
  const double sigma = result.uncertainty_mm[peak.point];
  defect.peak_mm = peak.deviation;
  defect.peak_at_mm = cloud.points[peak.point].cast<double>();
  defect.uncertainty_mm = kCoverageFactor95 * sigma;
  defect.normal = facing[main_direction(cloud, peak.point)].stableNormalized();
  defect.certain = std::abs(defect.peak_mm) > scene.options.tolerance_mm + scene.options.guard_band * sigma;
  return defect;
}

/// By falling |peak|, numbered from 1.
void sort_and_number(Found& found) {
  std::stable_sort(found.begin(), found.end(), [](const auto& a, const auto& b) {
    return std::abs(a.first.peak_mm) > std::abs(b.first.peak_mm);
  });
  for (size_t k = 0; k < found.size(); ++k) found[k].first.id = static_cast<int>(k) + 1;
}

Found find_out_of_tolerance(const DefectScene& scene) {
  Found found;
  std::vector<std::vector<size_t>> regions =
      regions_beyond(scene, [&](size_t) { return scene.options.tolerance_mm; });
  std::optional<Residue> residue;
  if (!regions.empty()) residue.emplace(scene);
  for (auto& members : regions) {
    Defect defect = describe(scene, members);
    if (defect.area_mm2 < scene.options.min_defect_area_mm2) continue;
    classify(defect, scene, members);
    residue->judge(defect, members);
    found.emplace_back(std::move(defect), std::move(members));
  }
  sort_and_number(found);
  return found;
}

/// Which points come nearer to the tolerance than the guard band, among neighbours of which half or more do:
/// where noise left single points uncertain, those beside them tell. Points on the rim of the measured
/// surface are extrapolations and doubt nothing by themselves.
std::vector<char> points_in_doubt(const DefectScene& scene) {
  const InspectionResult& result = scene.result;
  const PointCloud& cloud = result.cloud;
  const double tolerance = scene.options.tolerance_mm, guard_band = scene.options.guard_band;
  const auto near_tolerance = [&](size_t i) {  // NaN compares false
    return !scene.surface.rim[i] &&
           std::abs(result.deviation_mm[i]) + guard_band * result.uncertainty_mm[i] > tolerance;
  };
  std::vector<size_t> candidates;
  for (size_t i = 0; i < cloud.size(); ++i)
    if (near_tolerance(i)) candidates.push_back(i);
  std::vector<char> in_doubt(cloud.size(), 0);
  if (candidates.empty()) return in_doubt;
  const PointIndex index(cloud.points);
  const double radius = std::max(scene.options.averaging_radius_mm, 2 * scene.surface.spacing_mm);
  tbb::parallel_for(size_t{0}, candidates.size(), [&](size_t c) {
    thread_local std::vector<PointIndex::Neighbour> near;
    const size_t i = candidates[c];
    index.within(cloud.points[i], static_cast<float>(radius), near);
    size_t all = 0, doubtful = 0;
    for (const auto& n : near) {
      if (std::isnan(result.deviation_mm[n.index])) continue;
      if (cloud.has_normals() && cloud.normals[n.index].dot(cloud.normals[i]) < 0.5f) continue;
      ++all;
      doubtful += near_tolerance(n.index);
    }
    in_doubt[i] = 2 * doubtful >= all;
  });
  return in_doubt;
}

/// Regions beside the tolerance, without those that surround a defect.
Found find_doubtful(const DefectScene& scene, const std::vector<int>& defect_id) {
  const double tolerance = scene.options.tolerance_mm, guard_band = scene.options.guard_band;
  const std::vector<char> in_doubt = points_in_doubt(scene);
  const auto limit_mm = [&](size_t i) { return in_doubt[i] ? 0.0 : std::numeric_limits<double>::infinity(); };
  Found found;
  for (auto& members : regions_beyond(scene, limit_mm)) {
    if (std::any_of(members.begin(), members.end(), [&](size_t i) { return defect_id[i] > 0; })) continue;
    Defect region = describe(scene, members);
    const double band = guard_band * region.uncertainty_mm / kCoverageFactor95;
    if (std::abs(region.peak_mm) + band <= tolerance || region.area_mm2 < scene.options.min_defect_area_mm2)
      continue;
    region.certain = false;
    classify(region, scene, members);
    found.emplace_back(std::move(region), std::move(members));
  }
  sort_and_number(found);
  return found;
}

}  // namespace

void find_defects(InspectionResult& result, const LocalSurface& surface, const SignedDistance& reference,
                  const CadFaces& cad, const JudgedFeet& feet, const CoverageSamples& samples,
                  const InspectionOptions& options, const CloudSources* sources) {
  const DefectScene scene{result, surface, reference, cad, feet, samples, options, sources};
  const Found out = find_out_of_tolerance(scene);
  result.defect_id.assign(result.cloud.size(), 0);
  for (const auto& [defect, members] : out)
    for (size_t i : members) result.defect_id[i] = defect.id;
  for (const auto& [region, members] : find_doubtful(scene, result.defect_id))
    result.doubtful.push_back(region);
  for (const auto& [defect, members] : out) result.defects.push_back(defect);
}

}  // namespace gantry::internal
