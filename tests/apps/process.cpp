#include "apps/process.h"

#include <fcntl.h>
#include <poll.h>
#include <signal.h>
#include <sys/wait.h>
#include <unistd.h>

#include <chrono>
#include <stdexcept>

namespace gantry::testing {
namespace {

using Clock = std::chrono::steady_clock;

double seconds_since(Clock::time_point start) { return std::chrono::duration<double>(Clock::now() - start).count(); }

int decode(int status) { return WIFEXITED(status) ? WEXITSTATUS(status) : 128 + WTERMSIG(status); }

int spawn(const std::string& name, const std::vector<std::string>& arguments, int out, int err) {
  const std::string path = std::string(GANTRY_BIN_DIR) + "/" + name;
  std::vector<char*> argv{const_cast<char*>(path.c_str())};
  for (const std::string& a : arguments) argv.push_back(const_cast<char*>(a.c_str()));
  argv.push_back(nullptr);
  const int pid = fork();
  if (pid < 0) throw std::runtime_error("fork failed");
  if (pid == 0) {
    dup2(out, STDOUT_FILENO);
    dup2(err, STDERR_FILENO);
    execv(path.c_str(), argv.data());
    _exit(127);
  }
  return pid;
}

}  // namespace

ProcessResult run_program(const std::string& name, const std::vector<std::string>& arguments, double timeout_s) {
  int out[2], err[2];
  if (pipe2(out, O_CLOEXEC) != 0 || pipe2(err, O_CLOEXEC) != 0) throw std::runtime_error("pipe failed");
  const int pid = spawn(name, arguments, out[1], err[1]);
  close(out[1]);
  close(err[1]);
  ProcessResult result;
  const auto start = Clock::now();
  pollfd fds[2] = {{out[0], POLLIN, 0}, {err[0], POLLIN, 0}};
  std::string* sinks[2] = {&result.out, &result.err};
  bool killed = false;
  for (int open = 2; open > 0;) {
    poll(fds, 2, 100);
    if (!killed && seconds_since(start) > timeout_s) {
      kill(pid, SIGKILL);
      killed = true;
    }
    for (int k = 0; k < 2; ++k) {
      if (fds[k].fd < 0 || fds[k].revents == 0) continue;
      char buffer[4096];
      const ssize_t n = read(fds[k].fd, buffer, sizeof buffer);
      if (n > 0) {
        sinks[k]->append(buffer, static_cast<size_t>(n));
      } else {
        close(fds[k].fd);
        fds[k].fd = -1;
        --open;
      }
    }
  }
  int status = 0;
  waitpid(pid, &status, 0);
  result.exit_code = decode(status);
  return result;
}

BackgroundProgram::BackgroundProgram(const std::string& name, const std::vector<std::string>& arguments) {
  int out[2];
  if (pipe2(out, O_CLOEXEC) != 0) throw std::runtime_error("pipe failed");
  const int null = open("/dev/null", O_WRONLY | O_CLOEXEC);
  pid_ = spawn(name, arguments, out[1], null);
  close(out[1]);
  close(null);
  out_ = out[0];
}

BackgroundProgram::~BackgroundProgram() {
  if (running()) {
    kill(pid_, SIGKILL);
    wait();
  }
  close(out_);
}

bool BackgroundProgram::running() {
  if (exit_code_ >= 0) return false;
  int status = 0;
  if (waitpid(pid_, &status, WNOHANG) == 0) return true;
  exit_code_ = decode(status);
  return false;
}

bool BackgroundProgram::wait_for_line(const std::string& line, double timeout_s) {
  const auto start = Clock::now();
  while (seconds_since(start) < timeout_s) {
    if (("\n" + seen_).find("\n" + line + "\n") != std::string::npos) return true;
    pollfd fd{out_, POLLIN, 0};
    if (poll(&fd, 1, 100) <= 0) {
      if (!running()) return false;
      continue;
    }
    char buffer[4096];
    const ssize_t n = read(out_, buffer, sizeof buffer);
    if (n <= 0) return false;
    seen_.append(buffer, static_cast<size_t>(n));
  }
  return false;
}

void BackgroundProgram::send_signal(int signal) {
  if (running()) kill(pid_, signal);
}

int BackgroundProgram::wait() {
  if (exit_code_ >= 0) return exit_code_;
  int status = 0;
  waitpid(pid_, &status, 0);
  return exit_code_ = decode(status);
}

}  // namespace gantry::testing
