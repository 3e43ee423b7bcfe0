#include <algorithm>
#include <cmath>
#include <map>
#include <numbers>
#include <set>

#include "alignment/tessellation.h"
#include "cad_faces/face_words.h"
#include "cad_faces/primitive_fit.h"
#include "gantry/inspection/cad_faces.h"

namespace gantry {
namespace internal {
namespace {

constexpr double kToleranceMm = 1e-3, kToleranceOfSize = 1e-5;
/// So many flats and corners must lie on a curved surface: fewer fit one by chance.
constexpr size_t kLeastFlats = 4, kLeastCorners = 10;
constexpr std::array<size_t, 2> kPatchFlats = {5, 9};  ///< That a curved surface is first looked for in.
constexpr double kPlaneShare = 0.002;  ///< Of the whole area: a flat of this is a face, however it ends ...
constexpr double kSharpShare = 0.6;    ///< ... as is one with this share of its border at sharp edges.
/// A small curved face must end at sharp edges or run into faces already known along this share of its
/// border: any patch of a finely meshed freeform surface lies close to some sphere.
constexpr double kAnchoredShare = 0.3;
constexpr double kLargeShare = 0.02;     ///< Of the whole area: a curved face of this is one however it ends.
constexpr double kSmallestShare = 2e-4;  ///< Of the whole area: smaller freeform pieces join a neighbour.
constexpr double kLoose = 10;  ///< Times the tolerance: a face's own facets that are not meshed exactly ...
constexpr double kLooseCosine = 0.9997;  ///< ... if they face along its surface (1.4 degrees).

struct Piece {
  CadSurface surface;
  std::vector<int> flats;
};

class Segmenter {
 public:
  explicit Segmenter(const TriangleMesh& mesh) : adjacent_(adjacent_triangles(mesh)) {
    tolerance_ = std::max(kToleranceMm, kToleranceOfSize * mesh.bounds().diagonal().norm());
    flats_ = find_flats(mesh, adjacent_, tolerance_ / 2);
    for (const Flat& flat : flats_) area_ += flat.area_mm2;
    piece_of_.assign(flats_.size(), -1);
    tried_.assign(flats_.size(), 0);
  }

  void run() {
    std::vector<int> order(flats_.size());
    for (size_t f = 0; f < order.size(); ++f) order[f] = static_cast<int>(f);
    std::stable_sort(order.begin(), order.end(),
                     [&](int a, int b) { return flats_[a].area_mm2 > flats_[b].area_mm2; });
    for (const int seed : order)
      if (piece_of_[seed] < 0 && !tried_[seed]) {
        if (take_curved(seed)) continue;
        if (is_plane(seed)) take_plane(seed);
      }
    take_inexact();
    take_freeform(order);
    join_small();
  }

  const std::vector<Flat>& flats() const { return flats_; }
  const std::vector<Piece>& pieces() const { return pieces_; }
  const std::vector<std::array<int, 3>>& adjacent() const { return adjacent_; }

 private:
  bool sharp_enough(std::span<const int> members, double share) const {
    const std::set<int> inside(members.begin(), members.end());
    double sharp = 0, all = 0;
    for (const int f : members) {
      sharp += flats_[f].open_mm;
      all += flats_[f].open_mm;
      for (const auto& border : flats_[f].borders) {
        if (inside.contains(border.flat)) continue;
        all += border.length_mm;
        if (!border.smooth) sharp += border.length_mm;
      }
    }
    return all == 0 || sharp >= share * all;
  }

  /// Runs into known faces, or ends sharply, along enough of its border.
  bool anchored(std::span<const int> members) const {
    const std::set<int> inside(members.begin(), members.end());
    double held = 0, all = 0;
    for (const int f : members) {
      held += flats_[f].open_mm;
      all += flats_[f].open_mm;
      for (const auto& border : flats_[f].borders) {
        if (inside.contains(border.flat)) continue;
        all += border.length_mm;
        if (!border.smooth || piece_of_[border.flat] >= 0) held += border.length_mm;
      }
    }
    return all == 0 || held >= kAnchoredShare * all;
  }

  bool is_plane(int f) const {
    if (flats_[f].area_mm2 >= kPlaneShare * area_) return true;
    return flats_[f].area_mm2 >= kSmallestShare * area_ && sharp_enough(std::array{f}, kSharpShare);
  }

  /// Grows over the longest border each time: along the strips of a fillet, not out of it at their ends.
  std::vector<int> patch_around(int seed, size_t count) const {
    std::vector<int> patch{seed};
    while (patch.size() < count) {
      const Flat::Border* longest = nullptr;
      for (const int f : patch)
        for (const auto& border : flats_[f].borders)
          if (border.smooth && piece_of_[border.flat] < 0 &&
              (!longest || border.length_mm > longest->length_mm) &&
              std::find(patch.begin(), patch.end(), border.flat) == patch.end())
            longest = &border;
      if (!longest) break;
      patch.push_back(longest->flat);
    }
    return patch;
  }

