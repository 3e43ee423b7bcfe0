#include "reference_mesh.h"

#include <spdlog/spdlog.h>

#include "gantry/foundation/error.h"
#include "gantry/geometry/mesh_topology.h"

namespace gantry {
namespace {

constexpr double kTolerancesAcross = 4;  ///< A part less than so many tolerances across is none.

void require_outward(const MeshTopology& topology, const std::string& name) {
  if (topology.inside_out_shells == 0) return;
  const std::string what = topology.shells == 1
                               ? "is inside out: its triangles face into the material"
                               : std::to_string(topology.inside_out_shells) + " of its " +
                                     std::to_string(topology.shells) +
                                     " shells are inside out: their triangles face into the material";
  throw InputError(
      name + ": " + what +
      ", which would turn the sign of deviations round; flip its normals (reverse the order of the "
      "corners of each triangle) and save it again");
}

}  // namespace

ReferenceMesh read_reference(const std::filesystem::path& path, const std::string& unit,
                             const std::string& option, bool sides_matter) {
  ReferenceMesh result;
  MeshReading reading;
  result.mesh = read_mesh(path, millimetres_in(unit), &reading);
  result.tessellation = reading.tessellation;
  result.sized = {path.filename().string(), result.mesh.bounds().sizes(), unit,
                  reading.tessellation.empty() ? option : std::string()};
  if (const std::string question = questioned_size(result.sized); !question.empty())
    spdlog::warn("{}", question);
  if (reading.collapsed_triangles > 0)
    spdlog::warn("{}: {} degenerate triangles were left out: two of their corners are at the same place",
                 path.string(), reading.collapsed_triangles);
  if (!sides_matter) return result;
  const MeshTopology topology = analyse_topology(result.mesh);
  require_outward(topology, path.string());
  if (!topology.watertight()) spdlog::warn("{}: the mesh is {}", path.string(), topology.text());
  return result;
}

void require_size_for_tolerance(const SizedFile& part, double tolerance_mm) {
  const double across_mm = static_cast<double>(part.size_mm.norm());
  if (across_mm >= kTolerancesAcross * tolerance_mm) return;
  const std::string question = questioned_size(part);
  char text[120];
  std::snprintf(text, sizeof text,
                "the tolerance, +-%.4g mm, is no smaller than the part itself (%.3g mm across)", tolerance_mm,
                across_mm);
  throw InputError(question.empty() ? part.name + ": " + text : question + "; " + text);
}

}  // namespace gantry
