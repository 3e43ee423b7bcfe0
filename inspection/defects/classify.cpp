#include "defects/classify.h"

#include <Eigen/Eigenvalues>
#include <algorithm>
#include <cmath>
#include <map>
#include <numbers>
#include <set>

#include "alignment/tessellation.h"
#include "gantry/geometry/point_index.h"

namespace gantry::internal {
namespace {

constexpr double kMissingShare = 0.5;  ///< Of the points: they continue another face ...
constexpr double kFaceShare = 0.5;     ///< ... across one of which so much is unseen or out of tolerance.
constexpr double kAlongCosine = 0.94;  ///< A point continues a face if its normal does (20 degrees).
constexpr double kOtherSign = 0.2;     ///< So many points of the other sign: it goes through the wall.
constexpr double kStandsOut = 0.1;     ///< Height over width.
constexpr double kEdgeShare = 0.15;    ///< So many points on each of two faces: it goes across their edge.
constexpr double kSteepCosine = 0.77;  ///< A flank: turned by 40 degrees against the CAD surface ...
constexpr double kSteepShare = 0.3;    ///< ... of so many of the points.
constexpr double kBackGood = 0.7;      ///< Share of the wall's other side that must have been seen.
constexpr size_t kBackProbes = 64;

class Classifier {
 public:
  Classifier(const DefectScene& scene, const std::vector<size_t>& members)
      : scene_(scene), members_(members) {
    for (const size_t i : members) {
      positive_ += scene.result.deviation_mm[i] > 0;
      ++on_face_[lying_on(i)];
    }
  }

  void run(Defect& defect) {
    const auto most = std::max_element(on_face_.begin(), on_face_.end(),
                                       [](const auto& a, const auto& b) { return a.second < b.second; });
    tell_face(defect, most->first);
    const double outwards = static_cast<double>(positive_) / count();
    if (missing_feature(defect)) return;
    const bool whole_face = covered(most->first) >= kFaceShare;
    if (outwards > kOtherSign && outwards < 1 - kOtherSign) {
      set(defect, DefectClass::kPartDefect,
          whole_face ? "bent or displaced, both sides alike" : "dent or bulge through the wall");
    } else if (outwards >= 0.5) {
      if (back_is_good() || (!whole_face && stands_out(defect))) {
        set(defect, DefectClass::kExtraMaterial, "stands out of the surface");
      } else {
        set(defect, DefectClass::kPartDefect, whole_face ? "face lies too far out" : "bulge");
      }
    } else if (back_is_good()) {
      set(defect, DefectClass::kMissingMaterial, "wall too thin");
    } else if (across_an_edge()) {
      set(defect, DefectClass::kMissingMaterial, "edge broken away");
    } else if (steep()) {
      set(defect, DefectClass::kMissingMaterial, "gouge or hole with steep flanks");
    } else {
      set(defect, DefectClass::kPartDefect, whole_face ? "face lies too far in" : "dent");
    }
  }

 private:
  double count() const { return static_cast<double>(members_.size()); }

  void set(Defect& defect, DefectClass kind, const std::string& words) const {
    defect.kind = kind;
    defect.words = words;
  }

  void tell_face(Defect& defect, size_t face) const {
    defect.face = scene_.cad.faces[face].name;
    defect.face_words = scene_.cad.faces[face].words;
  }

  /// The face that a point's deviation is measured to: of a point beside the surface the one that looks at it
  /// at its foot, the wall of a hole.
  size_t lying_on(size_t i) const {
    if (!scene_.feet.beside[i]) return scene_.face(i);
    const Eigen::Vector3f offset = scene_.surface.points[i] - scene_.feet.point[i];
    const float outside = scene_.result.deviation_mm[i] > 0 ? 1.0f : -1.0f;
    const auto wall = scene_.reference(scene_.feet.point[i], outside * offset.normalized(), 0.7f, 0.2f);
    return wall ? static_cast<size_t>(scene_.cad.face_of_triangle[wall->triangle]) : scene_.face(i);
  }

  /// Share of the face's judged points that are in the region.
  double covered(size_t face) const {
    const double judged = static_cast<double>(scene_.result.faces[face].points);
    return judged > 0 ? on_face_.at(face) / judged : 1;
  }

  /// The faces within two steps that a point may continue.
  std::set<size_t> around(size_t face) const {
    std::set<size_t> result;
    for (const int near : scene_.cad.faces[face].neighbours) {
      result.insert(static_cast<size_t>(near));
      for (const int far : scene_.cad.faces[static_cast<size_t>(near)].neighbours)
        result.insert(static_cast<size_t>(far));
    }
    result.erase(face);
    return result;
  }