  bool all_lie_on(const CadSurface& surface, std::span<const int> members) const {
    return std::all_of(members.begin(), members.end(),
                       [&](int f) { return lies_on(surface, flats_[f], tolerance_); });
  }

  std::vector<int> grown(const CadSurface& surface, int seed) const {
    std::vector<int> members{seed};
    std::set<int> seen{seed};
    for (size_t k = 0; k < members.size(); ++k)
      for (const auto& border : flats_[members[k]].borders)
        if (border.smooth && piece_of_[border.flat] < 0 && seen.insert(border.flat).second &&
            lies_on(surface, flats_[border.flat], tolerance_))
          members.push_back(border.flat);
    return members;
  }

  double area_of(std::span<const int> members) const {
    double area = 0;
    for (const int f : members) area += flats_[f].area_mm2;
    return area;
  }

  /// The largest curved surface through the seed that enough facets hold.
  bool take_curved(int seed) {
    Piece best;
    double best_area = 0;
    for (const size_t count : kPatchFlats) {
      const std::vector<int> patch = patch_around(seed, count);
      if (patch.size() < kLeastFlats) break;
      for (const SurfaceKind kind : {SurfaceKind::kCylinder, SurfaceKind::kCone, SurfaceKind::kSphere}) {
        auto surface = fit_surface(kind, flats_, patch);
        if (!surface || !all_lie_on(*surface, patch)) continue;
        std::vector<int> members = grown(*surface, seed);
        for (size_t before = patch.size(); members.size() > before;) {  // a wider base holds it better
          before = members.size();
          const auto refined = fit_surface(kind, flats_, members);
          if (!refined || !all_lie_on(*refined, members)) break;
          surface = refined;
          members = grown(*surface, seed);
        }
        if (const double area = area_of(members); area > best_area * 1.01) {
          best_area = area;
          best = {*surface, std::move(members)};
        }
      }
    }
    size_t corners = 0;
    for (const int f : best.flats) corners += flats_[f].corners.size();
    if (best.flats.size() < kLeastFlats || corners < kLeastCorners) return false;
    if (best_area < kLargeShare * area_ && !sharp_enough(best.flats, kAnchoredShare) &&
        (!anchored(best.flats) || single_row(best))) {
      for (const int f : best.flats) tried_[f] = 1;
      return true;  // stays for a freeform face
    }
    for (const int f : best.flats) piece_of_[f] = static_cast<int>(pieces_.size());
    pieces_.push_back(std::move(best));
    return true;
  }

  /// All corners lie on two circles about the axis, so that any surface of revolution could be the one, and
  /// the surface goes on smoothly beyond them.
  bool single_row(const Piece& piece) const {
    if (piece.surface.kind == SurfaceKind::kSphere) return false;
    std::vector<double> along;
    for (const int f : piece.flats)
      for (const Eigen::Vector3d& p : flats_[f].corners)
        along.push_back((p - piece.surface.point).dot(piece.surface.axis));
    const auto [low, high] = std::minmax_element(along.begin(), along.end());
    const double from = *low, to = *high;
    if (!std::all_of(along.begin(), along.end(),
                     [&](double a) { return std::min(a - from, to - a) <= tolerance_; }))
      return false;
    const std::set<int> inside(piece.flats.begin(), piece.flats.end());
    double smooth_rings = 0, rings = 0;  // border that runs round the axis
    for (const int f : piece.flats)
      for (const auto& border : flats_[f].borders) {
        if (inside.contains(border.flat)) continue;
        const Eigen::Vector3d step = flats_[border.flat].centroid - flats_[f].centroid;
        const double beside = std::abs(step.dot(piece.surface.axis)) / std::max(step.norm(), 1e-12);
        if (beside < 0.1 && piece.surface.kind == SurfaceKind::kCylinder) continue;
        rings += border.length_mm;
        if (border.smooth && piece_of_[border.flat] < 0) smooth_rings += border.length_mm;
      }
    return rings > 0 && smooth_rings > 0.4 * rings;
  }

  void take_plane(int f) {
    CadSurface surface;
    surface.kind = SurfaceKind::kPlane;
    surface.point = flats_[f].centroid;
    surface.axis = flats_[f].normal;
    piece_of_[f] = static_cast<int>(pieces_.size());
    pieces_.push_back({surface, {f}});
  }

