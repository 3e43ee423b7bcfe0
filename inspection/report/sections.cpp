#include "report/sections.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <limits>
#include <map>

namespace gantry::report {
namespace {

/// A piece of the outline within one triangle: from the edge by which it enters to that by which it leaves.
struct Piece {
  std::pair<int, int> from, to;  // edges, as ends in rising order
};

/// Vertices by position: a mesh may list one for each triangle.
std::vector<int> by_position(const TriangleMesh& mesh) {
  std::map<std::array<float, 3>, int> number;
  std::vector<int> of(mesh.vertices.size());
  for (size_t i = 0; i < of.size(); ++i) {
    const auto& v = mesh.vertices[i];
    of[i] = number.try_emplace({v.x(), v.y(), v.z()}, static_cast<int>(i)).first->second;
  }
  return of;
}

}  // namespace

SectionStatistics section_statistics(const Section& section) {
  SectionStatistics s;
  s.min = std::numeric_limits<double>::infinity();
  s.max = -s.min;
  for (const auto& m : section.measured) {
    if (!m.on_cad) continue;
    ++s.count;
    s.mean += m.deviation_mm;
    s.min = std::min<double>(s.min, m.deviation_mm);
    s.max = std::max<double>(s.max, m.deviation_mm);
  }
  s.mean /= static_cast<double>(s.count);
  if (s.count == 0) s.mean = s.min = s.max = std::numeric_limits<double>::quiet_NaN();
  return s;
}

std::vector<SectionLine> outline(const TriangleMesh& cad, const Section& section) {
  const std::vector<int> vertex = by_position(cad);
  // A vertex in the plane counts as beyond it, everywhere alike, so that no piece is lost or drawn twice.
  const auto beyond = [&](int v) { return cad.vertices[v][section.axis] >= section.offset_mm; };
  std::vector<Piece> pieces;
  for (const auto& t : cad.triangles) {
    const Eigen::Vector3i v(vertex[t[0]], vertex[t[1]], vertex[t[2]]);
    Piece piece{{-1, -1}, {-1, -1}};
    for (int k = 0; k < 3; ++k) {
      const int a = v[k], b = v[(k + 1) % 3];
      if (beyond(a) == beyond(b)) continue;
      (beyond(a) ? piece.from : piece.to) = std::minmax(a, b);
    }
    if (piece.from.first >= 0 && piece.from != piece.to) pieces.push_back(piece);
  }

  const auto crossing = [&](const std::pair<int, int>& edge) {
    const Eigen::Vector3f &a = cad.vertices[edge.first], &b = cad.vertices[edge.second];
    const float t = (section.offset_mm - a[section.axis]) / (b[section.axis] - a[section.axis]);
    return section.in_plane(a + t * (b - a));
  };
  std::multimap<std::pair<int, int>, size_t> starting;
  std::map<std::pair<int, int>, int> balance;  // pieces that start at an edge, less those that end there
  for (size_t i = 0; i < pieces.size(); ++i) {
    starting.emplace(pieces[i].from, i);
    ++balance[pieces[i].from];
    --balance[pieces[i].to];
  }
  std::vector<bool> used(pieces.size(), false);
  std::vector<SectionLine> lines;
  const auto follow = [&](size_t start) {
    SectionLine line;
    line.points.push_back(crossing(pieces[start].from));
    for (size_t i = start;;) {
      used[i] = true;
      line.points.push_back(crossing(pieces[i].to));
      line.closed = pieces[i].to == pieces[start].from;
      if (line.closed) break;
      const auto [begin, end] = starting.equal_range(pieces[i].to);
      const auto next = std::find_if(begin, end, [&](const auto& p) { return !used[p.second]; });
      if (next == end) break;
      i = next->second;
    }
    lines.push_back(std::move(line));
  };
  // Open lines from their beginning, then what is left runs in circles.
  for (size_t i = 0; i < pieces.size(); ++i)
    if (!used[i] && balance[pieces[i].from] > 0) follow(i);
  for (size_t i = 0; i < pieces.size(); ++i)
    if (!used[i]) follow(i);
  return lines;
}

namespace {

void add_measured(Section& section, const MeasuredSurface& measured) {
  for (const bool on_cad : {true, false})
    for (const Surfel& s : on_cad ? measured.on_cad : measured.off_cad) {
      if (std::abs(s.position[section.axis] - section.offset_mm) > section.slab_mm) continue;
      const Eigen::Vector2f outwards = section.in_plane(s.normal);
      // A face along the plane has no outline in it.
      if (on_cad && outwards.norm() < 0.5f) continue;
      section.measured.push_back({section.in_plane(s.position), outwards, s.deviation_mm, on_cad});
    }
}

}  // namespace

std::vector<Section> sections(const TriangleMesh& cad, const MeasuredSurface& measured,
                              const std::vector<Defect>& defects) {
  const Eigen::AlignedBox3f box = cad.bounds();
  std::array<int, 3> through = {-1, -1, -1};
  for (size_t i = 0; i < defects.size(); ++i) {
    const Defect& d = defects[i];
    int best = -1;
    for (int axis = 0; axis < 3; ++axis) {
      if (through[axis] >= 0 || !(std::abs(d.normal[axis]) < 0.7)) continue;
      if (d.centre_mm[axis] <= box.min()[axis] || d.centre_mm[axis] >= box.max()[axis]) continue;
      // The cut runs across the region where it is longest.
      if (best < 0 || d.extent_mm[axis] < d.extent_mm[best]) best = axis;
    }
    if (best >= 0) through[best] = static_cast<int>(i);
  }
  std::vector<Section> result;
  for (int axis = 0; axis < 3; ++axis) {
    Section section;
    section.letter = static_cast<char>('A' + result.size());
    section.axis = axis;
    section.slab_mm = 0.5f * measured.reach_mm;
    if (through[axis] >= 0) {
      section.through = defects[through[axis]].id;
      const Defect& d = defects[through[axis]];
      const double inner = 0.3 * d.extent_mm[axis];  // the peak may lie at the very end of the surface
      section.offset_mm = static_cast<float>(
          std::clamp(d.peak_at_mm[axis], d.centre_mm[axis] - inner, d.centre_mm[axis] + inner));
    } else {
      section.offset_mm = box.center()[axis];
    }
    section.outline = outline(cad, section);
    if (section.outline.empty()) continue;
    add_measured(section, measured);
    result.push_back(std::move(section));
  }
  return result;
}

}  // namespace gantry::report
