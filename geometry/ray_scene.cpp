#include "gantry/geometry/ray_scene.h"

#include <embree3/rtcore.h>

#include "gantry/foundation/error.h"

namespace gantry {

struct RayScene::Impl {
  TriangleMesh mesh;
  RTCDevice device = nullptr;
  RTCScene scene = nullptr;

  ~Impl() {
    if (scene) rtcReleaseScene(scene);
    if (device) rtcReleaseDevice(device);
  }
};

RayScene::RayScene(TriangleMesh mesh) : impl_(std::make_unique<Impl>()) {
  if (mesh.triangles.empty()) throw InputError("a mesh without triangles cannot be used for ray casting");
  impl_->mesh = std::move(mesh);
  const TriangleMesh& m = impl_->mesh;

  impl_->device = rtcNewDevice(nullptr);
  impl_->scene = rtcNewScene(impl_->device);
  rtcSetSceneFlags(impl_->scene, RTC_SCENE_FLAG_ROBUST);
  RTCGeometry geometry = rtcNewGeometry(impl_->device, RTC_GEOMETRY_TYPE_TRIANGLE);
  auto* vertices = static_cast<float*>(rtcSetNewGeometryBuffer(
      geometry, RTC_BUFFER_TYPE_VERTEX, 0, RTC_FORMAT_FLOAT3, 3 * sizeof(float), m.vertices.size()));
  for (size_t i = 0; i < m.vertices.size(); ++i)
    Eigen::Map<Eigen::Vector3f>(vertices + 3 * i) = m.vertices[i];
  auto* indices = static_cast<unsigned*>(rtcSetNewGeometryBuffer(
      geometry, RTC_BUFFER_TYPE_INDEX, 0, RTC_FORMAT_UINT3, 3 * sizeof(unsigned), m.triangles.size()));
  for (size_t t = 0; t < m.triangles.size(); ++t)
    for (int k = 0; k < 3; ++k) indices[3 * t + k] = static_cast<unsigned>(m.triangles[t][k]);
  rtcCommitGeometry(geometry);
  rtcAttachGeometry(impl_->scene, geometry);
  rtcReleaseGeometry(geometry);
  rtcCommitScene(impl_->scene);
}

RayScene::~RayScene() = default;
RayScene::RayScene(RayScene&&) noexcept = default;
RayScene& RayScene::operator=(RayScene&&) noexcept = default;

const TriangleMesh& RayScene::mesh() const {
  return impl_->mesh;
}

std::optional<RayScene::Hit> RayScene::cast(const Eigen::Vector3f& origin, const Eigen::Vector3f& direction,
                                            float max_distance) const {
  RTCRayHit query{};
  query.ray.org_x = origin.x();
  query.ray.org_y = origin.y();
  query.ray.org_z = origin.z();
  query.ray.dir_x = direction.x();
  query.ray.dir_y = direction.y();
  query.ray.dir_z = direction.z();
  query.ray.tnear = 0;
  query.ray.tfar = max_distance;
  query.ray.mask = 0xFFFFFFFF;  // Debian builds Embree with ray masks on: without this every ray misses
  query.hit.geomID = RTC_INVALID_GEOMETRY_ID;
  RTCIntersectContext context;
  rtcInitIntersectContext(&context);
  rtcIntersect1(impl_->scene, &context, &query);
  if (query.hit.geomID == RTC_INVALID_GEOMETRY_ID) return std::nullopt;
  return Hit{query.ray.tfar, static_cast<int>(query.hit.primID), query.hit.u, query.hit.v};
}

bool RayScene::occluded(const Eigen::Vector3f& from, const Eigen::Vector3f& to) const {
  RTCRay ray{};
  const Eigen::Vector3f direction = to - from;
  ray.org_x = from.x();
  ray.org_y = from.y();
  ray.org_z = from.z();
  ray.dir_x = direction.x();
  ray.dir_y = direction.y();
  ray.dir_z = direction.z();
  ray.tnear = 1e-4f;
  ray.tfar = 1 - 1e-4f;
  ray.mask = 0xFFFFFFFF;
  RTCIntersectContext context;
  rtcInitIntersectContext(&context);
  rtcOccluded1(impl_->scene, &context, &ray);
  return ray.tfar < 0;
}

}  // namespace gantry