  /// Faces, the largest first, take the flats around them that lie on them nearly: of no face or of a
  /// smaller one.
  void take_inexact() {
    std::vector<size_t> order(pieces_.size());
    std::vector<double> area(pieces_.size());
    for (size_t p = 0; p < pieces_.size(); ++p) {
      order[p] = p;
      area[p] = area_of(pieces_[p].flats);
    }
    std::stable_sort(order.begin(), order.end(), [&](size_t a, size_t b) { return area[a] > area[b]; });
    for (const size_t p : order) {
      const CadSurface& surface = pieces_[p].surface;
      const auto nearly = [&](const Flat& flat) {
        return surface.normal_at(flat.centroid).dot(flat.normal) >= kLooseCosine &&
               std::all_of(flat.corners.begin(), flat.corners.end(), [&](const Eigen::Vector3d& c) {
                 return std::abs(surface.distance(c)) <= kLoose * tolerance_;
               });
      };
      std::vector<int>& members = pieces_[p].flats;
      for (size_t k = 0; k < members.size(); ++k)
        for (const auto& border : flats_[members[k]].borders) {
          const int owner = piece_of_[border.flat];
          if (!border.smooth || owner == static_cast<int>(p) ||
              (owner >= 0 && area[static_cast<size_t>(owner)] >= area[p]) || !nearly(flats_[border.flat]))
            continue;
          if (owner >= 0) std::erase(pieces_[owner].flats, border.flat);
          piece_of_[border.flat] = static_cast<int>(p);
          members.push_back(border.flat);
        }
    }
  }

  void take_freeform(const std::vector<int>& order) {
    for (const int seed : order) {
      if (piece_of_[seed] >= 0) continue;
      Piece piece;
      piece.flats.push_back(seed);
      piece_of_[seed] = static_cast<int>(pieces_.size());
      for (size_t k = 0; k < piece.flats.size(); ++k)
        for (const auto& border : flats_[piece.flats[k]].borders)
          if (border.smooth && piece_of_[border.flat] < 0) {
            piece_of_[border.flat] = static_cast<int>(pieces_.size());
            piece.flats.push_back(border.flat);
          }
      pieces_.push_back(std::move(piece));
    }
  }

  /// Pieces too small to be told of that no sharp edges part from the rest join the neighbour that they share
  /// the longest border with.
  void join_small() {
    for (size_t p = 0; p < pieces_.size(); ++p) {
      if (pieces_[p].flats.empty() || area_of(pieces_[p].flats) >= kSmallestShare * area_ ||
          (pieces_[p].surface.kind != SurfaceKind::kFreeform && sharp_enough(pieces_[p].flats, kSharpShare)))
        continue;
      std::map<int, double> shared;
      for (const int f : pieces_[p].flats)
        for (const auto& border : flats_[f].borders)
          if (piece_of_[border.flat] != static_cast<int>(p))
            shared[piece_of_[border.flat]] += border.length_mm;
      if (shared.empty()) continue;
      const int into = std::max_element(shared.begin(), shared.end(), [](const auto& a, const auto& b) {
                         return a.second < b.second;
                       })->first;
      for (const int f : pieces_[p].flats) {
        piece_of_[f] = into;
        pieces_[into].flats.push_back(f);
      }
      pieces_[p].flats.clear();
    }
  }

