#pragma once

#include <sys/resource.h>

#include <chrono>

namespace gantry::bench {

/// Time that something took. Wall time depends on what else the machine does; CPU time (user and system, all
/// threads of this process) hardly.
struct Spent {
  double wall_s = 0, cpu_s = 0;

  Spent& operator+=(const Spent& other) {
    wall_s += other.wall_s;
    cpu_s += other.cpu_s;
    return *this;
  }
};

class Stopwatch {
 public:
  Spent spent() const { return {wall_now() - wall_begin_, cpu_now() - cpu_begin_}; }

 private:
  static double wall_now() {
    return std::chrono::duration<double>(std::chrono::steady_clock::now().time_since_epoch()).count();
  }
  static double cpu_now() {
    rusage usage{};
    getrusage(RUSAGE_SELF, &usage);
    const auto seconds = [](const timeval& t) {
      return static_cast<double>(t.tv_sec) + 1e-6 * static_cast<double>(t.tv_usec);
    };
    return seconds(usage.ru_utime) + seconds(usage.ru_stime);
  }

  double wall_begin_ = wall_now(), cpu_begin_ = cpu_now();
};

}  // namespace gantry::bench
