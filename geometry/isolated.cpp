#include "isolated.h"

#include <fcntl.h>
#include <poll.h>
#include <sys/wait.h>
#include <unistd.h>

#include <array>
#include <cerrno>
#include <chrono>
#include <csignal>
#include <cstring>

#include "gantry/foundation/error.h"

namespace gantry::internal {
namespace {

constexpr char kDone = 'D', kRefused = 'R';

void write_all(int fd, const std::string& bytes) {
  for (size_t at = 0; at < bytes.size();) {
    const ssize_t written = ::write(fd, bytes.data() + at, bytes.size() - at);
    if (written < 0 && errno == EINTR) continue;
    if (written <= 0) ::_exit(1);
    at += static_cast<size_t>(written);
  }
}

/// Never returns: no destructor and no atexit() handler of the original may run a second time.
[[noreturn]] void work_as_copy(const std::function<std::string()>& work, int fd) {
  // What libraries print must not mix with results on stdout, nor what the original had not yet flushed.
  if (const int nowhere = ::open("/dev/null", O_WRONLY); nowhere >= 0) ::dup2(nowhere, STDOUT_FILENO);
  std::string answer;
  try {
    answer = kDone + work();
  } catch (const std::exception& e) {
    answer = kRefused + std::string(e.what());
  } catch (...) {
    answer = kRefused + std::string("refused for a reason that it does not tell");
  }
  write_all(fd, answer);
  ::_exit(0);
}

}  // namespace

std::string run_isolated(const std::function<std::string()>& work, double timeout_s,
                         const std::string& what) {
  using Clock = std::chrono::steady_clock;
  std::array<int, 2> ends{};
  if (::pipe(ends.data()) != 0) throw InputError(what + ": no pipe could be opened: " + std::strerror(errno));
  const pid_t copy = ::fork();
  if (copy < 0) {
    for (const int end : ends) ::close(end);
    throw InputError(what + ": no process could be started to read it: " + std::strerror(errno));
  }
  if (copy == 0) {
    ::close(ends[0]);
    work_as_copy(work, ends[1]);
  }
  ::close(ends[1]);
  std::string answer;
  const auto deadline = Clock::now() + std::chrono::duration<double>(timeout_s);
  bool late = false;
  for (std::array<char, 65536> buffer{};;) {
    const auto left = std::chrono::duration_cast<std::chrono::milliseconds>(deadline - Clock::now()).count();
    pollfd waiting{ends[0], POLLIN, 0};
    const int ready = left > 0 ? ::poll(&waiting, 1, static_cast<int>(std::min<long long>(left, 1000))) : 0;
    if (ready < 0 && errno == EINTR) continue;
    if (ready == 0) {
      late = left <= 0;
      if (late) break;
      continue;
    }
    const ssize_t count = ::read(ends[0], buffer.data(), buffer.size());
    if (count < 0 && errno == EINTR) continue;
    if (count <= 0) break;
    answer.append(buffer.data(), static_cast<size_t>(count));
  }
  ::close(ends[0]);
  if (late) ::kill(copy, SIGKILL);
  int status = 0;
  while (::waitpid(copy, &status, 0) < 0 && errno == EINTR) {
  }
  if (late)
    throw InputError(what + ": reading it took longer than " + std::to_string(static_cast<int>(timeout_s)) +
                     " s: it is damaged, or far too detailed");
  if (answer.empty() || !WIFEXITED(status) || WEXITSTATUS(status) != 0)
    throw InputError(what + ": the library that reads it crashed: the file is damaged");
  if (answer.front() == kRefused) throw InputError(what + ": " + answer.substr(1));
  return answer.substr(1);
}

}  // namespace gantry::internal
