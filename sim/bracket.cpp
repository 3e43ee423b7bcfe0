#include "gantry/sim/bracket.h"

#include <algorithm>
#include <cmath>
#include <functional>
#include <map>
#include <numbers>

namespace gantry {
namespace {

using std::numbers::pi;

// The flat pattern: u runs along the folded profile, v across the sheet. The profile of the sheet's
// middle surface, in the x-z plane: down the back flange, round the first bend, along the base, round
// the second bend, up the front flange.
constexpr double kWidth = 80, kHalfThickness = 1, kBendRadius = 4;
constexpr double kBendLength = kBendRadius * pi / 2;
constexpr double kBackLength = 55, kBaseLength = 110, kFrontLength = 30;
constexpr double kBend1 = kBackLength, kBase = kBend1 + kBendLength, kBend2 = kBase + kBaseLength,
                 kFront = kBend2 + kBendLength, kTotal = kFront + kFrontLength;

double u_at_back_height(double z) {
  return 60 - z;
}
double u_at_base_x(double x) {
  return kBase + x - 5;
}
double u_at_front_height(double z) {
  return kFront + z - 5;
}

struct Hole {
  double u, v, radius, block;  // block: half side of the square that the O-grid fills
  bool may_be_missing;
};

std::vector<Hole> all_holes() {
  return {{u_at_back_height(36), -14, 10, 14, false}, {u_at_base_x(20), -27, 4, 6, false},
          {u_at_base_x(20), 27, 4, 6, false},         {u_at_base_x(100), -27, 4, 6, false},
          {u_at_base_x(100), 27, 4, 6, true},         {u_at_front_height(20), -24, 3, 5, false},
          {u_at_front_height(20), 24, 3, 5, false}};
}

std::vector<Hole> drilled_holes(const BracketDefects& defects) {
  std::vector<Hole> holes = all_holes();
  if (defects.missing_hole) std::erase_if(holes, [](const Hole& h) { return h.may_be_missing; });
  return holes;
}

// The bead: a raised-cosine ridge along the middle of the base.
const double kBeadFrom = u_at_base_x(35), kBeadTo = u_at_base_x(85);
constexpr double kBeadHalfWidth = 5, kBeadHeight = 2.5;

const double kDentU = u_at_back_height(30);
constexpr double kDentV = 22, kDentRadius = 4;

const double kBurrU = u_at_base_x(60);
constexpr double kBurrV = -39, kBurrHalfWidth = 1, kBurrHalfLength = 6;

double raised_cosine(double x) {
  return std::abs(x) < 1 ? std::pow(std::cos(pi / 2 * x), 2) : 0.0;
}

double bead(double u, double v) {
  const double along = std::max({kBeadFrom - u, u - kBeadTo, 0.0});
  return kBeadHeight * raised_cosine(std::hypot(along, v) / kBeadHalfWidth);
}

double dent(double u, double v) {
  return raised_cosine(std::hypot(u - kDentU, v - kDentV) / kDentRadius);
}

double burr(double u, double v) {
  const double along = std::max(std::abs(u - kBurrU) - (kBurrHalfLength - kBurrHalfWidth), 0.0);
  return raised_cosine(std::hypot(along, v - kBurrV) / kBurrHalfWidth);
}

struct Frame {
  Eigen::Vector3d point, normal;  // of the middle surface; the normal points to the inside of the U
};

/// Folds the flat pattern. `lean` is added to the second bend's angle of 90 degrees.
Frame fold(double u, double v, double lean) {
  if (u <= kBend1) return {{1, v, 60 - u}, {1, 0, 0}};
  if (u < kBase) {
    const double a = (u - kBend1) / kBendRadius;
    const Eigen::Vector3d n(std::cos(a), 0, std::sin(a));
    return {Eigen::Vector3d(5, v, 5) - kBendRadius * n, n};
  }
  if (u <= kBend2) return {{u - kBase + 5, v, 1}, {0, 0, 1}};
  const double full = pi / 2 - lean;
  const double a = std::min((u - kBend2) / kBendLength, 1.0) * full;
  const Eigen::Vector3d n(-std::sin(a), 0, std::cos(a));
  const Eigen::Vector3d tangent(std::cos(a), 0, std::sin(a));
  return {Eigen::Vector3d(115, v, 5) - kBendRadius * n + std::max(u - kFront, 0.0) * tangent, n};
}

/// A point of the sheet's surface; side +1 is the inside of the U, -1 the outside.
Eigen::Vector3d surface(double u, double v, int side, const BracketDefects& d) {
  const Frame f = fold(u, v, d.flange_bend_rad);
  double offset = side * kHalfThickness + bead(u, v) + d.dent_depth_mm * dent(u, v);
  if (side > 0) offset += d.burr_height_mm * burr(u, v);
  return f.point + offset * f.normal;
}

/// Grid lines from `from` to `to`: no gap wider than `coarse`, and `fine` where details demand it. Marks are
/// hit exactly.
std::vector<double> grid_lines(double from, double to, double coarse,
                               const std::vector<std::array<double, 3>>& fine_spans) {
  std::vector<double> marks = {from, to};
  for (const auto& s : fine_spans) marks.insert(marks.end(), {s[0], s[1]});
  std::sort(marks.begin(), marks.end());
  marks.erase(std::unique(marks.begin(), marks.end(), [](double a, double b) { return b - a < 1e-6; }),
              marks.end());
  std::vector<double> lines = {marks.front()};
  for (size_t i = 1; i < marks.size(); ++i) {
    const double a = marks[i - 1], b = marks[i], middle = 0.5 * (a + b);
    double step = coarse;
    for (const auto& s : fine_spans)
      if (middle > s[0] && middle < s[1]) step = std::min(step, s[2]);
    const int n = std::max(1, static_cast<int>(std::ceil((b - a) / step - 1e-9)));
    for (int k = 1; k <= n; ++k) lines.push_back(a + (b - a) * k / n);
  }
  return lines;
}

/// A mesh of the flat pattern: nodes and quads, counter-clockwise seen from side +1.
struct FlatMesh {
  std::vector<Eigen::Vector2d> nodes;
  std::vector<std::array<int, 4>> quads;
};

FlatMesh mesh_flat_pattern(const BracketDefects& defects) {
  std::vector<std::array<double, 3>> fine_u = {{kBend1, kBase, 0.5}, {kBend2, kFront, 0.5}};
  std::vector<std::array<double, 3>> fine_v;
  // Lines follow every hole of the nominal part, so that good and defective parts differ in defects only.
  for (const Hole& h : all_holes()) {
    const double step = h.radius > 5 ? 2.0 : 1.0;
    fine_u.push_back({h.u - h.block, h.u + h.block, step});
    fine_v.push_back({h.v - h.block, h.v + h.block, step});
  }
  fine_u.push_back({kBeadFrom - kBeadHalfWidth, kBeadFrom, 1.0});
  fine_u.push_back({kBeadTo, kBeadTo + kBeadHalfWidth, 1.0});
  fine_v.push_back({-kBeadHalfWidth, kBeadHalfWidth, 0.5});
  fine_u.push_back({kDentU - kDentRadius, kDentU + kDentRadius, 0.5});
  fine_v.push_back({kDentV - kDentRadius, kDentV + kDentRadius, 0.5});
  fine_u.push_back({kBurrU - kBurrHalfLength, kBurrU + kBurrHalfLength, 0.5});
  fine_v.push_back({kBurrV - kBurrHalfWidth, kBurrV + kBurrHalfWidth, 0.2});
  const std::vector<double> us = grid_lines(0, kTotal, 4.0, fine_u);
  const std::vector<double> vs = grid_lines(-kWidth / 2, kWidth / 2, 4.0, fine_v);
  const int nu = static_cast<int>(us.size()), nv = static_cast<int>(vs.size());

  const std::vector<Hole> holes = drilled_holes(defects);
  const auto hole_around = [&](double u, double v) -> const Hole* {
    for (const Hole& h : holes)
      if (std::abs(u - h.u) < h.block && std::abs(v - h.v) < h.block) return &h;
    return nullptr;
  };

  FlatMesh mesh;
  std::vector<int> node_of(static_cast<size_t>(nu) * nv, -1);
  const auto node = [&](int iu, int iv) {
    int& id = node_of[static_cast<size_t>(iu) * nv + iv];
    if (id < 0) {
      id = static_cast<int>(mesh.nodes.size());
      mesh.nodes.emplace_back(us[iu], vs[iv]);
    }
    return id;
  };
  for (int iu = 0; iu + 1 < nu; ++iu)
    for (int iv = 0; iv + 1 < nv; ++iv)
      if (!hole_around(0.5 * (us[iu] + us[iu + 1]), 0.5 * (vs[iv] + vs[iv + 1])))
        mesh.quads.push_back({node(iu, iv), node(iu + 1, iv), node(iu + 1, iv + 1), node(iu, iv + 1)});

  for (const Hole& h : holes) {
    const auto line = [](const std::vector<double>& lines, double value) {
      return static_cast<int>(std::lower_bound(lines.begin(), lines.end(), value - 1e-6) - lines.begin());
    };
    const int u0 = line(us, h.u - h.block), u1 = line(us, h.u + h.block);
    const int v0 = line(vs, h.v - h.block), v1 = line(vs, h.v + h.block);
    std::vector<int> perimeter;  // counter-clockwise
    for (int i = u0; i < u1; ++i) perimeter.push_back(node(i, v0));
    for (int i = v0; i < v1; ++i) perimeter.push_back(node(u1, i));
    for (int i = u1; i > u0; --i) perimeter.push_back(node(i, v1));
    for (int i = v1; i > v0; --i) perimeter.push_back(node(u0, i));
    std::vector<int> circle;
    const Eigen::Vector2d centre(h.u, h.v);
    for (int p : perimeter) {
      circle.push_back(static_cast<int>(mesh.nodes.size()));
      mesh.nodes.push_back(centre + h.radius * (mesh.nodes[p] - centre).normalized());
    }
    for (size_t i = 0; i < perimeter.size(); ++i) {
      const size_t j = (i + 1) % perimeter.size();
      mesh.quads.push_back({circle[i], perimeter[i], perimeter[j], circle[j]});
    }
  }
  return mesh;
}

/// A closed shape swept by rotating a profile of (radius, z), from the axis and back to it, about a vertical
/// axis.
TriangleMesh revolve(const std::vector<Eigen::Vector2d>& profile, const Eigen::Vector3d& origin,
                     int segments) {
  TriangleMesh mesh;
  const auto add = [&](double radius, double angle, double z) {
    mesh.vertices.push_back(
        (origin + Eigen::Vector3d(radius * std::cos(angle), radius * std::sin(angle), z)).cast<float>());
    return static_cast<int>(mesh.vertices.size()) - 1;
  };
  std::vector<std::vector<int>> rings;  // a point of the axis is a ring of one vertex repeated
  for (const auto& p : profile) {
    std::vector<int> ring;
    for (int s = 0; s < segments; ++s)
      ring.push_back(p.x() == 0 && s > 0 ? ring.front() : add(p.x(), 2 * pi * s / segments, p.y()));
    rings.push_back(ring);
  }
  for (size_t i = 0; i + 1 < rings.size(); ++i) {
    for (int s = 0; s < segments; ++s) {
      const int next = (s + 1) % segments;
      const int a = rings[i][s], b = rings[i][next], c = rings[i + 1][next], d = rings[i + 1][s];
      if (a != b) mesh.triangles.emplace_back(a, b, c);
      if (c != d) mesh.triangles.emplace_back(a, c, d);
    }
  }
  return mesh;
}

}  // namespace

BracketDefects seeded_defects() {
  return {0.4, true, 0.6, pi / 180.0};
}

TriangleMesh make_bracket(const BracketDefects& defects) {
  const FlatMesh flat = mesh_flat_pattern(defects);
  const int count = static_cast<int>(flat.nodes.size());
  TriangleMesh mesh;
  for (int side : {+1, -1})
    for (const auto& n : flat.nodes)
      mesh.vertices.push_back(surface(n.x(), n.y(), side, defects).cast<float>());

  std::map<std::pair<int, int>, int>
      directed;  // half-edges of the inside face: those without a twin are cut edges
  for (const auto& q : flat.quads) {
    mesh.triangles.emplace_back(q[0], q[1], q[2]);
    mesh.triangles.emplace_back(q[0], q[2], q[3]);
    mesh.triangles.emplace_back(count + q[0], count + q[2], count + q[1]);
    mesh.triangles.emplace_back(count + q[0], count + q[3], count + q[2]);
    for (int k = 0; k < 4; ++k) directed[{q[k], q[(k + 1) % 4]}] = 1;
  }
  for (const auto& [edge, unused] : directed) {
    const auto [a, b] = edge;
    if (directed.contains({b, a})) continue;
    mesh.triangles.emplace_back(a, count + a, b);
    mesh.triangles.emplace_back(b, count + a, count + b);
  }
  return mesh;
}

std::vector<DefectTruth> bracket_truth(const BracketDefects& defects, double threshold_mm) {
  struct Candidate {
    std::string kind;
    std::function<double(double u, double v, int side)> deviation;  // along the outward normal of that face
    double u0, u1, v0, v1;
  };
  std::vector<Candidate> candidates;
  if (defects.dent_depth_mm > 0) {
    candidates.push_back(
        {"dent", [&](double u, double v, int side) { return side * defects.dent_depth_mm * dent(u, v); },
         kDentU - 5, kDentU + 5, kDentV - 5, kDentV + 5});
  }
  if (defects.missing_hole) {
    for (const Hole& h : all_holes()) {
      if (!h.may_be_missing) continue;
      // Material where the hole should be is as far from the CAD surface as from the hole's rim.
      candidates.push_back(
          {"missing_hole",
           [h](double u, double v, int) { return std::max(h.radius - std::hypot(u - h.u, v - h.v), 0.0); },
           h.u - 5, h.u + 5, h.v - 5, h.v + 5});
    }
  }
  if (defects.burr_height_mm > 0) {
    candidates.push_back(
        {"burr",
         [&](double u, double v, int side) { return side > 0 ? defects.burr_height_mm * burr(u, v) : 0.0; },
         kBurrU - 7, kBurrU + 7, kBurrV - 1, kBurrV + 2});
  }
  if (defects.flange_bend_rad != 0) {
    candidates.push_back({"bent_flange",
                          [&](double u, double v, int side) {
                            const Eigen::Vector3d moved = surface(u, v, side, defects);
                            BracketDefects straight = defects;
                            straight.flange_bend_rad = 0;
                            return side * (moved - surface(u, v, side, straight)).dot(fold(u, v, 0).normal);
                          },
                          kFront, kTotal, -kWidth / 2, kWidth / 2});
  }

  const std::vector<Hole> holes = drilled_holes(defects);
  constexpr double kStep = 0.05;
  std::vector<DefectTruth> truths;
  for (const auto& c : candidates) {
    Eigen::Vector3d sum = Eigen::Vector3d::Zero();
    Eigen::AlignedBox3d box;
    double count = 0, depth = 0;
    for (double u = c.u0 + kStep / 2; u < c.u1; u += kStep) {
      for (double v = c.v0 + kStep / 2; v < c.v1; v += kStep) {
        if (std::abs(v) > kWidth / 2) continue;
        if (std::any_of(holes.begin(), holes.end(),
                        [&](const Hole& h) { return std::hypot(u - h.u, v - h.v) < h.radius; }))
          continue;
        for (int side : {+1, -1}) {
          const double deviation = std::abs(c.deviation(u, v, side));
          depth = std::max(depth, deviation);
          if (deviation <= threshold_mm) continue;
          const Eigen::Vector3d p = surface(u, v, side, defects);
          sum += p;
          box.extend(p);
          ++count;
        }
      }
    }
    if (count > 0) truths.push_back({c.kind, sum / count, box.sizes(), depth, count * kStep * kStep});
  }
  return truths;
}

TriangleMesh make_holder() {
  // A post that touches the base's underside, on a round plate; profiles run from the axis outwards, upwards
  // and back.
  const TriangleMesh post =
      revolve({{0, -60}, {50, -60}, {50, -50}, {11, -50}, {11, -0.02}, {0, -0.02}}, {60, 0, 0}, 64);
  const TriangleMesh screw = revolve({{0, 2.02}, {5, 2.02}, {5, 8}, {0, 8}}, {72, -24, 0}, 48);
  return merged(post, screw);
}

}  // namespace gantry
