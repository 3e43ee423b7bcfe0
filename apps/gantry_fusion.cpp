// Registration and inspection of scans on disk; needs no device.

#include <spdlog/spdlog.h>

#include <cstdio>
#include <numbers>

#include "app.h"
#include "gantry/acquisition/journal.h"
#include "gantry/foundation/file_hash.h"
#include "gantry/fusion/fusion.h"
#include "gantry/fusion/poses_file.h"
#include "gantry/fusion/registration_json.h"
#include "gantry/geometry/mesh_file.h"
#include "gantry/geometry/point_cloud_file.h"
#include "gantry/geometry/scan_file.h"
#include "inspection_step.h"

namespace {

using namespace gantry;

constexpr double kRadPerDeg = std::numbers::pi / 180.0;

struct RegisterOptions {
  std::vector<std::filesystem::path> scans;
  std::filesystem::path initial, out;
  std::vector<double> prior;
  std::string method = "refined-pose-graph";
  std::string unit = "mm";
  double voxel_mm = 0;
  double edge_prune_threshold_mm = 0;
  bool json = false;
};

Matrix6d prior_covariance(double sigma_mm, double sigma_rad) {
  Matrix6d covariance = Matrix6d::Zero();
  covariance.topLeftCorner<3, 3>().diagonal().setConstant(sigma_rad * sigma_rad);
  covariance.bottomRightCorner<3, 3>().diagonal().setConstant(sigma_mm * sigma_mm);
  return covariance;
}

ExitCode run_register(const RegisterOptions& o) {
  const double unit_mm = o.unit == "m" ? 1000.0 : 1.0;
  std::vector<Pose> poses;
  if (!o.initial.empty()) poses = read_poses(o.initial, o.scans.size());
  // Rotations of the stated size, about the scan's own middle: about the origin they would throw scans away
  // from it.
  const double sigma_mm = o.prior.empty() ? 5.0 : o.prior[0];
  const double sigma_rad = (o.prior.empty() ? 5.0 : o.prior[1]) * kRadPerDeg;

  FusionOptions options;
  options.merge.voxel_mm = o.voxel_mm;
  if (o.edge_prune_threshold_mm > 0) options.pose_graph.edge_prune_threshold_mm = o.edge_prune_threshold_mm;
  Fusion fusion(options);
  for (size_t i = 0; i < o.scans.size(); ++i) {
    ScanFile file = read_scan(o.scans[i], unit_mm);
    TaggedScan scan;
    scan.name = o.scans[i].filename().string();
    if (poses.empty() && !file.has_pose)
      throw InputError(o.scans[i].string() +
                       ": holds no VIEWPOINT; give the initial poses with --initial POSES.txt");
    scan.part_from_sensor.mean = poses.empty() ? file.part_from_sensor : poses[i];
    Eigen::Vector3d centre = Eigen::Vector3d::Zero();
    for (size_t k = 0; k < file.scan.points.size(); ++k)
      if (file.scan.valid(k)) centre += file.scan.points[k].cast<double>();
    centre = scan.part_from_sensor.mean * (centre / static_cast<double>(file.scan.valid_count())).eval();
    Pose part_from_centre = Pose::Identity();
    part_from_centre.translation() = centre;
    const Matrix6d a = adjoint(part_from_centre);
    scan.part_from_sensor.independent = a * prior_covariance(sigma_mm, sigma_rad) * a.transpose();
    scan.scan = std::move(file.scan);
    spdlog::info("scan {} of {}: {}, {} points{}", i + 1, o.scans.size(), scan.name, scan.scan.valid_count(),
                 scan.scan.organised() ? ", organised" : "");
    fusion.add(scan);
  }
  const FusionResult result = fusion.finish();
  write_registration(o.out, result);

  if (o.json) {
    std::printf(
        "{\"trusted\": %s, \"overlap_rms_before_mm\": %.6f, \"overlap_rms_after_mm\": %.6f, \"points\": "
        "%zu}\n",
        result.trusted ? "true" : "false", result.before.rms_mm, result.after.rms_mm, result.merged.size());
  } else {
    std::printf("\n  scan                     moved (mm)   rms (mm)   points\n");
    for (const ScanResult& scan : result.scans)
      std::printf("  %-24s %10.3f %10.4f %8zu%s\n", scan.name.c_str(), scan.moved_mm, scan.rms_mm,
                  scan.points, scan.connected ? "" : "   NOT CONNECTED");
    const auto kept =
        std::count_if(result.edges.begin(), result.edges.end(), [](const auto& e) { return e.kept; });
    std::printf("\n  overlap residual (trimmed RMS)  %.4f mm before, %.4f mm after; %ld of %zu pairs kept\n",
                result.before.rms_mm, result.after.rms_mm, static_cast<long>(kept), result.edges.size());
    std::printf("  merged     %s, %zu points\n", (o.out / "merged.ply").c_str(), result.merged.size());
  }
  if (!result.trusted) {
    spdlog::error("UNDECIDED: {}", result.reason);
    return ExitCode::kUndecided;
  }
  return ExitCode::kPass;
}

struct InspectOptions {
  std::filesystem::path cloud, reference, out, fixture;
  double tolerance_mm = 0;
  std::string align = "best-fit";
  std::string unit = "mm", reference_unit = "mm";
  bool json = false;
};

ExitCode run_inspect(const InspectOptions& o) {
  size_t dropped = 0;
  const PointCloud cloud = read_point_cloud(o.cloud, o.unit == "m" ? 1000.0 : 1.0, &dropped);
  if (dropped > 0)
    spdlog::warn("{}: {} points without finite coordinates were left out", o.cloud.string(), dropped);
  const TriangleMesh reference = read_mesh(o.reference, o.reference_unit == "m" ? 1000.0 : 1.0);
  InspectionOptions options;
  options.tolerance_mm = o.tolerance_mm;
  options.align = o.align == "best-fit";
  if (!o.fixture.empty()) options.fixture = read_mesh(o.fixture);
  Traceability trace;
  trace.title = o.reference.stem().string();
  trace.created = utc_now();
  trace.entries = {{"Point cloud", o.cloud.filename().string() + ", sha256 " + sha256_of_file(o.cloud)},
                   {"CAD model", o.reference.filename().string() + ", sha256 " + sha256_of_file(o.reference)},
                   {"Alignment", o.align},
                   {"Software", "gantry " GANTRY_VERSION}};
  return inspect_and_report(cloud, reference, options, trace, o.out, o.json);
}

}  // namespace

