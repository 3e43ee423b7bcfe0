#include "motion_commands.h"

#include <spdlog/spdlog.h>
#include <unistd.h>

#include <algorithm>
#include <chrono>
#include <cmath>
#include <cstdio>
#include <numbers>
#include <thread>

#include "app.h"
#include "jog_keys.h"
#include "motion_status.h"
#include "progress.h"

namespace gantry {
namespace {

constexpr double kWatchInterval_s = 0.5;

std::string names(const Cell& cell) {
  std::string text;
  for (const AxisSettings& axis : cell.axes) text += (text.empty() ? "" : ", ") + axis.name;
  return text;
}

Cell read_axes(const std::filesystem::path& path) {
  Cell cell = read_cell(path);
  cell.scanner.kind = "genicam3d";  // Not opened here, and no world is needed for it.
  return cell;
}

void require_axis(const Cell& cell, const std::string& name) {
  for (const AxisSettings& axis : cell.axes)
    if (axis.name == name) return;
  throw InputError("--axis: " + cell.file.string() + " has no axis '" + name + "'; it has " + names(cell));
}

/// The axes of a cell under the control of this process, for one command.
class AxisSession {
 public:
  AxisSession(const std::filesystem::path& path, const std::string& command)
      : cell(read_axes(path)),
        devices(make_devices(cell, std::nullopt, 1, clock_)),
        motion(*devices.motion),
        progress(stdout_is_terminal()),
        session_(take_control(cell, devices, command)) {
    install_stop_handler();
    motion.cancel_when([] { return stop_requested().load(); });
    motion.on_progress([this](const std::vector<AxisStatus>& now) { progress.axes(motion.axes(), now); });
  }

  Result<void> connect(const std::string& command) {
    auto connected = motion.connect();
    publish_status(session_, cell, devices, command);
    return connected;
  }

  /// Ends the command with the fault, and with a hint where a reset is needed to go on.
  void require(const Result<void>& result) {
    if (result) return;
    progress.clear();
    for (const AxisStatus& axis : motion.statuses()) {
      if (axis.state != AxisState::kErrorStop) continue;
      spdlog::info("once the cause is gone: gantry-cell reset --cell {}", cell.file.string());
      break;
    }
    throw DeviceError(result.error());
  }

 private:
  SteadyClock clock_;

 public:
  const Cell cell;
  CellDevices devices;
  Motion& motion;
  Progress progress;

