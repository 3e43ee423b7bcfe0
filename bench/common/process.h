#pragma once

#include <filesystem>
#include <string>
#include <vector>

#include "stopwatch.h"

namespace gantry::bench {

/// Runs a program (words[0], looked up in PATH unless it has a slash), silently, with `settings`
/// ("NAME=value") added to the environment, and waits for it. Throws InputError when it cannot be started or
/// fails.
Spent run_process(std::vector<std::string> words, const std::vector<std::string>& settings = {});

/// Whether a program of this name is found in PATH.
bool is_installed(const std::string& program);

/// Of this process, now and at most so far.
double memory_mb();
double peak_memory_mb();

/// Removed with all that it holds, also when a measurement fails.
struct TemporaryFolder {
  const std::filesystem::path path;
  TemporaryFolder();
  TemporaryFolder(const TemporaryFolder&) = delete;
  TemporaryFolder& operator=(const TemporaryFolder&) = delete;
  ~TemporaryFolder();
};

}  // namespace gantry::bench
