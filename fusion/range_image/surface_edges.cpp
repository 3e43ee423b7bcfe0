#include "range_image/surface_edges.h"

#include <tbb/parallel_for.h>

#include <algorithm>
#include <array>
#include <cmath>
#include <optional>

namespace gantry::internal {
namespace {

constexpr int kHalf = 4;
constexpr int kSide = 2 * kHalf + 1;
/// Beyond 60 degrees of incidence the end of the data may be that of visibility.
constexpr float kLeastCosine = 0.5f;
/// Pixels nearer to the tangent plane than this are of the surface ...
constexpr float kOnPlaneInSigmas = 4, kOnPlaneInPitches = 0.5f;
/// ... and those further behind are of another one.
constexpr float kBehindInPitches = 5;
/// Of the window: pixels between the two, or on the wrong side of the line.
constexpr float kMostDoubtful = 0.06f;
constexpr size_t kMostEdges = 3000;
constexpr int kWidestShadow_px = 400;
/// How far (pitches per pixel) a tangent plane may be off, carried on.
constexpr float kPlaneSlack = 0.1f;

struct Window {
  int inside = 0, doubtful = 0;
  Eigen::Vector2f sum = Eigen::Vector2f::Zero();  ///< Of the offsets of inside pixels.
  std::array<bool, kSide * kSide> is_inside{};
};

/// Sorts the window's pixels; nothing if it cannot be told what the surface does there.
std::optional<Window> look_around(const RangeSurface& s, const std::vector<float>& measured, int column,
                                  int row, const Eigen::Vector3f& plane, float on_plane, float behind) {
  Window window;
  int k = 0;
  for (int dr = -kHalf; dr <= kHalf; ++dr)
    for (int dc = -kHalf; dc <= kHalf; ++dc, ++k) {
      const size_t i = s.index(column + dc, row + dr);
      const float w = measured[i];
      if (w == 0) {
        if (s.flags[i] & RangeSurface::kSeen) return std::nullopt;  // cropped
        continue;
      }
      const float expected = plane.dot(Eigen::Vector3f(1, static_cast<float>(dc), static_cast<float>(dr)));
      // How much nearer than the plane: 1 / z grows towards the sensor, z away from it.
      const float nearer = s.rays.central ? w - expected : expected - w;
      if (nearer > behind) return std::nullopt;
      if (std::abs(nearer) <= on_plane) {
        ++window.inside;
        window.sum += Eigen::Vector2f(static_cast<float>(dc), static_cast<float>(dr));
        window.is_inside[static_cast<size_t>(k)] = true;
      } else if (nearer > -behind) {
        ++window.doubtful;
      }
    }
  return window;
}

/// The straight line that divides the window: outwards . offset = distance. Nothing unless it does.
struct Line {
  Eigen::Vector2f outwards;
  float distance;
};
std::optional<Line> dividing_line(const Window& window) {
  constexpr float kAll = kSide * kSide;
  const float filled = static_cast<float>(window.inside) / kAll;
  if (filled < 0.35f || filled > 0.85f) return std::nullopt;
  const float length = window.sum.norm();
  if (!(length > 0)) return std::nullopt;
  Line line;
  line.outwards = -window.sum / length;
  // A line through a square cuts a side's length over the larger of cosine and sine, near the middle.
  const float cut = kSide / line.outwards.cwiseAbs().maxCoeff();
  line.distance = (static_cast<float>(window.inside) - kAll / 2) / cut;
  float wrong = static_cast<float>(window.doubtful);
  int k = 0;
  for (int dr = -kHalf; dr <= kHalf; ++dr)
    for (int dc = -kHalf; dc <= kHalf; ++dc, ++k) {
      const float beyond =
          line.outwards.dot(Eigen::Vector2f(static_cast<float>(dc), static_cast<float>(dr))) - line.distance;
      // Pixels on the line itself may be either.
      if (std::abs(beyond) > 0.7f && (beyond < 0) != window.is_inside[static_cast<size_t>(k)]) ++wrong;
    }
  if (wrong > kMostDoubtful * kAll) return std::nullopt;
  return line;
}

/// The image of a plane: w at an offset from a pixel is plane . (1, columns, rows).
struct TangentPlane {
  Eigen::Vector3d point, normal;
  const RangeSurface& surface;

