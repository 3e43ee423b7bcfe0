#include "report/surface_model.h"

#include <tbb/parallel_for.h>

#include <algorithm>
#include <cmath>
#include <limits>
#include <numeric>
#include <optional>
#include <tuple>
#include <unordered_map>
#include <unordered_set>

#include "gantry/geometry/point_index.h"

namespace gantry::report {
namespace {

using Vertex = SurfaceModel::Vertex;

constexpr float kSmooth = 0.8f;         // cosine; faces that turn more sharply do not share vertices
constexpr float kCrease = 0.87f;        // cosine; a sharper edge is drawn as a line
constexpr size_t kMostCreases = 20000;  // a scanned reference has no edges, only noise
constexpr float kSharpestChange =
    0.06f;                            // of the tolerance: by so much a triangle may be wrong in its middle
constexpr float kCoarseShare = 0.4f;  // of the triangles are spent evenly

/// Cells that hold the vertices of one position, or of one neighbourhood: an index for each.
struct Cell {
  int x, y, z, facing;
  auto tie() const { return std::tie(x, y, z, facing); }
  bool operator<(const Cell& other) const { return tie() < other.tie(); }
};

/// For each of `keys` the number of its value among all, and how many values there are.
template <typename Key>
std::pair<std::vector<int>, int> numbered(const std::vector<Key>& keys) {
  std::vector<uint32_t> order(keys.size());
  std::iota(order.begin(), order.end(), 0u);
  std::sort(order.begin(), order.end(),
            [&](uint32_t a, uint32_t b) { return std::tie(keys[a], a) < std::tie(keys[b], b); });
  std::vector<int> number(keys.size());
  int next = -1;
  for (size_t i = 0; i < order.size(); ++i) {
    if (i == 0 || keys[order[i - 1]] < keys[order[i]]) ++next;
    number[order[i]] = next;
  }
  return {std::move(number), next + 1};
}

using Coordinates = std::array<float, 3>;

/// The mesh with one vertex for each position, without triangles that have no area.
TriangleMesh welded(const TriangleMesh& mesh) {
  std::vector<Coordinates> keys;
  keys.reserve(mesh.vertices.size());
  for (const auto& v : mesh.vertices) keys.push_back({v.x(), v.y(), v.z()});
  const auto [number, count] = numbered(keys);
  TriangleMesh out;
  out.vertices.resize(count);
  for (size_t i = 0; i < number.size(); ++i) out.vertices[number[i]] = mesh.vertices[i];
  for (const auto& t : mesh.triangles) {
    const Eigen::Vector3i u(number[t[0]], number[t[1]], number[t[2]]);
    if (u[0] == u[1] || u[1] == u[2] || u[2] == u[0]) continue;
    out.triangles.push_back(u);
    if (out.normal(out.triangles.size() - 1).isZero()) out.triangles.pop_back();
  }
  return out;
}

/// Puts together what lies in one cell and faces the same way: the opposite sides of a thin wall stay apart.
TriangleMesh clustered(const TriangleMesh& mesh, float cell_mm) {
  std::vector<Eigen::Vector3f> normals(mesh.vertices.size(), Eigen::Vector3f::Zero());
  for (size_t t = 0; t < mesh.triangles.size(); ++t)
    for (const int v : mesh.triangles[t]) normals[v] += static_cast<float>(mesh.area(t)) * mesh.normal(t);
  std::vector<Cell> keys;
  keys.reserve(mesh.vertices.size());
  for (size_t i = 0; i < mesh.vertices.size(); ++i) {
    const Eigen::Vector3i c = (mesh.vertices[i] / cell_mm).array().floor().cast<int>();
    keys.push_back({c.x(), c.y(), c.z(), dominant_axis(normals[i])});
  }
  const auto [number, count] = numbered(keys);
  std::vector<Eigen::Vector3f> middles(count, Eigen::Vector3f::Zero());
  std::vector<float> members(count, 0.0f), nearest(count, std::numeric_limits<float>::infinity());
  for (size_t i = 0; i < number.size(); ++i) {
    middles[number[i]] += mesh.vertices[i];
    ++members[number[i]];
  }
  // The member that is nearest to their middle stands for all, for it lies on the surface.
  TriangleMesh out;
  out.vertices.resize(count);
  for (size_t i = 0; i < number.size(); ++i) {
    const int cell = number[i];
    const float distance = (mesh.vertices[i] - middles[cell] / members[cell]).squaredNorm();
    if (distance >= nearest[cell]) continue;
    nearest[cell] = distance;
    out.vertices[cell] = mesh.vertices[i];
  }
  for (const auto& t : mesh.triangles) out.triangles.emplace_back(number[t[0]], number[t[1]], number[t[2]]);
  return welded(out);
}

TriangleMesh within_budget(const TriangleMesh& cad, size_t most) {
  const TriangleMesh fine = welded(cad);
  TriangleMesh mesh = fine;
  auto cell = static_cast<float>(std::sqrt(2 * fine.surface_area() / static_cast<double>(most)));
  for (; mesh.triangles.size() > most; cell *= 1.3f) mesh = clustered(fine, cell);
  return mesh;
}

/// What was measured around a place, by the same weights as in the pictures.
class Measurements {
 public:
  Measurements(const MeasuredSurface& measured) : measured_(measured) {
    points_.reserve(measured.on_cad.size());
    for (const Surfel& s : measured.on_cad) points_.push_back(s.position);
    index_.emplace(points_);
  }

