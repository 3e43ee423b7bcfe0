// Registration, inspection and comparison of scans on disk; needs no device.

#include <spdlog/spdlog.h>

#include "app.h"
#include "compare_command.h"
#include "gantry/acquisition/journal.h"
#include "gantry/foundation/error.h"
#include "gantry/foundation/file_hash.h"
#include "gantry/geometry/mesh_file.h"
#include "gantry/geometry/point_cloud_file.h"
#include "inspection_step.h"
#include "register_command.h"

namespace {

using namespace gantry;

struct InspectOptions {
  std::filesystem::path cloud, reference, out, fixture, fixture_scan, datums;
  double tolerance_mm = 0, systematic_sigma_mm = InspectionOptions().systematic_sigma_mm,
         guard_band = InspectionOptions().guard_band;
  std::string align = "best-fit";
  bool from_any_start = false;
  std::string unit = "mm", reference_unit = "mm";
  bool json = false;
};

ExitCode run_inspect(const InspectOptions& o) {
  require_writable_folder("--out", o.out);
  size_t dropped = 0;
  const PointCloud cloud = read_point_cloud(o.cloud, o.unit == "m" ? 1000.0 : 1.0, &dropped);
  if (dropped > 0)
    spdlog::warn("{}: {} points without finite coordinates were left out", o.cloud.string(), dropped);
  const TriangleMesh reference = read_mesh(o.reference, o.reference_unit == "m" ? 1000.0 : 1.0);
  InspectionOptions options;
  options.tolerance_mm = o.tolerance_mm;
  options.guard_band = o.guard_band;
  options.systematic_sigma_mm = o.systematic_sigma_mm;
  options.align = o.align != "none";
  options.alignment.from_any_start = o.from_any_start;
  if (o.from_any_start && !options.align)
    throw InputError("--from-any-start searches for an alignment: it does not go with --align none");
  if (o.datums.empty() != (o.align != "datum"))
    throw InputError("--align datum and --datums DATUMS.yaml belong together");
  if (!o.datums.empty()) options.datums = read_datums(o.datums);
  if (!o.fixture.empty()) options.fixture = read_mesh(o.fixture);
  if (!o.fixture_scan.empty())
    options.fixture_scan = read_point_cloud(o.fixture_scan, o.unit == "m" ? 1000.0 : 1.0);
  Traceability trace;
  trace.title = o.reference.stem().string();
  trace.created = utc_now();
  trace.entries = {{"Point cloud", o.cloud.filename().string() + ", sha256 " + sha256_of_file(o.cloud)},
                   {"CAD model", o.reference.filename().string() + ", sha256 " + sha256_of_file(o.reference)},
                   {"Alignment", o.align + (o.from_any_start ? ", from any start" : "")},
                   {"Software", "gantry " GANTRY_VERSION}};
  if (!o.datums.empty())
    trace.entries.push_back(
        {"Datums", o.datums.filename().string() + ", sha256 " + sha256_of_file(o.datums)});
  for (const auto& [name, file] :
       {std::pair{"Fixture", &o.fixture}, {"Scan of the fixture", &o.fixture_scan}})
    if (!file->empty())
      trace.entries.push_back({name, file->filename().string() + ", sha256 " + sha256_of_file(*file)});
  return inspect_and_report(cloud, reference, options, trace, o.out, o.json);
}

}  // namespace

int main(int argc, char** argv) {
  CLI::App app{
      "Registers scans into one cloud, inspects clouds against a CAD model and compares clouds.\n"
      "Example: gantry-fusion register scans/*.ply --initial POSES.txt --out registered\n"
      "         gantry-fusion inspect --cloud registered/merged.ply --reference part.stl --tolerance 0.2 "
      "--out inspected\n"
      "         gantry-fusion compare registered/merged.ply part.stl --ply distances.ply",
      "gantry-fusion"};
  CommonOptions common;
  add_common_options(app, common);
  app.require_subcommand(1);

  const RegisterCommand registering(app);

  InspectOptions ins;
  CLI::App* inspecting = app.add_subcommand(
      "inspect", "Signed deviation from a CAD model: verdict, report.html, deviations.ply");
  inspecting->add_option("--cloud", ins.cloud, "Point cloud (PLY or PCD)")->required();
  inspecting->add_option("--reference", ins.reference, "CAD model (STL, PLY, OBJ)")->required();
  inspecting->add_option("--tolerance", ins.tolerance_mm, "Allowed deviation, +- mm")
      ->required()
      ->check(number_within(1e-4, 100));
  inspecting
      ->add_option("--align", ins.align,
                   "none (the cloud lies in the CAD frame), best-fit, or datum (--datums)")
      ->check(CLI::IsMember({"none", "best-fit", "datum"}))
      ->capture_default_str();
  inspecting->add_option("--datums", ins.datums, "DATUMS.yaml: features that locate the part, by precedence");
  inspecting->add_flag("--from-any-start", ins.from_any_start,
                       "The cloud may lie anywhere, turned by any angle: search for its pose first");
  inspecting->add_option("--fixture", ins.fixture,
                         "Mesh of what held the part, in the cloud's frame: it is not judged");
  inspecting->add_option("--fixture-scan", ins.fixture_scan,
                         "Merged scan of the empty fixture, in the cloud's frame and unit: it is not judged");
  inspecting
      ->add_option(
          "--guard-band", ins.guard_band,
          "On both sides of the tolerance, in standard uncertainties (ISO 14253-1): PASS and FAIL are "
          "said beyond it only; 0: the measured value decides")
      ->check(number_within(0, 10))
      ->capture_default_str();
  inspecting
      ->add_option(
          "--sensor-sigma", ins.systematic_sigma_mm,
          "Standard uncertainty of the sensor, mm, that neighbouring points share: of its calibration, "
          "which no averaging removes")
      ->check(number_within(0, 10))
      ->capture_default_str();
  inspecting->add_option("--unit", ins.unit, "Unit of the cloud: mm or m")
      ->check(CLI::IsMember({"mm", "m"}))
      ->capture_default_str();
  inspecting->add_option("--reference-unit", ins.reference_unit, "Unit of the reference: mm or m")
      ->check(CLI::IsMember({"mm", "m"}))
      ->capture_default_str();
  inspecting->add_option("--out", ins.out, "Folder for the results")->required();
  inspecting->add_flag("--json", ins.json, "Print the summary as JSON");

  const CompareCommand comparing(app);

  return run_app(app, argc, argv, common, [&] {
    if (registering.parsed()) return registering.run();
    if (comparing.parsed()) return comparing.run();
    return run_inspect(ins);
  });
}
