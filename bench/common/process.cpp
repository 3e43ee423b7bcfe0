#include "process.h"

#include <fcntl.h>
#include <spawn.h>
#include <sys/wait.h>
#include <unistd.h>

#include <cerrno>
#include <fstream>
#include <sstream>

#include "gantry/foundation/error.h"
#include "markdown.h"

namespace gantry::bench {
namespace {

/// One line of /proc/self/status, in MB.
double status_mb(const std::string& key) {
  std::ifstream status("/proc/self/status");
  for (std::string line; std::getline(status, line);)
    if (line.starts_with(key + ":")) return std::stod(line.substr(key.size() + 1)) / 1024;
  throw InputError("/proc/self/status: has no " + key);
}

}  // namespace

Spent run_process(std::vector<std::string> words, const std::vector<std::string>& settings) {
  std::vector<std::string> variables = settings;
  for (char** variable = environ; *variable; ++variable) variables.emplace_back(*variable);
  const auto pointers = [](std::vector<std::string>& strings) {
    std::vector<char*> result;
    for (std::string& s : strings) result.push_back(s.data());
    result.push_back(nullptr);
    return result;
  };
  posix_spawn_file_actions_t files;
  posix_spawn_file_actions_init(&files);
  posix_spawn_file_actions_addopen(&files, STDOUT_FILENO, "/dev/null", O_WRONLY, 0);
  const Stopwatch watch;
  pid_t child = 0;
  const int failed = posix_spawnp(&child, words[0].c_str(), &files, nullptr, pointers(words).data(),
                                  pointers(variables).data());
  posix_spawn_file_actions_destroy(&files);
  if (failed != 0) throw InputError(words[0] + ": cannot be started");
  int status = 0;
  while (waitpid(child, &status, 0) < 0 && errno == EINTR) {
  }
  if (status != 0) {
    std::string command;
    for (const std::string& word : words) command += word + " ";
    throw InputError("this process failed: " + command);
  }
  return watch.spent();
}

bool is_installed(const std::string& program) {
  const char* path = std::getenv("PATH");
  std::istringstream folders(path ? path : "");
  for (std::string folder; std::getline(folders, folder, ':');)
    if (access((folder + "/" + program).c_str(), X_OK) == 0) return true;
  return false;
}

double memory_mb() {
  return status_mb("VmRSS");
}
double peak_memory_mb() {
  return status_mb("VmHWM");
}

TemporaryFolder::TemporaryFolder()
    : path(std::filesystem::temp_directory_path() / text("gantry-bench-%d", static_cast<int>(getpid()))) {
  std::filesystem::create_directories(path);
}

TemporaryFolder::~TemporaryFolder() {
  std::error_code ignored;
  std::filesystem::remove_all(path, ignored);
}

}  // namespace gantry::bench