  void measure(Vertex& vertex) const {
    thread_local std::vector<PointIndex::Neighbour> near;
    const float reach = measured_.reach_mm, sharpness = 4.5f / (reach * reach);
    near.clear();
    if (!points_.empty()) index_->within(vertex.position, reach, near);
    double weight = 0, deviation = 0, uncertainty = 0, defect = 0;
    float strongest = 0;
    for (const auto& n : near) {
      const Surfel& s = measured_.on_cad[n.index];
      if (s.normal.dot(vertex.normal) < 0.5f) continue;
      const float w = std::exp(-sharpness * n.squared_distance);
      weight += w;
      deviation += w * s.deviation_mm;
      uncertainty += w * s.uncertainty_mm;
      if (s.defect == 0) continue;
      defect += w;
      if (w > strongest) strongest = w, vertex.defect = s.defect;
    }
    vertex.seen = weight > 0;
    if (!vertex.seen) return;
    vertex.deviation_mm = static_cast<float>(deviation / weight);
    vertex.uncertainty_mm = static_cast<float>(uncertainty / weight);
    vertex.defect_share = static_cast<float>(defect / weight);
  }

 private:
  const MeasuredSurface& measured_;
  std::vector<Eigen::Vector3f> points_;
  std::optional<PointIndex> index_;
};

/// The ends of an edge as one number, the smaller index first.
uint64_t edge_key(int a, int b) {
  return static_cast<uint64_t>(std::min(a, b)) << 32 | static_cast<uint32_t>(std::max(a, b));
}
int first_of(uint64_t key) {
  return static_cast<int>(key >> 32);
}
int second_of(uint64_t key) {
  return static_cast<int>(key & 0xffffffffu);
}

std::vector<std::array<Eigen::Vector3f, 2>> creases_of(const TriangleMesh& mesh) {
  std::vector<std::pair<uint64_t, int>> sides;
  for (size_t t = 0; t < mesh.triangles.size(); ++t)
    for (int k = 0; k < 3; ++k)
      sides.emplace_back(edge_key(mesh.triangles[t][k], mesh.triangles[t][(k + 1) % 3]), static_cast<int>(t));
  std::sort(sides.begin(), sides.end());
  std::vector<std::array<Eigen::Vector3f, 2>> creases;
  for (size_t begin = 0, end = 0; begin < sides.size(); begin = end) {
    for (end = begin; end < sides.size() && sides[end].first == sides[begin].first;) ++end;
    const bool smooth = end - begin == 2 &&
                        mesh.normal(sides[begin].second).dot(mesh.normal(sides[begin + 1].second)) > kCrease;
    if (!smooth)
      creases.push_back(
          {mesh.vertices[first_of(sides[begin].first)], mesh.vertices[second_of(sides[begin].first)]});
  }
  if (creases.size() > kMostCreases) creases.clear();
  return creases;
}

/// Vertices apart along creases, with the mean normal of their faces.
SurfaceModel split_at_creases(const TriangleMesh& mesh) {
  SurfaceModel model;
  model.creases = creases_of(mesh);
  model.triangles.resize(mesh.triangles.size());
  struct Group {
    Eigen::Vector3f first_normal;
    int vertex;
  };
  std::vector<std::vector<Group>> groups(mesh.vertices.size());
  for (size_t t = 0; t < mesh.triangles.size(); ++t) {
    const Eigen::Vector3f normal = mesh.normal(t);
    for (int k = 0; k < 3; ++k) {
      auto& here = groups[mesh.triangles[t][k]];
      auto group = std::find_if(here.begin(), here.end(),
                                [&](const Group& g) { return g.first_normal.dot(normal) > kSmooth; });
      if (group == here.end()) {
        group = here.insert(here.end(), {normal, static_cast<int>(model.vertices.size())});
        Vertex vertex;
        vertex.position = mesh.vertices[mesh.triangles[t][k]];
        vertex.normal.setZero();
        model.vertices.push_back(vertex);
      }
      model.vertices[group->vertex].normal += static_cast<float>(mesh.area(t)) * normal;
      model.triangles[t][k] = group->vertex;
    }
  }
  for (Vertex& v : model.vertices) v.normal.stableNormalize();
  return model;
}

/// Divides triangles where they say too little, the worst first, until there is nothing left to say or the
/// triangles are used up. An edge is divided, or not, for both of its triangles.
class Refinement {
 public:
  Refinement(SurfaceModel& model, const MeasuredSurface& measured, double tolerance_mm, size_t most)
      : model_(model), measurements_(measured), tolerance_(static_cast<float>(tolerance_mm)), most_(most) {
    double area = 0;
    for (const auto& t : model.triangles)
      area += 0.5 * (position(t[1]) - position(t[0])).cross(position(t[2]) - position(t[0])).norm();
    fine_mm_ = std::max(0.4f * measured.reach_mm, 1e-4f);
    coarse_mm_ =
        std::max(2 * fine_mm_,
                 static_cast<float>(std::sqrt(area / (0.22 * kCoarseShare * static_cast<double>(most)))));
  }

