#include "methods.h"

#include <embree3/rtcore.h>
#include <tbb/parallel_for.h>

#include <cmath>
#include <limits>
#include <nanoflann.hpp>

#include "gantry/geometry/closest_on_triangle.h"
#include "gantry/geometry/point_index.h"
#include "gantry/geometry/signed_distance.h"
#include "gantry/geometry/spatial_order.h"

namespace gantry::bench {
namespace {

constexpr float kAnywhere_mm = 1e15f;

struct EmbreeQuery {
  const TriangleMesh* mesh;
  Eigen::Vector3d point;
  double squared;
  Eigen::Vector3f closest = Eigen::Vector3f::Zero();
};

bool visit(RTCPointQueryFunctionArguments* args) {
  auto& query = *static_cast<EmbreeQuery*>(args->userPtr);
  const Eigen::Vector3i& t = query.mesh->triangles[args->primID];
  TriangleFeature feature;
  const Eigen::Vector3d q = closest_on_triangle(query.point, query.mesh->vertices[t[0]].cast<double>(),
                                                query.mesh->vertices[t[1]].cast<double>(),
                                                query.mesh->vertices[t[2]].cast<double>(), feature);
  const double squared = (q - query.point).squaredNorm();
  if (squared >= query.squared) return false;
  query.squared = squared;
  query.closest = q.cast<float>();
  args->query->radius = static_cast<float>(std::sqrt(squared));
  return true;
}

struct Adaptor {
  const std::vector<Eigen::Vector3f>& points;
  size_t kdtree_get_point_count() const { return points.size(); }
  float kdtree_get_pt(size_t i, size_t axis) const { return points[i][static_cast<Eigen::Index>(axis)]; }
  template <class Box>
  bool kdtree_get_bbox(Box&) const {
    return false;
  }
};

std::vector<Eigen::Vector3f> sorted(const std::vector<Eigen::Vector3f>& points,
                                    const std::vector<uint32_t>& order) {
  std::vector<Eigen::Vector3f> result;
  result.reserve(points.size());
  for (const uint32_t i : order) result.push_back(points[i]);
  return result;
}

}  // namespace

std::vector<float> by_gantry(const PointCloud& cloud, TriangleMesh mesh) {
  const SignedDistance distance(std::move(mesh));
  std::vector<float> distances(cloud.size());
  for_each_run(cloud.points, [&](std::span<const uint32_t> run) {
    SurfaceIndex::Neighbourhood near;
    for (const uint32_t i : run) distances[i] = distance(cloud.points[i], kAnywhere_mm, near)->distance;
  });
  return distances;
}

std::vector<float> by_embree(const PointCloud& cloud, const TriangleMesh& mesh) {
  RTCDevice device = rtcNewDevice(nullptr);
  RTCScene scene = rtcNewScene(device);
  RTCGeometry geometry = rtcNewGeometry(device, RTC_GEOMETRY_TYPE_TRIANGLE);
  auto* vertices = static_cast<float*>(rtcSetNewGeometryBuffer(
      geometry, RTC_BUFFER_TYPE_VERTEX, 0, RTC_FORMAT_FLOAT3, 3 * sizeof(float), mesh.vertices.size()));
  for (size_t i = 0; i < mesh.vertices.size(); ++i)
    Eigen::Map<Eigen::Vector3f>(vertices + 3 * i) = mesh.vertices[i];
  auto* indices = static_cast<unsigned*>(rtcSetNewGeometryBuffer(
      geometry, RTC_BUFFER_TYPE_INDEX, 0, RTC_FORMAT_UINT3, 3 * sizeof(unsigned), mesh.triangles.size()));
  for (size_t t = 0; t < mesh.triangles.size(); ++t)
    for (int k = 0; k < 3; ++k) indices[3 * t + k] = static_cast<unsigned>(mesh.triangles[t][k]);
  rtcCommitGeometry(geometry);
  rtcAttachGeometry(scene, geometry);
  rtcReleaseGeometry(geometry);
  rtcCommitScene(scene);
  std::vector<float> distances(cloud.size());
  for_each_run(cloud.points, [&](std::span<const uint32_t> run) {
    const Eigen::Vector3f* last = nullptr;
    Eigen::Vector3f closest;
    for (const uint32_t i : run) {
      const Eigen::Vector3f& p = cloud.points[i];
      EmbreeQuery state{&mesh, p.cast<double>(), std::numeric_limits<double>::infinity()};
      RTCPointQuery query{};
      query.x = p.x();
      query.y = p.y();
      query.z = p.z();
      query.radius = last ? 1.0001f * (p - closest).norm() + 1e-6f : kAnywhere_mm;
      RTCPointQueryContext context;
      rtcInitPointQueryContext(&context);
      rtcPointQuery(scene, &query, &context, visit, &state);
      distances[i] = static_cast<float>(std::sqrt(state.squared));
      closest = state.closest;
      last = &p;
    }
  });
  rtcReleaseScene(scene);
  rtcReleaseDevice(device);
  return distances;
}

std::vector<float> nearest_by_gantry(const PointCloud& cloud, const PointCloud& others) {
  const PointIndex index(others.points);
  std::vector<float> distances(cloud.size());
  for_each_run(cloud.points, [&](std::span<const uint32_t> run) {
    PointIndex::Neighbourhood near;
    for (const uint32_t i : run)
      distances[i] = std::sqrt(index.nearest(cloud.points[i], kAnywhere_mm, near)->squared_distance);
  });
  return distances;
}

std::vector<float> nearest_by_nanoflann(const PointCloud& cloud, const PointCloud& others) {
  const std::vector<uint32_t> order = morton_order(cloud.points);
  const std::vector<Eigen::Vector3f> queries = sorted(cloud.points, order),
                                     points = sorted(others.points, morton_order(others.points));
  const Adaptor adaptor{points};
  nanoflann::KDTreeSingleIndexAdaptor<nanoflann::L2_Simple_Adaptor<float, Adaptor>, Adaptor, 3, uint32_t>
      tree(3, adaptor, nanoflann::KDTreeSingleIndexAdaptorParams(10));
  tree.buildIndex();
  std::vector<float> distances(cloud.size());
  tbb::parallel_for(size_t{0}, queries.size(), [&](size_t i) {
    uint32_t index = 0;
    float squared = 0;
    nanoflann::KNNResultSet<float, uint32_t> result(1);
    result.init(&index, &squared);
    tree.findNeighbors(result, queries[i].data(), nanoflann::SearchParams());
    distances[order[i]] = std::sqrt(squared);
  });
  return distances;
}

}  // namespace gantry::bench