  std::vector<std::array<int, 3>> adjacent_;
  double tolerance_ = 0, area_ = 0;
  std::vector<Flat> flats_;
  std::vector<Piece> pieces_;
  std::vector<int> piece_of_;  ///< Of each flat; -1: not yet.
  std::vector<unsigned char> tried_;
};

/// How far round the axis the corners of a cylinder or cone go.
double turn_about(const CadSurface& surface, const std::vector<Eigen::Vector3d>& corners) {
  const Eigen::Vector3d u = surface.axis.unitOrthogonal(), v = surface.axis.cross(u);
  std::vector<double> angles;
  for (const Eigen::Vector3d& p : corners) {
    const Eigen::Vector3d d = p - surface.point;
    if ((d - d.dot(surface.axis) * surface.axis).norm() > 1e-6)
      angles.push_back(std::atan2(v.dot(d), u.dot(d)));
  }
  if (angles.empty()) return 0;
  std::sort(angles.begin(), angles.end());
  double gap = angles.front() + 2 * std::numbers::pi - angles.back();
  for (size_t i = 1; i < angles.size(); ++i) gap = std::max(gap, angles[i] - angles[i - 1]);
  return gap < 2 * kSmooth_rad ? 2 * std::numbers::pi : 2 * std::numbers::pi - gap;
}

CadFace face_of(const Piece& piece, const std::vector<Flat>& flats) {
  CadFace face;
  face.surface = piece.surface;
  face.centre_mm.setZero();
  face.normal.setZero();
  std::vector<Eigen::Vector3d> corners;
  for (const int f : piece.flats) {
    const Flat& flat = flats[f];
    face.area_mm2 += flat.area_mm2;
    face.centre_mm += flat.area_mm2 * flat.centroid;
    face.normal += flat.area_mm2 * flat.normal;
    face.triangles.insert(face.triangles.end(), flat.triangles.begin(), flat.triangles.end());
    corners.insert(corners.end(), flat.corners.begin(), flat.corners.end());
  }
  for (const Eigen::Vector3d& p : corners) face.box.extend(p);
  face.centre_mm /= face.area_mm2;
  face.normal =
      face.normal.norm() > 1e-3 * face.area_mm2 ? face.normal.normalized() : Eigen::Vector3d(0, 0, 0);
  std::sort(face.triangles.begin(), face.triangles.end());
  CadSurface& surface = face.surface;
  if (surface.kind == SurfaceKind::kCylinder || surface.kind == SurfaceKind::kCone)
    face.turn_rad = turn_about(surface, corners);
  if (surface.kind == SurfaceKind::kCylinder) {  // the axis has two directions: the one towards + is told
    Eigen::Index most;
    surface.axis.cwiseAbs().maxCoeff(&most);
    if (surface.axis[most] < 0) surface.axis = -surface.axis;
    surface.point += (face.centre_mm - surface.point).dot(surface.axis) * surface.axis;
  }
  return face;
}

/// By kind, then by falling area; faces of one area (to a thousandth) by their place.
void sort_faces(std::vector<CadFace>& faces) {
  std::stable_sort(faces.begin(), faces.end(), [](const CadFace& a, const CadFace& b) {
    return a.surface.kind != b.surface.kind ? a.surface.kind < b.surface.kind : a.area_mm2 > b.area_mm2;
  });
  const auto place = [](const CadFace& f) {
    const Eigen::Vector3d p = (f.centre_mm * 100).array().round();  // hundredths: below that is rounding
    return std::make_tuple(p.x(), p.y(), p.z());
  };
  for (size_t begin = 0, end = 0; begin < faces.size(); begin = end) {
    for (end = begin + 1; end < faces.size(); ++end)
      if (faces[end].surface.kind != faces[begin].surface.kind ||
          faces[end].area_mm2 < 0.999 * faces[begin].area_mm2)
        break;
    std::stable_sort(faces.begin() + static_cast<std::ptrdiff_t>(begin),
                     faces.begin() + static_cast<std::ptrdiff_t>(end),
                     [&](const CadFace& a, const CadFace& b) { return place(a) < place(b); });
  }
}

}  // namespace
}  // namespace internal

CadFaces segment_faces(const TriangleMesh& mesh) {
  internal::Segmenter segmenter(mesh);
  segmenter.run();
  CadFaces result;
  for (const auto& piece : segmenter.pieces())
    if (!piece.flats.empty()) result.faces.push_back(internal::face_of(piece, segmenter.flats()));
  internal::sort_faces(result.faces);

  result.face_of_triangle.assign(mesh.triangles.size(), -1);
  std::map<SurfaceKind, int> count;
  for (size_t f = 0; f < result.faces.size(); ++f) {
    CadFace& face = result.faces[f];
    face.name = std::string(to_string(face.surface.kind)) + " " + std::to_string(++count[face.surface.kind]);
    face.words = internal::face_words(face);
    for (const int t : face.triangles) result.face_of_triangle[t] = static_cast<int>(f);
  }
  // Triangles without area belong to the face of a neighbour, so that every triangle has one.
  const auto& adjacent = segmenter.adjacent();
  for (bool changed = true; changed;) {
    changed = false;
    for (size_t t = 0; t < mesh.triangles.size(); ++t)
      for (const int other : adjacent[t])
        if (result.face_of_triangle[t] < 0 && other >= 0 && result.face_of_triangle[other] >= 0) {
          result.face_of_triangle[t] = result.face_of_triangle[other];
          changed = true;
        }
  }
  for (int& face : result.face_of_triangle) face = std::max(face, 0);
  std::vector<std::set<int>> neighbours(result.faces.size());
  for (size_t t = 0; t < mesh.triangles.size(); ++t)
    for (const int other : adjacent[t])
      if (other >= 0 && result.face_of_triangle[other] != result.face_of_triangle[t])
        neighbours[result.face_of_triangle[t]].insert(result.face_of_triangle[other]);
  for (size_t f = 0; f < result.faces.size(); ++f)
    result.faces[f].neighbours.assign(neighbours[f].begin(), neighbours[f].end());
  return result;
}

}  // namespace gantry