  void run() {
    tbb::parallel_for(size_t{0}, model_.vertices.size(),
                      [&](size_t i) { measurements_.measure(model_.vertices[i]); });
    while (divide()) {
    }
  }

 private:
  struct Candidate {
    uint64_t edge;
    float gain;
  };

  const Eigen::Vector3f& position(int v) const { return model_.vertices[v].position; }

  Vertex middle_of(uint64_t edge) const {
    const Vertex &a = model_.vertices[first_of(edge)], &b = model_.vertices[second_of(edge)];
    Vertex middle;
    middle.position = 0.5f * (a.position + b.position);
    middle.normal = (a.normal + b.normal).stableNormalized();
    measurements_.measure(middle);
    return middle;
  }

  /// How wrong the edge is about its middle, in multiples of what is allowed.
  float gain(uint64_t edge, const Vertex& middle) const {
    const Vertex &a = model_.vertices[first_of(edge)], &b = model_.vertices[second_of(edge)];
    const float length = (a.position - b.position).norm();
    if (length > coarse_mm_) return 1000 * length / coarse_mm_;
    if (length < fine_mm_) return 0;
    if (a.seen != b.seen || a.seen != middle.seen) return 10;
    if (!middle.seen) return 0;
    const auto shown = [&](float deviation) {
      return std::clamp(deviation, -2.2f * tolerance_, 2.2f * tolerance_);
    };
    const float wrong =
        std::abs(shown(middle.deviation_mm) - 0.5f * (shown(a.deviation_mm) + shown(b.deviation_mm)));
    const float outline = std::abs(middle.defect_share - 0.5f * (a.defect_share + b.defect_share));
    return std::max(wrong / (kSharpestChange * tolerance_), outline / 0.15f);
  }

