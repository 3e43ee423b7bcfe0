// Registration, inspection and comparison of scans on disk, and series of inspections; needs no device.

#include <spdlog/spdlog.h>

#include "app.h"
#include "compare_command.h"
#include "gantry/acquisition/journal.h"
#include "gantry/foundation/error.h"
#include "gantry/foundation/file_hash.h"
#include "gantry/geometry/point_cloud_file.h"
#include "inspection_step.h"
#include "reference_mesh.h"
#include "register_command.h"
#include "trend_command.h"

namespace {

using namespace gantry;

struct InspectOptions {
  std::filesystem::path cloud, reference, out, fixture, fixture_scan, datums;
  double tolerance_mm = 0, systematic_sigma_mm = InspectionOptions().systematic_sigma_mm,
         guard_band = InspectionOptions().guard_band;
  std::string align = "best-fit";
  bool from_any_start = false, any_size = false;
  std::string unit = "mm", reference_unit = "mm";
  bool json = false;
};

/// A wrong unit must not end in a verdict on the part.
void compare_sizes(const InspectOptions& o, const PointCloud& cloud, SizedFile reference,
                   const InspectionOptions& options) {
  constexpr double kDoubtful = 3, kUnmistakable = 5;
  if (options.fixture || options.fixture_scan) reference.name += " with its fixture";
  if (options.fixture) reference.size_mm = reference.size_mm.cwiseMax(options.fixture->bounds().sizes());
  if (options.fixture_scan)
    reference.size_mm = reference.size_mm.cwiseMax(bulk_size(options.fixture_scan->points));
  const SizedFile sized{o.cloud.filename().string(), bulk_size(cloud.points), o.unit, "--unit"};
  if (cloud.size() < 100) return;  // too few to be of any size
  const std::string question = questioned_sizes(sized, reference, kDoubtful);
  if (question.empty()) return;
  if (!o.any_size && !questioned_sizes(sized, reference, kUnmistakable).empty())
    throw InputError(question + " (--any-size: they are right, inspect all the same)");
  spdlog::warn("{}", question);
}

ExitCode run_inspect(const InspectOptions& o) {
  require_writable_folder("--out", o.out);
  size_t dropped = 0;
  const PointCloud cloud = read_point_cloud(o.cloud, millimetres_in(o.unit), &dropped);
  if (dropped > 0)
    spdlog::warn("{}: {} points without finite coordinates were left out", o.cloud.string(), dropped);
  InspectionOptions options;
  const ReferenceMesh reference = read_reference(o.reference, o.reference_unit, "--reference-unit", true);
  require_size_for_tolerance(reference.sized, o.tolerance_mm);
  if (!o.fixture.empty()) options.fixture = read_reference(o.fixture, "mm", "", false).mesh;
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
  if (!o.fixture_scan.empty())
    options.fixture_scan = read_point_cloud(o.fixture_scan, millimetres_in(o.unit));
  compare_sizes(o, cloud, reference.sized, options);
  Traceability trace;
  trace.title = o.reference.stem().string();
  trace.created = utc_now();
  trace.entries = {{"Point cloud", o.cloud.filename().string() + ", sha256 " + sha256_of_file(o.cloud)},
                   {"CAD model", o.reference.filename().string() + ", sha256 " + sha256_of_file(o.reference)},
                   {"Alignment", o.align + (o.from_any_start ? ", from any start" : "")},
                   {"Software", "gantry " GANTRY_VERSION}};
  if (!reference.tessellation.empty()) trace.entries.push_back({"Tessellation", reference.tessellation});
  if (!o.datums.empty())
    trace.entries.push_back(
        {"Datums", o.datums.filename().string() + ", sha256 " + sha256_of_file(o.datums)});
  for (const auto& [name, file] :
       {std::pair{"Fixture", &o.fixture}, {"Scan of the fixture", &o.fixture_scan}})
    if (!file->empty())
      trace.entries.push_back({name, file->filename().string() + ", sha256 " + sha256_of_file(*file)});
  return inspect_and_report(cloud, reference.mesh, options, trace, o.out, o.json);
}

}  // namespace

int main(int argc, char** argv) {
  CLI::App app{
      "Registers scans into one cloud, inspects clouds against a CAD model and compares clouds.\n"
      "Example: gantry-fusion register scans/*.ply --initial POSES.txt --out registered\n"
      "         gantry-fusion inspect --cloud registered/merged.ply --reference part.stl --tolerance 0.2 "
      "--out inspected\n"
      "         gantry-fusion compare registered/merged.ply part.stl --ply distances.ply\n"
      "         gantry-fusion trend runs/* --out trend",
      "gantry-fusion"};
  CommonOptions common;
  add_common_options(app, common);
  app.require_subcommand(1);

  const RegisterCommand registering(app);

  InspectOptions ins;
  CLI::App* inspecting = app.add_subcommand(
      "inspect", "Signed deviation from a CAD model: verdict, report.html, deviations.ply");
  inspecting->add_option("--cloud", ins.cloud, "Point cloud (PLY or PCD)")->required();
  inspecting->add_option("--reference", ins.reference, "CAD model (STL, PLY, OBJ, STEP)")->required();
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
  inspecting->add_option("--unit", ins.unit, "Unit of the cloud")
      ->check(CLI::IsMember(length_units()))
      ->capture_default_str();
  inspecting
      ->add_option("--reference-unit", ins.reference_unit,
                   "Unit of the reference; a STEP file states its own")
      ->check(CLI::IsMember(length_units()))
      ->capture_default_str();
  inspecting->add_flag(
      "--any-size", ins.any_size,
      "The cloud may be more than 5 times as large or small as the CAD model: a patch, or a table");
  inspecting->add_option("--out", ins.out, "Folder for the results")->required();
  inspecting->add_flag("--json", ins.json, "Print the summary as JSON");

  const CompareCommand comparing(app);
  const TrendCommand trending(app);

  return run_app(app, argc, argv, common, [&] {
    if (registering.parsed()) return registering.run();
    if (comparing.parsed()) return comparing.run();
    if (trending.parsed()) return trending.run();
    return run_inspect(ins);
  });
}