  bool missing_feature(Defect& defect) const {
    if (!scene_.result.cloud.has_normals()) return false;
    std::map<size_t, std::set<size_t>> near;
    std::map<size_t, double> continuing;  // points, by the face that they go across
    for (const size_t i : members_) {
      const size_t face = lying_on(i);
      auto [found, fresh] = near.try_emplace(face);
      if (fresh) found->second = around(face);
      const Eigen::Vector3d p = scene_.surface.points[i].cast<double>();
      const Eigen::Vector3d n = scene_.result.cloud.normals[i].cast<double>();
      for (const size_t other : found->second) {
        const CadSurface& surface = scene_.cad.faces[other].surface;
        if (surface.kind == SurfaceKind::kFreeform) continue;
        if (std::abs(surface.distance(p)) <= scene_.options.tolerance_mm &&
            surface.normal_at(p).dot(n) > kAlongCosine) {
          ++continuing[face];
          break;
        }
      }
    }
    double all = 0, best = 0;
    size_t lost = 0;
    for (const auto& [face, points] : continuing) {
      all += points;
      if (points > best) {
        best = points;
        lost = face;
      }
    }
    if (all < kMissingShare * count()) return false;
    const SurfaceStatistics& seen = scene_.result.faces[lost];
    if (seen.seen >= 1 - kFaceShare && covered(lost) < kFaceShare) return false;
    tell_face(defect, lost);
    const bool filled = 2 * positive_ > members_.size();
    set(defect, DefectClass::kMissingFeature,
        filled ? "not made: material is in its place" : "not there: material is missing in its place");
    const CadFace& face = scene_.cad.faces[lost];
    constexpr double kRound = 1.5 * std::numbers::pi;
    if (filled && face.surface.kind == SurfaceKind::kCylinder && face.surface.hollow &&
        face.turn_rad > kRound)
      // As far as it was to go: its wall's area is 2 pi r times the depth.
      defect.extra_mm3 = face.area_mm2 * face.surface.radius_mm / 2;
    return true;
  }

  /// The wall's other side, where there is one close by, was seen and is in tolerance (or the region would
  /// have both signs).
  bool back_is_good() const {
    if (!back_) {
      // Walls up to twice the linking distance; further away it is another part of the part.
      const auto depth = static_cast<float>(2 * scene_.options.link_distance_mm);
      const CoverageSamples& samples = scene_.samples;
      const PointIndex index(samples.surface.points);
      std::vector<PointIndex::Neighbour> near;
      size_t found = 0, seen = 0;
      const size_t stride = members_.size() / kBackProbes + 1;
      size_t probes = 0;
      for (size_t k = 0; k < members_.size(); k += stride, ++probes) {
        const size_t i = members_[k];
        const Eigen::Vector3f foot = scene_.feet.point[i], normal = scene_.foot_normal(i);
        index.within(foot, depth, near);
        const PointIndex::Neighbour* back = nullptr;
        for (const auto& n : near) {
          const Eigen::Vector3f step = samples.surface.points[n.index] - foot;
          const float across = -step.dot(normal);
          if (samples.surface.normals[n.index].dot(normal) < -0.9f && across > 0 &&
              (step + across * normal).norm() < 1.5f &&
              (!back || n.squared_distance < back->squared_distance))
            back = &n;
        }
        if (!back) continue;
        ++found;
        seen += samples.seen[back->index];
      }
      back_ = 2 * found > probes && static_cast<double>(seen) >= kBackGood * static_cast<double>(found);
    }
    return *back_;
  }

  /// Higher than a tenth of its width across, the smaller one where it is long.
  bool stands_out(const Defect& defect) const {
    Eigen::Vector3d mean = Eigen::Vector3d::Zero();
    for (const size_t i : members_) mean += scene_.feet.point[i].cast<double>() / count();
    Eigen::Matrix3d spread = Eigen::Matrix3d::Zero();
    for (const size_t i : members_) {
      const Eigen::Vector3d d = scene_.feet.point[i].cast<double>() - mean;
      spread += d * d.transpose() / count();
    }
    const Eigen::SelfAdjointEigenSolver<Eigen::Matrix3d> solver(spread, Eigen::EigenvaluesOnly);
    const double width = std::sqrt(12 * std::max(0.0, solver.eigenvalues()[1]));  // of an even strip
    return std::abs(defect.peak_mm) > kStandsOut * width;
  }

  bool across_an_edge() const {
    std::vector<size_t> faces;
    for (const auto& [face, points] : on_face_)
      if (points >= kEdgeShare * count()) faces.push_back(face);
    for (const size_t a : faces)
      for (const size_t b : faces) {
        if (a >= b) continue;
        const auto& near = scene_.cad.faces[a].neighbours;
        if (!std::binary_search(near.begin(), near.end(), static_cast<int>(b))) continue;
        Eigen::Vector3f on_a = Eigen::Vector3f::Zero(), on_b = on_a;
        for (const size_t i : members_) {
          if (scene_.face(i) == a) on_a += scene_.foot_normal(i);
          if (scene_.face(i) == b) on_b += scene_.foot_normal(i);
        }
        if (on_a.stableNormalized().dot(on_b.stableNormalized()) < std::cos(kSmooth_rad)) return true;
      }
    return false;
  }

  bool steep() const {
    if (!scene_.result.cloud.has_normals()) return false;
    double flanks = 0;
    for (const size_t i : members_)
      flanks += scene_.result.cloud.normals[i].dot(scene_.foot_normal(i)) < kSteepCosine;
    return flanks >= kSteepShare * count();
  }

  const DefectScene& scene_;
  const std::vector<size_t>& members_;
  size_t positive_ = 0;
  std::map<size_t, double> on_face_;  ///< Points, by the face that their deviation is measured to.
  mutable std::optional<bool> back_;
};

}  // namespace

void classify(Defect& defect, const DefectScene& scene, const std::vector<size_t>& members) {
  Classifier(scene, members).run(defect);
}

}  // namespace gantry::internal

namespace gantry {

std::string_view to_string(DefectClass defect_class) {
  switch (defect_class) {
    case DefectClass::kPartDefect:
      return "part defect";
    case DefectClass::kMissingFeature:
      return "missing feature";
    case DefectClass::kMissingMaterial:
      return "missing material";
    case DefectClass::kExtraMaterial:
      return "extra material";
    case DefectClass::kRegistrationResidue:
      return "registration residue";
    case DefectClass::kFixture:
      return "fixture";
    case DefectClass::kNoData:
      return "no data";
  }
  return "part defect";
}

}  // namespace gantry