  /// The edges that were not looked at before, with their middles.
  std::vector<Candidate> new_edges() {
    std::vector<uint64_t> edges;
    edges.reserve(3 * model_.triangles.size());
    for (const auto& t : model_.triangles)
      for (int k = 0; k < 3; ++k) edges.push_back(edge_key(t[k], t[(k + 1) % 3]));
    std::sort(edges.begin(), edges.end());
    edges.erase(std::unique(edges.begin(), edges.end()), edges.end());
    std::vector<uint64_t> fresh;
    std::set_difference(edges.begin(), edges.end(), settled_.begin(), settled_.end(),
                        std::back_inserter(fresh));
    std::vector<Candidate> candidates(fresh.size());
    tbb::parallel_for(size_t{0}, fresh.size(), [&](size_t i) {
      Candidate& c = candidates[i];
      c.edge = fresh[i];
      c.gain = gain(fresh[i], middle_of(fresh[i]));
    });
    settled_ = std::move(edges);
    return candidates;
  }

  /// The longest of a triangle's edges; of equal ones always the same.
  uint64_t longest_edge(const Eigen::Vector3i& t) const {
    std::pair<float, uint64_t> longest{-1.0f, 0};
    for (int k = 0; k < 3; ++k) {
      const int a = t[k], b = t[(k + 1) % 3];
      longest = std::max(longest, {(position(a) - position(b)).squaredNorm(), edge_key(a, b)});
    }
    return longest.second;
  }

  /// The given edges and the longest one of every triangle that has one of them: a triangle whose longest
  /// edge is always divided, too, does not become a needle, and edges become shorter (Rivara, 1984).
  std::vector<uint64_t> with_longest_edges(std::vector<uint64_t> edges) const {
    std::unordered_set<uint64_t> marked(edges.begin(), edges.end());
    for (bool more = true; more;) {
      more = false;
      for (const auto& t : model_.triangles) {
        const bool divided = marked.contains(edge_key(t[0], t[1])) || marked.contains(edge_key(t[1], t[2])) ||
                             marked.contains(edge_key(t[2], t[0]));
        if (!divided || !marked.insert(longest_edge(t)).second) continue;
        edges.push_back(longest_edge(t));
        more = true;
      }
    }
    return edges;
  }

  bool divide() {
    // An edge costs about two triangles.
    const size_t room = model_.triangles.size() < most_ ? (most_ - model_.triangles.size()) / 2 : 0;
    if (room == 0) return false;
    std::vector<Candidate> candidates = new_edges();
    std::erase_if(candidates, [](const Candidate& c) { return c.gain <= 1; });
    std::sort(candidates.begin(), candidates.end(), [](const Candidate& a, const Candidate& b) {
      return a.gain != b.gain ? a.gain > b.gain : a.edge < b.edge;
    });
    std::vector<uint64_t> edges;
    for (const Candidate& c : candidates) edges.push_back(c.edge);
    if (edges.size() > room) edges.resize(room);
    std::vector<uint64_t> chosen = with_longest_edges(edges);
    while (chosen.size() > room) {
      edges.resize(edges.size() / 2);
      chosen = with_longest_edges(edges);
    }
    if (chosen.empty()) return false;

    std::vector<Vertex> middles(chosen.size());
    tbb::parallel_for(size_t{0}, chosen.size(), [&](size_t i) { middles[i] = middle_of(chosen[i]); });
    std::unordered_map<uint64_t, int> middle_at;
    for (size_t i = 0; i < chosen.size(); ++i) {
      middle_at[chosen[i]] = static_cast<int>(model_.vertices.size());
      model_.vertices.push_back(middles[i]);
    }
    std::vector<Eigen::Vector3i> triangles;
    for (const auto& t : model_.triangles) {
      std::array<int, 3> middle;
      for (int k = 0; k < 3; ++k) {
        const auto found = middle_at.find(edge_key(t[k], t[(k + 1) % 3]));
        middle[k] = found == middle_at.end() ? -1 : found->second;
      }
      cut(t, middle, triangles);
    }
    model_.triangles = std::move(triangles);
    return true;
  }

