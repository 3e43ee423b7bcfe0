// Lab cell control: runs a plan from homing to verdict; moves and shows the axes (motion_commands.cpp).

#include <spdlog/spdlog.h>

#include <algorithm>
#include <chrono>
#include <cstdio>
#include <exception>
#include <fstream>
#include <numbers>
#include <thread>

#include "app.h"
#include "cell_devices.h"
#include "gantry/acquisition/plan_check.h"
#include "gantry/acquisition/run.h"
#include "gantry/acquisition/scan_queue.h"
#include "gantry/foundation/file_hash.h"
#include "gantry/fusion/fusion.h"
#include "gantry/fusion/registration_json.h"
#include "inspection_step.h"
#include "motion_commands.h"
#include "progress.h"
#include "reference_mesh.h"

namespace {

using namespace gantry;

struct RunCommand {
  std::filesystem::path cell, plan, out;
  std::optional<std::filesystem::path> reference, part;
  uint64_t seed = 1;
  size_t allowed_left_out = 0;
  std::string reference_unit = "mm";
  bool resume = false, json = false;
};

void require(const Result<void>& result) {
  if (!result) throw DeviceError(result.error());
}

/// The facts that make two sessions one run, recorded at the start and compared on resume.
std::map<std::string, std::string> run_facts(const RunCommand& command, const Cell& cell) {
  std::map<std::string, std::string> facts;
  facts["cell sha256"] = sha256_of_file(command.cell);
  facts["plan sha256"] = sha256_of_file(command.plan);
  if (command.reference) facts["reference sha256"] = sha256_of_file(*command.reference);
  if (command.reference && command.reference_unit != "mm") facts["reference unit"] = command.reference_unit;
  facts["calibration"] = cell.calibration_id;
  facts["software"] = "gantry " GANTRY_VERSION;
  return facts;
}

/// Fusion on its own thread: it preprocesses each scan while the stages move on.
class FusionThread {
 public:
  explicit FusionThread(FusionOptions options) : fusion_(std::move(options)), thread_([this] { work(); }) {}
  ~FusionThread() {
    queue_.close();
    if (thread_.joinable()) thread_.join();
  }

  void push(TaggedScan scan) {
    if (!queue_.push(std::move(scan)) && failure_) std::rethrow_exception(failure_);
  }

  FusionResult finish() {
    queue_.close();
    thread_.join();
    if (failure_) std::rethrow_exception(failure_);
    return fusion_.finish();
  }

 private:
  void work() {
    try {
      while (auto scan = queue_.pop()) {
        try {
          fusion_.add(*scan);
        } catch (const InputError& e) {
          // A view that saw too little of the part is left out; the others still count.
          spdlog::warn("left out: {}", e.what());
        }
      }
    } catch (...) {
      failure_ = std::current_exception();
      queue_.close();
    }
  }

