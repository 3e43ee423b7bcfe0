#pragma once

#include <CLI/CLI.hpp>
#include <atomic>
#include <filesystem>
#include <functional>
#include <string>

#include "gantry/foundation/error.h"

namespace gantry {

/// Options that every executable has.
struct CommonOptions {
  std::string log_level = "info";
  int threads = 0;  ///< 0: one per core.
};

void add_common_options(CLI::App& app, CommonOptions& options);

/// Parses the command line, runs `body`, and turns what it throws into a message on stderr and the
/// documented exit code: InputError and wrong options 2, DeviceError 3.
int run_app(CLI::App& app, int argc, char** argv, const CommonOptions& options,
            const std::function<ExitCode()>& body);

/// Accepts a number within [min, max] and nothing else: CLI's own checks let "nan" pass.
CLI::Validator number_within(double min, double max);

/// Throws InputError naming the option unless results can be written to `folder`, which need not exist yet:
/// better before hours of computing than after. Creates nothing.
void require_writable_folder(const std::string& option, const std::filesystem::path& folder);

/// Becomes true at SIGINT or SIGTERM once install_stop_handler() was called.
const std::atomic<bool>& stop_requested();
void install_stop_handler();

/// Whether stdout is a terminal: only then is progress shown.
bool stdout_is_terminal();

}  // namespace gantry