  Eigen::Vector3d at(double column, double row) const {
    const Eigen::Vector2d ray = surface.rays.ray(column, row);
    if (!surface.rays.central)
      return {
          ray.x(), ray.y(),
          point.z() - (normal.x() * (ray.x() - point.x()) + normal.y() * (ray.y() - point.y())) / normal.z()};
    const Eigen::Vector3d along = ray.homogeneous();
    return along * (normal.dot(point) / normal.dot(along));
  }
  Eigen::Vector3f image(double column, double row) const {
    const auto w = [&](double c, double r) { return surface.rays.w_of(at(c, r)); };
    const double here = w(column, row);
    return Eigen::Vector3d(here, w(column + 1, row) - here, w(column, row + 1) - here).cast<float>();
  }
};

/// Whether the gap beyond the line ends at something nearer than the plane: then the gap may be its shadow
/// from the projector, which ends elsewhere on the surface when seen from elsewhere.
bool may_be_shadow(const RangeSurface& s, const std::vector<float>& measured, int column, int row,
                   const Line& line, const Eigen::Vector3f& plane, float behind, float pitch_w) {
  for (int step = kHalf; step < kWidestShadow_px; ++step) {
    const Eigen::Vector2f offset = (line.distance + static_cast<float>(step)) * line.outwards;
    const int c = column + static_cast<int>(std::lround(offset.x())),
              r = row + static_cast<int>(std::lround(offset.y()));
    if (c < 0 || r < 0 || c >= s.width || r >= s.height) return false;
    const float w = measured[s.index(c, r)];
    if (w == 0) continue;
    const float expected =
        plane.dot(Eigen::Vector3f(1, static_cast<float>(c - column), static_cast<float>(r - row)));
    const float nearer = s.rays.central ? w - expected : expected - w;
    return nearer > behind + kPlaneSlack * static_cast<float>(step) * pitch_w;
  }
  return false;
}

}  // namespace

std::vector<SurfaceEdge> find_edges(const RangeSurface& s, const std::vector<float>& measured, float noise_w,
                                    float pitch) {
  std::vector<std::vector<SurfaceEdge>> rows(static_cast<size_t>(s.height));
  tbb::parallel_for(kHalf, std::max(kHalf, s.height - kHalf), [&](int row) {
    for (int column = kHalf; column < s.width - kHalf; ++column) {
      const size_t i = s.index(column, row), width = static_cast<size_t>(s.width);
      if (s.w[i] == 0) continue;
      if (s.w[i - 1] != 0 && s.w[i + 1] != 0 && s.w[i - width] != 0 && s.w[i + width] != 0) continue;
      const Eigen::Vector3d p = s.point(column, row);
      const Eigen::Vector3d n = unpack_normal(s.normals[i]).cast<double>();
      const double cosine = s.rays.central ? -n.dot(p.normalized()) : -n.z();
      if (cosine < kLeastCosine) continue;
      const TangentPlane plane{p, n, s};
      const float pitch_w = s.rays.central ? pitch * s.w[i] : pitch;
      const Eigen::Vector3f image = plane.image(column, row);
      const float on_plane = std::max(kOnPlaneInSigmas * noise_w, kOnPlaneInPitches * pitch_w),
                  behind = std::max(2 * kOnPlaneInSigmas * noise_w, kBehindInPitches * pitch_w);
      const std::optional<Window> window = look_around(s, measured, column, row, image, on_plane, behind);
      if (!window) continue;
      const std::optional<Line> line = dividing_line(*window);
      if (!line || may_be_shadow(s, measured, column, row, *line, image, behind, pitch_w)) continue;
      const Eigen::Vector2d out = line->outwards.cast<double>(), edge = line->distance * out;
      const auto at = [&](const Eigen::Vector2d& offset) {
        return plane.at(column + offset.x(), row + offset.y());
      };
      SurfaceEdge found;
      const Eigen::Vector3d place = at(edge);
      const Eigen::Vector3d along = at(edge + Eigen::Vector2d(-out.y(), out.x())) - place;
      Eigen::Vector3d outwards = along.cross(n).normalized();
      if (outwards.dot(at(edge + out) - place) < 0) outwards = -outwards;
      found.point = place.cast<float>();
      found.normal = n.cast<float>();
      found.outwards = outwards.cast<float>();
      rows[static_cast<size_t>(row)].push_back(found);
    }
  });
  std::vector<SurfaceEdge> all;
  for (const auto& found : rows) all.insert(all.end(), found.begin(), found.end());
  if (all.size() <= kMostEdges) return all;
  std::vector<SurfaceEdge> some;
  for (size_t k = 0; k < kMostEdges; ++k) some.push_back(all[k * all.size() / kMostEdges]);
  return some;
}

}  // namespace gantry::internal