  ScanQueue queue_{2};
  Fusion fusion_;
  std::exception_ptr failure_;
  std::thread thread_;
};

/// "stage-2026-01, of 2026-01-15, 312 days ago".
std::string calibration_text(const Cell& cell) {
  if (!cell.calibrated_on) return cell.calibration_id + "; when it was made is not known";
  const std::chrono::year_month_day date(*cell.calibrated_on);
  const auto today = std::chrono::floor<std::chrono::days>(std::chrono::system_clock::now());
  const long age_days = (today - *cell.calibrated_on).count();
  char text[64];
  std::snprintf(text, sizeof text, ", of %04d-%02u-%02u, ", static_cast<int>(date.year()),
                static_cast<unsigned>(date.month()), static_cast<unsigned>(date.day()));
  return cell.calibration_id + text +
         (age_days < 0 ? "which is still to come" : std::to_string(age_days) + " days ago");
}

Traceability traceability(const RunCommand& command, const Cell& cell, const Plan& plan,
                          const CellDevices& devices, const FusionResult& fused) {
  Traceability trace;
  trace.title = command.reference->stem().string();
  trace.created = utc_now();
  trace.simulated = devices.simulated;
  const auto with_hash = [](const std::filesystem::path& path) {
    return path.filename().string() + ", sha256 " + sha256_of_file(path);
  };
  char text[160];
  trace.entries.emplace_back("Cell", cell.name + " (" + with_hash(command.cell) + ")");
  trace.entries.emplace_back("Plan", plan.name + " (" + with_hash(command.plan) + ")");
  trace.entries.emplace_back("CAD model", with_hash(*command.reference));
  trace.entries.emplace_back("Calibration", calibration_text(cell));
  trace.entries.emplace_back("Scanner", devices.scanner->info().text());
  for (const auto& axis : devices.motion->axes()) trace.entries.emplace_back("Drive", axis->info().text());
  std::snprintf(text, sizeof text,
                "method %s, %zu scans, %zu pairs, overlap residual %.4f mm before, %.4f mm after",
                std::string(to_string(fused.method)).c_str(), fused.scans.size(),
                fused.registration.pairs.size(), fused.before.rms_mm, fused.after.rms_mm);
  trace.entries.emplace_back("Registration", text);
  for (const ScanResult& scan : fused.scans)
    if (!scan.left_out.empty()) trace.entries.emplace_back("Left out", scan.name + " " + scan.left_out);
  trace.entries.emplace_back("Fixture", cell.fixture.empty() ? "none given" : with_hash(cell.fixture));
  trace.entries.emplace_back("Run folder", command.out.filename().string());
  trace.entries.emplace_back("Software", "gantry " GANTRY_VERSION);
  return trace;
}

ExitCode run(const RunCommand& command) {
  install_stop_handler();
  const Cell cell = read_cell(command.cell);
  const Plan plan = read_plan(command.plan, cell);
  std::optional<ReferenceMesh> reference;
  std::optional<TriangleMesh> fixture;
  if (command.reference) {
    reference = read_reference(*command.reference, command.reference_unit, "--reference-unit", true);
    require_size_for_tolerance(reference->sized, plan.tolerance_mm);
  }
  if (!cell.fixture.empty()) fixture = read_reference(cell.fixture, "mm", "", false).mesh;
  require_collision_free(cell, plan, reference ? &reference->mesh : nullptr, fixture ? &*fixture : nullptr);

  SteadyClock clock;
  CellDevices devices = make_devices(cell, command.part, command.seed, clock);
  std::optional<CellSession> session = take_control(cell, devices, "gantry-cell run");
  RunFolder folder(command.out, run_facts(command, cell), command.resume);
  if (command.resume)  // from home straight to the first viewpoint that is missing
    require_collision_free(cell, plan, reference ? &reference->mesh : nullptr, fixture ? &*fixture : nullptr,
                           viewpoints_done(folder.journal()));
  Progress progress(stdout_is_terminal() && !command.json);

  FusionOptions fusion_options;
  fusion_options.joint.allowed_left_out = command.allowed_left_out;
  if (reference) {
    const Eigen::AlignedBox3f bounds = reference->mesh.bounds();
    const Eigen::Vector3d margin = Eigen::Vector3d::Constant(plan.crop_margin_mm);
    fusion_options.preprocess.crop_part_mm =
        Eigen::AlignedBox3d(bounds.min().cast<double>() - margin, bounds.max().cast<double>() + margin);
  }
  FusionThread fusion(fusion_options);

  Motion& motion = *devices.motion;
  motion.cancel_when([] { return stop_requested().load(); });
  motion.on_progress([&](const std::vector<AxisStatus>& now) { progress.axes(motion.axes(), now); });
  const auto device_step = [&](const Result<void>& result) {
    if (!result) folder.journal().add_event("fault", result.error().text());
    if (!result) progress.clear();
    require(result);
  };
  std::optional<CollisionModel> collisions;
  if (cell.collision) {
    collisions =
        make_collision_model(cell, reference ? &reference->mesh : nullptr, fixture ? &*fixture : nullptr);
    motion.set_path_check(make_path_check(cell, *collisions));
  }
  progress.stage("connecting");
  device_step(motion.connect());
  publish_status(session, cell, devices, "gantry-cell run");
  device_step(devices.scanner->connect());
  progress.stage("homing");
  device_step(power_up(cell, motion));
  device_step(motion.home(cell.homing_order));

  RunObserver observer;
  observer.stage = [&](const std::string& stage, size_t k, size_t n) {
    progress.stage("scan " + std::to_string(k + 1) + " of " + std::to_string(n) + ", " + stage);
  };
  observer.scan = [&](TaggedScan scan) { fusion.push(std::move(scan)); };
  const Result<void> scanned = execute_plan(cell, plan, motion, *devices.scanner, folder, clock, observer);
  if (!scanned) {
    progress.clear();
    spdlog::info("{} of {} scans are safe in {}; continue with --resume", folder.journal().scans().size(),
                 plan.viewpoints.size(), command.out.string());
    throw DeviceError(scanned.error());
  }

  progress.stage("registering");
  const FusionResult fused = fusion.finish();
  write_registration(command.out / "registration", fused);
  folder.journal().add_event("registered", fused.trusted ? "trusted" : fused.reason);
  for (const ScanResult& scan : fused.scans)
    if (!scan.left_out.empty())
      spdlog::warn("left out: {} {}; it is not inspected", scan.name, scan.left_out);
  if (!command.json) {
    progress.clear();
    std::printf("  registration  %zu scans, overlap residual %.4f mm by kinematics, %.4f mm registered\n",
                fused.scans.size(), fused.before.rms_mm, fused.after.rms_mm);
  }
  if (!reference) {
    std::printf("  merged        %s\n", (command.out / "registration" / "merged.ply").c_str());
    return fused.trusted ? ExitCode::kPass : ExitCode::kUndecided;
  }

  progress.stage("inspecting");
  InspectionOptions inspection;
  inspection.tolerance_mm = plan.tolerance_mm;
  inspection.systematic_sigma_mm = cell.chain.sensor_systematic_sigma_mm;
  inspection.fixture = std::move(fixture);
  progress.clear();
  const SizedFile merged{"the merged cloud", bulk_size(fused.merged.points), "mm", ""};
  // A part that was hardly seen is UNDECIDED; this is no such thing, and must not end in a verdict.
  constexpr double kDoubtful = 5, kUnmistakable = 16;
  if (const std::string question = questioned_sizes(merged, reference->sized, kUnmistakable);
      !question.empty())
    throw InputError(question);
  if (const std::string question = questioned_sizes(merged, reference->sized, kDoubtful); !question.empty())
    spdlog::warn("{}", question);
  Traceability trace = traceability(command, cell, plan, devices, fused);
  if (!reference->tessellation.empty()) trace.entries.emplace_back("Tessellation", reference->tessellation);
  const ExitCode code = inspect_and_report(fused.merged, reference->mesh, inspection, trace,
                                           command.out / "inspection", command.json);
  folder.journal().add_event("inspected", std::to_string(static_cast<int>(code)));
  return code;
}

}  // namespace