 private:
  std::optional<CellSession> session_;
};

HomingOrder only(const HomingOrder& order, const std::vector<std::string>& wanted) {
  if (wanted.empty()) return order;
  HomingOrder out;
  for (const auto& group : order) {
    std::vector<std::string> kept;
    for (const std::string& name : group)
      if (std::find(wanted.begin(), wanted.end(), name) != wanted.end()) kept.push_back(name);
    if (!kept.empty()) out.push_back(kept);
  }
  return out;
}

double in_axis_units(const Axis& axis, double value) {
  return axis.kind() == AxisKind::kRotary ? value * std::numbers::pi / 180 : value;
}

/// Hold to run: the terminal repeats a key that is held, and the motion goes on while it does.
void jog_by_keys(AxisSession& session, size_t axis) {
  const Axis& jogged = *session.motion.axes()[axis];
  std::printf("jogging %s: hold the right or left arrow (or + and -) to move; any other key stops; q ends\n",
              jogged.name().c_str());
  JogKeys keys;
  int direction = 0;  // of the motion under way
  for (;;) {
    const JogKey key = keys.wait(0.02);
    if (key == JogKey::kQuit || stop_requested()) break;
    const SupervisorStatus now = session.motion.figures();
    const AxisState state = now.axes[axis].state;
    if (state == AxisState::kStandstill) direction = 0;
    const int wanted = key == JogKey::kForward ? 1 : key == JogKey::kBackward ? -1 : 0;
    if (wanted != 0 && wanted == direction) {
      session.motion.keep_jogging();
    } else if (wanted != 0 && state == AxisState::kStandstill) {
      if (const auto started = session.motion.start_jog(axis, wanted); !started) {
        std::printf("\n%s\n", started.error().text().c_str());
      } else {
        direction = wanted;
      }
    } else if (wanted != 0 || key == JogKey::kStop) {
      session.motion.request_stop();
    }
    session.require(session.motion.watch_for(0));
  }
  session.motion.request_stop();
  session.require(session.motion.watch_for(0.1));
}

void show(const nlohmann::json& status, bool json, bool redraw, bool first) {
  const std::string text = json ? status.dump() + "\n" : status_table(status);
  if (redraw && !first) std::printf("\033[H\033[J");
  if (redraw && first) std::printf("\033[2J\033[H");
  std::fputs(text.c_str(), stdout);
  std::fflush(stdout);
}

/// What the process that controls the cell says of it.
nlohmann::json status_of_holder(const Cell& cell, const Fault& busy) {
  const auto text = CellSession::published(cell.file);
  if (!text)
    throw DeviceError(Fault{busy.kind, busy.device, busy.message + " (it has not told its status yet)"});
  const nlohmann::json status = nlohmann::json::parse(*text, nullptr, false);
  if (!status.is_object())
    throw DeviceError(Fault{FaultKind::kProtocol, busy.device, "its status cannot be read"});
  return status;
}

}  // namespace

std::optional<CellSession> take_control(const Cell& cell, const CellDevices& devices,
                                        const std::string& command) {
  if (devices.axes_in_process) return std::nullopt;
  auto session = CellSession::open(cell.file, command);
  if (!session) throw DeviceError(session.error());
  return std::move(*session);
}

void publish_status(std::optional<CellSession>& session, const Cell& cell, const CellDevices& devices,
                    const std::string& command) {
  if (session)
    session->publish([&cell, &devices, command] { return status_json(cell, devices, command).dump(); });
}

Result<void> power_up(const Cell& cell, Motion& motion) {
  if (cell.safety) motion.wait_for(cell.safety->settle_s());
  if (motion.figures().stop != StopCategory::kNone)
    if (auto reset = motion.reset(); !reset) return reset;
  return motion.enable();
}

MotionCommands::MotionCommands(CLI::App& app) {
  const auto with_cell = [this](CLI::App* command) {
    command->add_option("--cell", cell_, "CELL.yaml")->required();
    return command;
  };
  home_ = with_cell(app.add_subcommand("home",
                                       "Power and home the axes in the order of CELL.yaml\nExample: "
                                       "gantry-cell home --cell CELL.yaml --axis tilt"));
  home_->add_option("--axis", axes_, "Only this axis; may be repeated");
  jog_ = with_cell(app.add_subcommand("jog",
                                      "Move one axis by hand: hold an arrow key, or --by\n"
                                      "Example: gantry-cell jog --cell CELL.yaml --axis tilt --by -2.5"));
  jog_->add_option("--axis", axis_, "The axis to move")->required();
  jog_->add_option("--by", by_, "So far (mm or degrees), and end; without it: keys")
      ->check(number_within(-1e5, 1e5));
  status_ = with_cell(app.add_subcommand(
      "status", "Show the axes and the control loop; of a cell that another process runs, its live figures"));
  status_->add_flag("--watch", watch_, "Go on showing until Ctrl-C");
  status_->add_flag("--json", json_, "Print as JSON, one line each time");
  reset_ = with_cell(
      app.add_subcommand("reset", "Clear errors and drive alarms whose cause is gone; powers nothing"));
}

ExitCode MotionCommands::run() {
  if (home_->parsed()) return home();
  if (jog_->parsed()) return jog();
  if (reset_->parsed()) return reset();
  return status();
}

ExitCode MotionCommands::home() {
  AxisSession session(cell_, "gantry-cell home");
  for (const std::string& axis : axes_) require_axis(session.cell, axis);
  session.progress.stage("homing");
  session.require(session.connect("gantry-cell home"));
  session.require(power_up(session.cell, session.motion));
  const HomingOrder order = only(session.cell.homing_order, axes_);
  session.require(session.motion.home(order));
  session.progress.clear();
  std::printf("homed:");
  for (const auto& group : order)
    for (const std::string& axis : group) std::printf(" %s", axis.c_str());
  std::printf("\n");
  return ExitCode::kPass;
}

ExitCode MotionCommands::jog() {
  if (!by_ && (isatty(STDIN_FILENO) == 0 || isatty(STDOUT_FILENO) == 0))
    throw InputError("jog: keys need a terminal; without one say how far: --by MM_OR_DEG");
  AxisSession session(cell_, "gantry-cell jog");
  require_axis(session.cell, axis_);
  const size_t axis = *session.motion.axis_named(axis_);
  session.require(session.connect("gantry-cell jog"));
  session.require(power_up(session.cell, session.motion));
  const Axis& jogged = *session.motion.axes()[axis];
  if (by_)
    session.require(session.motion.jog_by(axis, in_axis_units(jogged, *by_)));
  else
    jog_by_keys(session, axis);
  session.progress.clear();
  const DriveStatus drive = session.motion.statuses()[axis].drive;
  std::printf("%s stands at %s%s\n", axis_.c_str(), jogged.format(drive.position).c_str(),
              drive.homed ? "" : " (not homed: by an encoder with an unknown origin)");
  return ExitCode::kPass;
}

ExitCode MotionCommands::reset() {
  AxisSession session(cell_, "gantry-cell reset");
  (void)session.connect("gantry-cell reset");  // What is wrong is what there is to reset.
  if (session.cell.safety) session.motion.wait_for(session.cell.safety->settle_s());
  const auto done = session.motion.reset();
  session.progress.clear();
  std::fputs(status_table(status_json(session.cell, session.devices, "gantry-cell reset")).c_str(), stdout);
  if (!done) throw DeviceError(done.error());
  return ExitCode::kPass;
}

ExitCode MotionCommands::status() {
  install_stop_handler();
  Cell cell = read_axes(cell_);
  cell.drive_timeout_s = 0;  // Looking changes nothing.
  SteadyClock clock;
  const bool redraw = watch_ && !json_ && stdout_is_terminal();
  std::optional<Fault> fault;
  for (bool first = true; first || (watch_ && !stop_requested()); first = false) {
    if (!first) std::this_thread::sleep_for(std::chrono::duration<double>(kWatchInterval_s));
    fault.reset();
    CellDevices devices = make_devices(cell, std::nullopt, 1, clock, false);
    std::optional<CellSession> session;
    if (!devices.axes_in_process) {
      auto opened = CellSession::open(cell.file, "gantry-cell status", first ? 0.5 : 0.0);
      if (!opened) {
        const nlohmann::json live = status_of_holder(cell, opened.error());
        try {
          show(live, json_, redraw, first);
        } catch (const nlohmann::json::exception& e) {  // Of another version of this program, perhaps.
          throw DeviceError(Fault{FaultKind::kProtocol, opened.error().device,
                                  std::string("the status of its process cannot be read: ") + e.what()});
        }
        continue;
      }
      session.emplace(std::move(*opened));
    }
    if (const auto connected = devices.motion->connect(); !connected) fault = connected.error();
    if (cell.safety && !fault) devices.motion->wait_for(cell.safety->settle_s());
    show(status_json(cell, devices, "gantry-cell status"), json_, redraw, first);
  }
  if (fault) throw DeviceError(*fault);
  return ExitCode::kPass;
}

}  // namespace gantry