  /// `middle[k]` lies between corners k and k + 1; -1: that edge stays whole.
  void cut(const Eigen::Vector3i& t, const std::array<int, 3>& middle,
           std::vector<Eigen::Vector3i>& out) const {
    const auto divided = std::count_if(middle.begin(), middle.end(), [](int m) { return m >= 0; });
    if (divided == 0) {
      out.push_back(t);
    } else if (divided == 3) {
      for (int k = 0; k < 3; ++k) out.emplace_back(t[k], middle[k], middle[(k + 2) % 3]);
      out.emplace_back(middle[0], middle[1], middle[2]);
    } else {
      // Turned so that the first edge is the divided one of one, or the whole one of two comes last.
      int turn = 0;
      while (divided == 1 ? middle[turn] < 0 : middle[(turn + 2) % 3] >= 0) ++turn;
      const int a = t[turn], b = t[(turn + 1) % 3], c = t[(turn + 2) % 3], ab = middle[turn];
      if (divided == 1) {
        out.emplace_back(a, ab, c);
        out.emplace_back(ab, b, c);
        return;
      }
      const int bc = middle[(turn + 1) % 3];
      out.emplace_back(ab, b, bc);
      if ((position(a) - position(bc)).squaredNorm() < (position(ab) - position(c)).squaredNorm()) {
        out.emplace_back(a, ab, bc);
        out.emplace_back(a, bc, c);
      } else {
        out.emplace_back(a, ab, c);
        out.emplace_back(ab, bc, c);
      }
    }
  }

  SurfaceModel& model_;
  const Measurements measurements_;
  const float tolerance_;
  const size_t most_;
  float fine_mm_, coarse_mm_;
  std::vector<uint64_t> settled_;  // sorted
};

/// Gives unseen vertices beside seen ones the deviation of these.
void extend_over_borders(SurfaceModel& model) {
  std::vector<std::pair<float, int>> sums(model.vertices.size(), {0.0f, 0});
  for (const auto& t : model.triangles)
    for (int k = 0; k < 3; ++k)
      for (const int other : {t[(k + 1) % 3], t[(k + 2) % 3]})
        if (!model.vertices[t[k]].seen && model.vertices[other].seen) {
          sums[t[k]].first += model.vertices[other].deviation_mm;
          ++sums[t[k]].second;
        }
  for (size_t i = 0; i < sums.size(); ++i)
    if (sums[i].second > 0)
      model.vertices[i].deviation_mm = sums[i].first / static_cast<float>(sums[i].second);
}

/// Evens out the share of defective surface, so that a defect's outline does not follow single points.
void smooth_defect_shares(SurfaceModel& model) {
  constexpr int kRounds = 5;
  std::vector<std::pair<float, float>> sums(model.vertices.size());
  for (int round = 0; round < kRounds; ++round) {
    for (size_t i = 0; i < sums.size(); ++i) sums[i] = {model.vertices[i].defect_share, 1.0f};
    for (const auto& t : model.triangles)
      for (int k = 0; k < 3; ++k)
        for (const int other : {t[(k + 1) % 3], t[(k + 2) % 3]}) {
          if (!model.vertices[other].seen) continue;
          sums[t[k]].first += 0.5f * model.vertices[other].defect_share;
          sums[t[k]].second += 0.5f;
        }
    for (size_t i = 0; i < sums.size(); ++i) model.vertices[i].defect_share = sums[i].first / sums[i].second;
  }
}

/// Vertices in the order in which triangles use them: neighbours in the list are mostly neighbours on the
/// surface, which makes triangles short to write.
void put_in_order(SurfaceModel& model) {
  std::vector<int> number(model.vertices.size(), -1);
  std::vector<Vertex> vertices;
  for (auto& t : model.triangles)
    for (int& v : t) {
      if (number[v] < 0) {
        number[v] = static_cast<int>(vertices.size());
        vertices.push_back(model.vertices[v]);
      }
      v = number[v];
    }
  model.vertices = std::move(vertices);
}

}  // namespace

SurfaceModel surface_model(const TriangleMesh& cad, const MeasuredSurface& measured, double tolerance_mm,
                           size_t most_triangles) {
  SurfaceModel model = split_at_creases(within_budget(cad, most_triangles / 2));
  Refinement(model, measured, tolerance_mm, most_triangles).run();
  extend_over_borders(model);
  smooth_defect_shares(model);
  put_in_order(model);
  return model;
}

}  // namespace gantry::report
