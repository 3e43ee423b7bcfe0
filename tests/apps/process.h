#pragma once

#include <string>
#include <vector>

namespace gantry::testing {

struct ProcessResult {
  int exit_code = -1;  ///< 128 + signal when a signal ended it.
  std::string out, err;
};

/// Runs a program of this build to its end; `timeout_s` kills it (exit code 128 + SIGKILL).
ProcessResult run_program(const std::string& name, const std::vector<std::string>& arguments, double timeout_s = 60);

/// A program that runs in the background; killed by the destructor.
class BackgroundProgram {
 public:
  BackgroundProgram(const std::string& name, const std::vector<std::string>& arguments);
  ~BackgroundProgram();
  BackgroundProgram(const BackgroundProgram&) = delete;
  BackgroundProgram& operator=(const BackgroundProgram&) = delete;

  /// Waits until stdout has a line equal to `line`; false when the program ended or time is up.
  bool wait_for_line(const std::string& line, double timeout_s);
  void send_signal(int signal);
  /// Waits for the end and returns the exit code as in ProcessResult.
  int wait();
  bool running();

 private:
  int pid_ = -1;
  int out_ = -1;
  int exit_code_ = -1;
  std::string seen_;
};

}  // namespace gantry::testing
