#include "app.h"

#include <spdlog/sinks/stdout_color_sinks.h>
#include <spdlog/spdlog.h>
#include <tbb/global_control.h>
#include <unistd.h>

#include <csignal>
#include <cstdio>
#include <optional>

#include "gantry/geometry/mesh_file.h"

namespace gantry {
namespace {

std::atomic<bool> g_stop{false};

}  // namespace

void add_common_options(CLI::App& app, CommonOptions& options) {
  app.fallthrough();  // common options may also follow a subcommand
  app.set_version_flag("--version", "gantry " GANTRY_VERSION "\nSTEP files: " + step_support());
  app.add_option("--log-level", options.log_level, "trace, debug, info, warn, error or off")
      ->check(CLI::IsMember({"trace", "debug", "info", "warn", "error", "off"}))
      ->capture_default_str();
  app.add_option("--threads", options.threads, "Threads for computation; 0: one for each core")
      ->check(CLI::Range(0, 1024))
      ->capture_default_str();
  app.footer(app.get_footer() +
             "\nExit codes: 0 pass or done, 1 fail (out of tolerance), 2 wrong option or file, 3 device "
             "fault, 4 undecided.");
}

int run_app(CLI::App& app, int argc, char** argv, const CommonOptions& options,
            const std::function<ExitCode()>& body) {
  try {
    app.parse(argc, argv);
  } catch (const CLI::ParseError& e) {
    return app.exit(e) == 0 ? 0 : static_cast<int>(ExitCode::kInputError);
  }
  auto logger = spdlog::stderr_color_mt("gantry");
  logger->set_pattern("%^%l%$: %v");
  spdlog::set_default_logger(logger);
  spdlog::set_level(spdlog::level::from_str(options.log_level));
  std::optional<tbb::global_control> threads;
  if (options.threads > 0) threads.emplace(tbb::global_control::max_allowed_parallelism, options.threads);
  try {
    return static_cast<int>(body());
  } catch (const InputError& e) {
    spdlog::error("{}", e.what());
    return static_cast<int>(ExitCode::kInputError);
  } catch (const DeviceError& e) {
    spdlog::error("{}", e.what());
    return static_cast<int>(ExitCode::kDeviceFault);
  } catch (const std::filesystem::filesystem_error& e) {
    spdlog::error("{}", e.what());
    return static_cast<int>(ExitCode::kInputError);
  } catch (const std::exception& e) {
    spdlog::critical("internal error: {}; please report it", e.what());
    return static_cast<int>(ExitCode::kInputError);
  }
}

CLI::Validator number_within(double min, double max) {
  char range[80];
  std::snprintf(range, sizeof range, "number from %g to %g", min, max);
  const auto check = [=, text = std::string(range)](const std::string& word) -> std::string {
    double value = 0;
    if (CLI::detail::lexical_cast(word, value) && value >= min && value <= max) return {};
    return "expected a " + text + ", found " + word;
  };
  return CLI::Validator(check, "");
}

void require_writable_folder(const std::string& option, const std::filesystem::path& folder) {
  std::filesystem::path existing = std::filesystem::absolute(folder);
  while (!std::filesystem::exists(existing) && existing.has_relative_path())
    existing = existing.parent_path();
  if (!std::filesystem::is_directory(existing))
    throw InputError(option + ": " + existing.string() + " is a file; a folder is expected");
  if (::access(existing.c_str(), W_OK | X_OK) != 0)
    throw InputError(option + ": nothing may be written into " + existing.string());
}

const std::atomic<bool>& stop_requested() {
  return g_stop;
}

void install_stop_handler() {
  const auto handler = [](int) { g_stop = true; };
  std::signal(SIGINT, handler);
  std::signal(SIGTERM, handler);
}

bool stdout_is_terminal() {
  return isatty(STDOUT_FILENO) != 0;
}

}  // namespace gantry
