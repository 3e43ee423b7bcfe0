#include "defects/unjudged.h"

#include <algorithm>
#include <cmath>
#include <map>

#include "gantry/geometry/point_index.h"

namespace gantry::internal {
namespace {

constexpr double kLinkSpacings = 2.2;  ///< Samples closer than so many spacings on one side hang together.
constexpr float kSameSide = 0.5f;      ///< Cosine between normals.
constexpr double kFixtureCellMm = 0.5;

/// Connected groups of the samples that were not seen.
std::vector<std::vector<size_t>> unseen_groups(const CoverageSamples& samples) {
  std::vector<Eigen::Vector3f> points;
  std::vector<size_t> sample;
  for (size_t i = 0; i < samples.seen.size(); ++i)
    if (!samples.seen[i]) {
      points.push_back(samples.surface.points[i]);
      sample.push_back(i);
    }
  std::vector<std::vector<size_t>> groups;
  if (points.empty()) return groups;
  const PointIndex index(points);
  const auto link = static_cast<float>(kLinkSpacings * std::sqrt(samples.area_each_mm2));
  std::vector<unsigned char> taken(points.size(), 0);
  std::vector<PointIndex::Neighbour> near;
  for (size_t start = 0; start < points.size(); ++start) {
    if (taken[start]) continue;
    taken[start] = 1;
    std::vector<size_t> group{start};
    for (size_t k = 0; k < group.size(); ++k) {
      index.within(points[group[k]], link, near);
      const Eigen::Vector3f& normal = samples.surface.normals[sample[group[k]]];
      for (const auto& n : near)
        if (!taken[n.index] && samples.surface.normals[sample[n.index]].dot(normal) > kSameSide) {
          taken[n.index] = 1;
          group.push_back(n.index);
        }
    }
    std::sort(group.begin(), group.end());
    for (size_t& k : group) k = sample[k];
    groups.push_back(std::move(group));
  }
  return groups;
}

void largest_first(std::vector<UnjudgedRegion>& regions) {
  std::stable_sort(regions.begin(), regions.end(),
                   [](const auto& a, const auto& b) { return a.area_mm2 > b.area_mm2; });
}

/// Centre, extent and mean normal.
template <typename Points, typename Normals>
void place(UnjudgedRegion& region, const std::vector<size_t>& members, const Points& points,
           const Normals& normals) {
  Eigen::AlignedBox3d box;
  for (const size_t i : members) {
    const Eigen::Vector3d p = points[i].template cast<double>();
    region.centre_mm += p / static_cast<double>(members.size());
    box.extend(p);
    if (!normals.empty()) region.normal += normals[i].template cast<double>();
  }
  region.extent_mm = box.sizes();
  const bool faces_somewhere = region.normal.norm() > 1e-2 * static_cast<double>(members.size());
  region.normal = faces_somewhere ? region.normal.normalized() : Eigen::Vector3d(0, 0, 0);
}

}  // namespace

void find_unjudged(InspectionResult& result, const CadFaces& cad, const CoverageSamples& samples,
                   const Fixture& fixture, const InspectionOptions& options) {
  const Pose cloud_from_cad = result.alignment.cad_from_cloud.inverse();
  std::vector<double> face_samples(cad.faces.size(), 0);
  for (const int t : samples.triangle) ++face_samples[cad.face_of_triangle[t]];

  result.unseen.clear();
  result.unseen_mm2 = 0;
  for (const auto& members : unseen_groups(samples)) {
    UnjudgedRegion region;
    region.area_mm2 = samples.area_each_mm2 * static_cast<double>(members.size());
    result.unseen_mm2 += region.area_mm2;
    if (region.area_mm2 < options.min_unseen_area_mm2) continue;
    place(region, members, samples.surface.points, samples.surface.normals);
    std::map<int, double> on_face;
    std::vector<Eigen::Vector3f> in_cloud;
    for (const size_t i : members) {
      ++on_face[cad.face_of_triangle[samples.triangle[i]]];
      in_cloud.push_back((cloud_from_cad * samples.surface.points[i].cast<double>()).cast<float>());
    }
    const auto most = std::max_element(on_face.begin(), on_face.end(),
                                       [](const auto& a, const auto& b) { return a.second < b.second; });
    region.face = cad.faces[most->first].name;
    region.face_words = cad.faces[most->first].words;
    region.face_share = most->second / face_samples[most->first];
    // Around a fixture as much is hidden as its margin and the reach of a seen point take.
    const auto reach = static_cast<float>(2 * options.fixture_margin_mm + 1.0);
    const std::vector<float> to_fixture = fixture.distances(in_cloud, reach);
    const auto near = std::count_if(to_fixture.begin(), to_fixture.end(),
                                    [](float distance) { return std::isfinite(distance); });
    region.behind_fixture = 2 * static_cast<size_t>(near) >= members.size();
    result.unseen.push_back(region);
  }
  largest_first(result.unseen);

  std::vector<size_t> held;
  std::vector<Eigen::Vector3f> points;
  for (size_t i = 0; i < result.point_class.size(); ++i)
    if (result.point_class[i] == PointClass::kFixture && result.cloud.points[i].allFinite()) {
      held.push_back(i);
      points.push_back(result.cloud.points[i]);
    }
  result.fixture_regions.clear();
  for (auto& members : linked_groups(points, options.link_distance_mm)) {
    for (size_t& i : members) i = held[i];
    UnjudgedRegion region;
    region.kind = DefectClass::kFixture;
    region.points = members.size();
    region.area_mm2 = sampled_area(result.cloud, members, kFixtureCellMm);
    if (region.area_mm2 < options.min_unseen_area_mm2) continue;
    place(region, members, result.cloud.points, result.cloud.normals);
    result.fixture_regions.push_back(region);
  }
  largest_first(result.fixture_regions);
}

}  // namespace gantry::internal
