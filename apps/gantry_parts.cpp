// Writes the demo parts, and simulated scans of any part with their true and their perturbed poses: what
// registration is tried on by hand.

#include <cstdio>
#include <fstream>
#include <nlohmann/json.hpp>

#include "app.h"
#include "gantry/foundation/error.h"
#include "gantry/fusion/poses_file.h"
#include "gantry/geometry/mesh_file.h"
#include "gantry/geometry/mesh_topology.h"
#include "gantry/geometry/scan_file.h"
#include "gantry/sim/bracket.h"
#include "gantry/sim/parts.h"
#include "gantry/sim/scan_set.h"
#include "gantry/sim/views.h"

namespace {

using namespace gantry;

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
  for (const auto& defect : bracket_truth(seeded_defects(), threshold_mm)) {
    truth["defects"].push_back({{"kind", defect.kind},
                                {"centre_mm", vector(defect.centre_mm)},
                                {"extent_mm", vector(defect.extent_mm)},
                                {"depth_mm", defect.depth_mm},
                                {"area_mm2", defect.area_mm2}});
  }
  return truth;
}

struct PartsOptions {
  std::filesystem::path out;
  double threshold_mm = 0.2;
  bool registration_parts = false;
};

struct ScansOptions {
  std::filesystem::path out, part;
  double height_mm = 0;  ///< 0: as the file has it.
  size_t views = 8;
  uint64_t seed = 1;
  std::vector<double> band = {1, 3};
  bool unorganised = false;
  SensorModel sensor;
};

void create_folder(const std::filesystem::path& folder) {
  std::error_code error;
  std::filesystem::create_directories(folder, error);
  if (error) throw InputError(folder.string() + ": cannot be created: " + error.message());
}

void write_parts(const PartsOptions& o) {
  create_folder(o.out);
  const auto write = [&](const char* name, const TriangleMesh& mesh) {
    write_mesh(o.out / name, mesh);
    std::printf("%s: %zu triangles, %s\n", (o.out / name).c_str(), mesh.triangles.size(),
                analyse_topology(mesh).text().c_str());
  };
  write("bracket.stl", make_bracket());
  write("bracket_defective.stl", make_bracket(seeded_defects()));
  write("holder.stl", make_holder());
  std::ofstream(o.out / "bracket_defective.truth.json") << truth_json(o.threshold_mm).dump(2) << "\n";
  if (!o.registration_parts) return;
  write("slim_lever.stl", make_slim_lever());
  write("prismatic_block.stl", make_prismatic_block());
  write("plate.stl", make_plate());
  write("turned.stl", make_revolved_part(RevolvedFeature::kNone));
  write("turned_flat.stl", make_revolved_part(RevolvedFeature::kFlat));
  write("turned_bumps.stl", make_revolved_part(RevolvedFeature::kBumps));
}

void write_scans(const ScansOptions& o) {
  TriangleMesh part = read_mesh(o.part);
  if (o.height_mm > 0) part = scaled_to_height(std::move(part), o.height_mm);
  const std::vector<Pose> truth = poisson_disc_views(part, o.sensor, o.views, o.seed);
  const Eigen::Vector3d centre = part.bounds().center().cast<double>();
  const std::vector<Pose> initial = perturbed_poses(truth, centre, o.band[0], o.band[1], o.seed);
  create_folder(o.out);
  write_mesh(o.out / "part.ply", part);
  write_poses(o.out / "truth.txt", truth);
  write_poses(o.out / "initial.txt", initial);

  const RayScene scene(std::move(part));
  for (size_t i = 0; i < truth.size(); ++i) {
    const Scan scan = scan_of_view(o.sensor, scene, truth, i, o.seed);
    char name[32];
    std::snprintf(name, sizeof name, "scan_%02zu.pcd", i);
    // The VIEWPOINT stays the identity: the truth must not lie where registration would find it.
    write_scan(o.out / name, o.unorganised ? without_grid(scan) : scan, Pose::Identity());
    std::printf("%s: %zu points\n", (o.out / name).c_str(), scan.valid_count());
  }
}

}  // namespace

int main(int argc, char** argv) {
  CLI::App app{
      "Writes the demo parts (--out): a sheet-metal bracket, the same with seeded defects and their truth, "
      "and "
      "its holder; or simulated scans of a part (--scans) with part.ply, truth.txt and initial.txt.\n"
      "Example: gantry-parts --out examples/parts\n"
      "Example: gantry-parts --scans /tmp/bunny --part bun_zipper.ply --height 150 --band 6,10",
      "gantry-parts"};
  CommonOptions common;
  add_common_options(app, common);
  PartsOptions parts;
  ScansOptions scans;
  auto* out = app.add_option("--out", parts.out, "Folder to write the demo parts to");
  app.add_option("--threshold", parts.threshold_mm,
                 "Deviation above which surface counts as defective in the truth file, mm")
      ->needs(out)
      ->capture_default_str();
  app.add_flag("--registration-parts", parts.registration_parts,
               "Write the parts of the registration benchmark too (60 MB)")
      ->needs(out);

  auto* folder = app.add_option("--scans", scans.out, "Folder to write simulated scans to");
  auto* part =
      app.add_option("--part", scans.part, "Mesh to scan (STL, PLY or OBJ), mm unless --height is given");
  folder->needs(part);
  part->needs(folder);
  app.add_option("--height", scans.height_mm, "Scale the mesh to this extent along y and centre it, mm")
      ->check(CLI::PositiveNumber)
      ->needs(folder);
  app.add_option("--views", scans.views, "How many scans, in Poisson-disc directions around the part")
      ->check(CLI::Range(1, 99))
      ->needs(folder)
      ->capture_default_str();
  app.add_option("--seed", scans.seed, "Of views, noise and perturbations")
      ->needs(folder)
      ->capture_default_str();
  app.add_option("--noise", scans.sensor.noise_mm, "Range noise at 500 mm (one sigma), mm")
      ->check(CLI::NonNegativeNumber)
      ->needs(folder)
      ->capture_default_str();
  app.add_option("--band", scans.band,
                 "FROM,TO: how far the initial poses are off, in degrees of rotation and mm of translation")
      ->delimiter(',')
      ->expected(2)
      ->needs(folder)
      ->capture_default_str();
  app.add_flag("--unorganised", scans.unorganised, "Write the measured points without the pixel grid")
      ->needs(folder);
  app.add_option("--width", scans.sensor.width, "Columns of the sensor; rows follow at 8 : 5")
      ->check(CLI::Range(16, 8192))
      ->needs(folder)
      ->capture_default_str();
  return run_app(app, argc, argv, common, [&] {
    if (parts.out.empty() && scans.out.empty())
      throw InputError("nothing to do: give --out FOLDER or --scans FOLDER --part MESH");
    scans.sensor.height = scans.sensor.width * 5 / 8;
    if (!parts.out.empty()) write_parts(parts);
    if (!scans.out.empty()) write_scans(scans);
    return ExitCode::kPass;
  });
}
