#pragma once

#include <sys/resource.h>

#include <chrono>

namespace gantry::bench {

/// Time that something took. Wall time depends on what else the machine does; CPU time (user and system, all
/// threads of this process, and processes it has waited for) hardly.
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
    double seconds = 0;
    for (const auto who : {RUSAGE_SELF, RUSAGE_CHILDREN}) {
      rusage usage{};
      getrusage(who, &usage);
      for (const timeval& t : {usage.ru_utime, usage.ru_stime})
        seconds += static_cast<double>(t.tv_sec) + 1e-6 * static_cast<double>(t.tv_usec);
    }
    return seconds;
  }

  double wall_begin_ = wall_now(), cpu_begin_ = cpu_now();
};

}  // namespace gantry::bench