int main(int argc, char** argv) {
  CLI::App app{
      "Runs an inspection cell: drives the stages through a plan, scans, registers, inspects, reports.\n"
      "Example: gantry-cell run --cell examples/cells/simulated.yaml --plan examples/plans/bracket.yaml\n"
      "                         --reference examples/parts/bracket.stl --out runs/first",
      "gantry-cell"};
  CommonOptions common;
  add_common_options(app, common);
  app.require_subcommand(1);

  RunCommand command;
  CLI::App* running = app.add_subcommand("run", "Execute a plan; with --reference also inspect and report");
  running->add_option("--cell", command.cell, "CELL.yaml: axes, sensor, devices")->required();
  running->add_option("--plan", command.plan, "PLAN.yaml: viewpoints and tolerance")->required();
  running->add_option("--reference", command.reference, "CAD model of the part (STL, PLY, OBJ, STEP)");
  running
      ->add_option("--reference-unit", command.reference_unit,
                   "Unit of the reference; a STEP file states its own")
      ->check(CLI::IsMember(length_units()))
      ->capture_default_str();
  running->add_option("--out", command.out, "Run folder; must be new unless --resume")->required();
  running->add_flag("--resume", command.resume, "Continue an interrupted run in this folder");
  running
      ->add_option(
          "--allow-left-out", command.allowed_left_out,
          "So many scans may be left out of a result that counts: scans that contradict the others or "
          "are not held by them; default: none")
      ->check(CLI::Range(0, 1000));
  running->add_option("--sim-part", command.part, "Mesh that stands in an in-process simulated cell");
  running->add_option("--seed", command.seed, "Seed of an in-process simulated cell")->capture_default_str();
  running->add_flag("--json", command.json, "Print the result as JSON");

  MotionCommands motion(app);

  return run_app(app, argc, argv, common, [&] {
    if (running->parsed()) return run(command);
    return motion.run();
  });
}