int main(int argc, char** argv) {
  CLI::App app{
      "Registers scans into one cloud and inspects clouds against a CAD model.\n"
      "Example: gantry-fusion register scans/*.ply --initial POSES.txt --out registered\n"
      "         gantry-fusion inspect --cloud registered/merged.ply --reference part.stl --tolerance 0.2 "
      "--out inspected",
      "gantry-fusion"};
  CommonOptions common;
  add_common_options(app, common);
  app.require_subcommand(1);

  RegisterOptions reg;
  CLI::App* registering = app.add_subcommand(
      "register", "Multi-view registration: writes poses.txt, merged.ply, registration.json");
  registering->add_option("scans", reg.scans, "Scans: PLY (a range_grid makes it organised) or PCD")
      ->required();
  registering->add_option(
      "--initial", reg.initial,
      "POSES.txt: a 4x4 world_from_scan in mm for each scan; otherwise each PCD's VIEWPOINT");
  registering
      ->add_option("--prior", reg.prior,
                   "Standard deviation of the initial poses: MM,DEG; without it they may be up to 15 mm and "
                   "15 deg wrong")
      ->delimiter(',')
      ->expected(2);
  registering->add_option("--method", reg.method, "refined-pose-graph")
      ->check(CLI::IsMember({"refined-pose-graph"}))
      ->capture_default_str();
  registering
      ->add_option("--voxel-size", reg.voxel_mm,
                   "Cell of the merged cloud, mm; 0: 1.1 times the point spacing")
      ->check(CLI::Range(0.0, 100.0));
  registering
      ->add_option("--edge-prune-threshold", reg.edge_prune_threshold_mm,
                   "Pairs that disagree with the others by more are dropped, mm; 0: 0.5 mm")
      ->check(CLI::Range(0.0, 100.0));
  registering->add_option("--unit", reg.unit, "Unit of the scan files: mm or m")
      ->check(CLI::IsMember({"mm", "m"}))
      ->capture_default_str();
  registering->add_option("--out", reg.out, "Folder for the results")->required();
  registering->add_flag("--json", reg.json, "Print the summary as JSON");

  InspectOptions ins;
  CLI::App* inspecting = app.add_subcommand(
      "inspect", "Signed deviation from a CAD model: verdict, report.html, deviations.ply");
  inspecting->add_option("--cloud", ins.cloud, "Point cloud (PLY or PCD)")->required();
  inspecting->add_option("--reference", ins.reference, "CAD model (STL, PLY, OBJ)")->required();
  inspecting->add_option("--tolerance", ins.tolerance_mm, "Allowed deviation, +- mm")
      ->required()
      ->check(CLI::PositiveNumber);
  inspecting->add_option("--align", ins.align, "none or best-fit")
      ->check(CLI::IsMember({"none", "best-fit"}))
      ->capture_default_str();
  inspecting->add_option("--fixture", ins.fixture,
                         "Mesh of what held the part, in the cloud's frame: it is not judged");
  inspecting->add_option("--unit", ins.unit, "Unit of the cloud: mm or m")
      ->check(CLI::IsMember({"mm", "m"}))
      ->capture_default_str();
  inspecting->add_option("--reference-unit", ins.reference_unit, "Unit of the reference: mm or m")
      ->check(CLI::IsMember({"mm", "m"}))
      ->capture_default_str();
  inspecting->add_option("--out", ins.out, "Folder for the results")->required();
  inspecting->add_flag("--json", ins.json, "Print the summary as JSON");

  return run_app(app, argc, argv, common, [&] {
    if (registering->parsed()) return run_register(reg);
    return run_inspect(ins);
  });
}
