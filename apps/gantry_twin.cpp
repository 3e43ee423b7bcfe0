// The simulated cell on the wire: Modbus drives (TCP on loopback, RTU on pseudo-terminals), an I/O module for
// the safety inputs and a GigE Vision 3D camera on loopback.

#include <spdlog/spdlog.h>

#include <cstdio>

#include "app.h"
#include "cell_devices.h"
#include "cell_safety.h"
#include "gantry/sim/twin/gige_vision_camera.h"
#include "twin_console.h"
#include "twin_drives.h"

namespace {

using namespace gantry;

std::unique_ptr<GigeVisionCamera> serve_camera(const Cell& cell, SimulatedWorld& world) {
  const SensorModel& sensor = world.sensor();
  GigeVisionOptions options;
  options.address = cell.scanner.address;
  options.width = sensor.width;
  options.height = sensor.height;
  options.focal_length_px = sensor.focal_x_px();
  options.principal_u = 0.5 * (sensor.width - 1);
  options.principal_v = 0.5 * (sensor.height - 1);
  auto camera = std::make_unique<GigeVisionCamera>(options, [&world](double exposure_s) {
    const Scan scan = world.expose(exposure_s);
    TriggeredFrame frame;
    frame.xyz.resize(3 * scan.points.size());
    for (size_t i = 0; i < scan.points.size(); ++i)
      Eigen::Map<Eigen::Vector3f>(frame.xyz.data() + 3 * i) = scan.points[i];
    return frame;
  });
  spdlog::info("GigE Vision 3D camera at {}", options.address);
  return camera;
}

}  // namespace

int main(int argc, char** argv) {
  CLI::App app{
      "The digital twin: a simulated inspection cell that speaks the real protocols on loopback.\n"
      "Prints one line 'ready' when every server listens; stops at Ctrl-C.\n"
      "Lines on stdin act on the safety inputs: " +
          std::string(TwinConsole::kHelp) +
          ".\n"
          "Example: gantry-twin --cell examples/cells/twin.yaml --part examples/parts/bracket_defective.stl "
          "--seed 1",
      "gantry-twin"};
  CommonOptions common;
  add_common_options(app, common);
  std::filesystem::path cell_path;
  std::optional<std::filesystem::path> part;
  uint64_t seed = 1;
  app.add_option("--cell", cell_path, "CELL.yaml with a simulation section")->required();
  app.add_option("--part", part, "Mesh that stands in the cell (mm); otherwise the one that CELL.yaml names");
  app.add_option("--seed", seed, "Seed of every random number: the same seed gives the same scans")
      ->capture_default_str();
  return run_app(app, argc, argv, common, [&] {
    install_stop_handler();
    const Cell cell = read_cell(cell_path);
    if (cell.scanner.kind != "genicam3d")
      throw InputError(cell.file.string() + ": the twin serves a genicam3d scanner; this cell has kind '" +
                       cell.scanner.kind + "'");
    SteadyClock clock;
    const std::unique_ptr<SimulatedWorld> world = make_world(cell, part, seed, clock);
    // Simulated contacts live in the process of gantry-cell, not here.
    const bool wired = cell.safety && cell.safety->module.kind == "modbus";
    const auto contacts = make_safety_contacts(wired ? *cell.safety : CellSafety{}, clock);
    TwinConsole console(*contacts);
    const auto drives = serve_drives(cell, *world, wired ? contacts.get() : nullptr, clock);
    const auto camera = serve_camera(cell, *world);
    std::printf("ready\n");
    std::fflush(stdout);
    while (!stop_requested()) {
      console.poll();
      clock.sleep_s(0.05);
    }
    return ExitCode::kPass;
  });
}
