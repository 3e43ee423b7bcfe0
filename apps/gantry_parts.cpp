// Writes the demo parts: bracket.stl, bracket_defective.stl with its truth, and the holder.

#include <cstdio>
#include <fstream>
#include <nlohmann/json.hpp>

#include "app.h"
#include "gantry/foundation/error.h"
#include "gantry/geometry/mesh_file.h"
#include "gantry/geometry/mesh_topology.h"
#include "gantry/sim/bracket.h"

namespace {

nlohmann::json truth_json(double threshold_mm) {
  nlohmann::json truth;
  truth["part"] = "bracket_defective.stl";
  truth["reference"] = "bracket.stl";
  truth["unit"] = "mm";
  truth["threshold_mm"] = threshold_mm;
  truth["definition"] =
      "centre, extent (x, y, z) and area of the surface that deviates from the reference by more than "
      "threshold_mm; "
      "depth is the largest deviation";
  const auto vector = [](const Eigen::Vector3d& v) { return nlohmann::json::array({v.x(), v.y(), v.z()}); };
  for (const auto& defect : gantry::bracket_truth(gantry::seeded_defects(), threshold_mm)) {
    truth["defects"].push_back({{"kind", defect.kind},
                                {"centre_mm", vector(defect.centre_mm)},
                                {"extent_mm", vector(defect.extent_mm)},
                                {"depth_mm", defect.depth_mm},
                                {"area_mm2", defect.area_mm2}});
  }
  return truth;
}

}  // namespace

int main(int argc, char** argv) {
  CLI::App app{
      "Writes the demo parts: a sheet-metal bracket, the same with seeded defects and their truth, and its "
      "holder.\n"
      "Example: gantry-parts --out examples/parts",
      "gantry-parts"};
  gantry::CommonOptions common;
  gantry::add_common_options(app, common);
  std::filesystem::path out;
  double threshold_mm = 0.2;
  app.add_option("--out", out, "Folder to write to")->required();
  app.add_option("--threshold", threshold_mm,
                 "Deviation above which surface counts as defective in the truth file, mm")
      ->capture_default_str();
  return gantry::run_app(app, argc, argv, common, [&] {
    std::error_code error;
    std::filesystem::create_directories(out, error);
    if (error) throw gantry::InputError(out.string() + ": cannot be created: " + error.message());
    const auto write = [&](const char* name, const gantry::TriangleMesh& mesh) {
      gantry::write_mesh(out / name, mesh);
      std::printf("%s: %zu triangles, %s\n", (out / name).c_str(), mesh.triangles.size(),
                  gantry::analyse_topology(mesh).text().c_str());
    };
    write("bracket.stl", gantry::make_bracket());
    write("bracket_defective.stl", gantry::make_bracket(gantry::seeded_defects()));
    write("holder.stl", gantry::make_holder());
    std::ofstream(out / "bracket_defective.truth.json") << truth_json(threshold_mm).dump(2) << "\n";
    return gantry::ExitCode::kPass;
  });
}
