#pragma once

#include <CLI/CLI.hpp>
#include <filesystem>
#include <optional>
#include <string>
#include <vector>

#include "cell_devices.h"
#include "gantry/acquisition/cell_session.h"
#include "gantry/foundation/error.h"

namespace gantry {

/// Takes the cell for this process. Throws DeviceError naming the holder when another process has it.
/// Nothing for a cell that lives in this process alone.
std::optional<CellSession> take_control(const Cell& cell, const CellDevices& devices,
                                        const std::string& command);

/// Lets other processes' `gantry-cell status` see the axes. Both must stay until the session ends.
void publish_status(std::optional<CellSession>& session, const Cell& cell, const CellDevices& devices,
                    const std::string& command);

/// Powers the axes at an operator's command, which is also the reset edge of a latched safety chain; that
/// takes it only when every input is closed.
Result<void> power_up(const Cell& cell, Motion& motion);

/// `gantry-cell home | jog | status | reset`.
class MotionCommands {
 public:
  /// Adds the subcommands to `app`.
  explicit MotionCommands(CLI::App& app);
  /// Runs the one that was parsed.
  ExitCode run();

 private:
  ExitCode home();
  ExitCode jog();
  ExitCode status();
  ExitCode reset();

  CLI::App *home_, *jog_, *status_, *reset_;
  std::filesystem::path cell_;
  std::vector<std::string> axes_;
  std::string axis_;
  std::optional<double> by_;
  bool json_ = false, watch_ = false;
};

}  // namespace gantry
