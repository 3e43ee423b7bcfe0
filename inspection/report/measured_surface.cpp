#include "report/measured_surface.h"

#include <tbb/parallel_for.h>
#include <tbb/parallel_sort.h>

#include <algorithm>
#include <cmath>
#include <tuple>

#include "gantry/geometry/point_index.h"

namespace gantry::report {
namespace {

constexpr float kBesideMm = 0.5f;  // further sideways from its foot: the CAD ends before this point
constexpr float kVoxelsAcross = 600;

enum class Place : unsigned char { kNowhere, kOnCad, kOffCad };

/// Where one judged point belongs.
struct Foot {
  Eigen::Vector3f position, normal;
  Place place = Place::kNowhere;
};

/// Points of equal key become one surfel.
struct Key {
  int x, y, z;
  int facing;  // dominant axis of the normal and its sign: keeps the faces of a thin wall apart
  int defect;
  auto tie() const { return std::tie(x, y, z, facing, defect); }
  bool operator<(const Key& other) const { return tie() < other.tie(); }
  bool operator==(const Key& other) const { return tie() == other.tie(); }
};

std::vector<Surfel> thinned(const InspectionResult& result, const std::vector<Foot>& feet, Place place,
                            float voxel_mm) {
  struct Entry {
    Key key;
    uint32_t index;
    bool operator<(const Entry& other) const {
      return std::tuple_cat(key.tie(), std::tie(index)) <
             std::tuple_cat(other.key.tie(), std::tie(other.index));
    }
  };
  std::vector<Entry> entries;
  const auto position = [&](size_t i) {
    return place == Place::kOnCad ? feet[i].position : result.cloud.points[i];
  };
  for (size_t i = 0; i < feet.size(); ++i) {
    if (feet[i].place != place) continue;
    const Eigen::Vector3i cell = (position(i) / voxel_mm).array().floor().cast<int>();
    entries.push_back({{cell.x(), cell.y(), cell.z(), dominant_axis(feet[i].normal), result.defect_id[i]},
                       static_cast<uint32_t>(i)});
  }
  tbb::parallel_sort(entries.begin(), entries.end());
  std::vector<Surfel> surfels;
  for (size_t begin = 0, end = 0; begin < entries.size(); begin = end) {
    Surfel s{Eigen::Vector3f::Zero(), Eigen::Vector3f::Zero(), 0, 0, entries[begin].key.defect};
    for (end = begin; end < entries.size() && entries[end].key == entries[begin].key; ++end) {
      const size_t i = entries[end].index;
      s.position += position(i);
      s.normal += feet[i].normal;
      s.deviation_mm += result.deviation_mm[i];
      s.uncertainty_mm += result.uncertainty_mm[i];
    }
    const auto n = static_cast<float>(end - begin);
    s.position /= n;
    s.deviation_mm /= n;
    s.uncertainty_mm /= n;
    s.normal.stableNormalize();
    surfels.push_back(s);
  }
  return surfels;
}

/// Median distance from a surfel to its nearest neighbour, from an even sample; 0 for fewer than two.
float typical_spacing(const std::vector<Surfel>& surfels) {
  if (surfels.size() < 2) return 0;
  std::vector<Eigen::Vector3f> points;
  points.reserve(surfels.size());
  for (const Surfel& s : surfels) points.push_back(s.position);
  const PointIndex index(points);
  std::vector<float> distances;
  std::vector<PointIndex::Neighbour> neighbours;
  const size_t stride = std::max<size_t>(1, points.size() / 1000);
  for (size_t i = 0; i < points.size(); i += stride) {
    index.nearest(points[i], 2, 1e6f, neighbours);
    if (neighbours.size() == 2) distances.push_back(std::sqrt(neighbours[1].squared_distance));
  }
  std::nth_element(distances.begin(), distances.begin() + distances.size() / 2, distances.end());
  return distances[distances.size() / 2];
}

/// Drops surfels with few others around them: points that noise put beyond an edge are no material.
std::vector<Surfel> supported(const std::vector<Surfel>& surfels, float radius_mm) {
  constexpr size_t kEnough = 6;  // itself included
  std::vector<Eigen::Vector3f> points;
  points.reserve(surfels.size());
  for (const Surfel& s : surfels) points.push_back(s.position);
  const PointIndex index(points);
  std::vector<PointIndex::Neighbour> neighbours;
  std::vector<Surfel> kept;
  for (const Surfel& s : surfels) {
    index.nearest(s.position, kEnough, radius_mm, neighbours);
    if (neighbours.size() == kEnough) kept.push_back(s);
  }
  return kept;
}

}  // namespace

int dominant_axis(const Eigen::Vector3f& normal) {
  int axis;
  normal.cwiseAbs().maxCoeff(&axis);
  return 2 * axis + (normal[axis] < 0);
}

MeasuredSurface measured_surface(const InspectionResult& result, const SignedDistance& reference,
                                 const InspectionOptions& options) {
  const PointCloud& cloud = result.cloud;
  const TriangleMesh& mesh = reference.mesh();
  const auto max_distance = static_cast<float>(options.max_distance_mm);
  const auto min_cosine = static_cast<float>(std::cos(options.max_angle_rad));
  std::vector<Foot> feet(cloud.size());
  tbb::parallel_for(size_t{0}, cloud.size(), [&](size_t i) {
    if (result.point_class[i] != PointClass::kJudged || !std::isfinite(result.deviation_mm[i])) return;
    const auto value = cloud.has_normals()
                           ? reference(cloud.points[i], cloud.normals[i], min_cosine, max_distance)
                           : reference(cloud.points[i], max_distance);
    if (!value) return;
    Foot& foot = feet[i];
    foot.position = value->closest;
    foot.normal = mesh.normal(value->triangle);
    const Eigen::Vector3f step = cloud.points[i] - value->closest;
    const float beside = (step - step.dot(foot.normal) * foot.normal).norm();
    foot.place = beside <= kBesideMm ? Place::kOnCad : Place::kOffCad;
    if (foot.place == Place::kOffCad && cloud.has_normals()) foot.normal = cloud.normals[i];
  });

  // The deviations are means over the averaging radius: half of it loses nothing.
  const float voxel = std::max({0.5f * static_cast<float>(options.averaging_radius_mm),
                                mesh.bounds().diagonal().norm() / kVoxelsAcross, 1e-4f});
  MeasuredSurface surface;
  surface.on_cad = thinned(result, feet, Place::kOnCad, voxel);
  surface.off_cad = thinned(result, feet, Place::kOffCad, voxel);
  surface.reach_mm = 2.5f * std::max(voxel, typical_spacing(surface.on_cad));
  const float off_spacing = std::max(voxel, typical_spacing(surface.off_cad));
  if (!surface.off_cad.empty()) surface.off_cad = supported(surface.off_cad, 4 * off_spacing);
  // Large enough to close the gap to the CAD surface beside it.
  surface.disc_mm = std::max(2 * off_spacing, kBesideMm + 1.5f * off_spacing);
  return surface;
}

}  // namespace gantry::report
