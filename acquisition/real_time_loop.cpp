#include "gantry/acquisition/real_time_loop.h"

#include <pthread.h>
#include <sched.h>
#include <sys/mman.h>
#include <sys/resource.h>
#include <time.h>
#include <unistd.h>

#include <algorithm>
#include <cerrno>
#include <cmath>
#include <cstring>

namespace gantry {
namespace {

constexpr int64_t kNsPerS = 1'000'000'000;

int64_t now_ns() {
  timespec now{};
  clock_gettime(CLOCK_MONOTONIC, &now);
  return now.tv_sec * kNsPerS + now.tv_nsec;
}

void sleep_until_ns(int64_t due_ns) {
  const timespec due{due_ns / kNsPerS, due_ns % kNsPerS};
  while (clock_nanosleep(CLOCK_MONOTONIC, TIMER_ABSTIME, &due, nullptr) == EINTR) {
  }
}

}  // namespace

void DurationHistogram::record(double duration_us) {
  const auto bin = static_cast<size_t>(std::max(0.0, duration_us) / kBin_us);
  bins_[std::min(bin, bins_.size() - 1)].fetch_add(1, std::memory_order_relaxed);
  if (duration_us > max_us()) max_us_.store(duration_us, std::memory_order_relaxed);
}

double DurationHistogram::percentile_us(double fraction) const {
  uint64_t total = 0;
  for (const auto& bin : bins_) total += bin.load(std::memory_order_relaxed);
  const auto wanted = static_cast<uint64_t>(std::ceil(fraction * static_cast<double>(total)));
  uint64_t seen = 0;
  for (size_t i = 0; i < bins_.size() && wanted > 0; ++i) {
    seen += bins_[i].load(std::memory_order_relaxed);
    if (seen < wanted) continue;
    const bool beyond = i + 1 == bins_.size();
    return beyond ? max_us() : std::min(max_us(), static_cast<double>(i + 1) * kBin_us);
  }
  return total == 0 ? 0 : max_us();
}

std::string lock_memory() {
  rlimit limit{};
  getrlimit(RLIMIT_MEMLOCK, &limit);
  const int flags = MCL_CURRENT | MCL_FUTURE | MCL_ONFAULT;
  // Root (CAP_IPC_LOCK) is not bound by the limit.
  if (limit.rlim_cur != RLIM_INFINITY && geteuid() != 0)
    return "memory not locked: RLIMIT_MEMLOCK is " + std::to_string(limit.rlim_cur / 1024) +
           " kB; it must be unlimited";
  if (mlockall(flags) != 0) return std::string("memory not locked: ") + std::strerror(errno);
  return {};
}

std::string become_real_time(int priority) {
  sched_param parameters{};
  parameters.sched_priority = priority;
  const int error = pthread_setschedparam(pthread_self(), SCHED_FIFO, &parameters);
  if (error == 0) return {};
  return std::string("no SCHED_FIFO: ") + std::strerror(error) +
         " (RLIMIT_RTPRIO or CAP_SYS_NICE would permit it)";
}

RealTimeLoop::RealTimeLoop(double period_s, int priority, std::function<void()> cycle)
    : period_s_(period_s), cycle_(std::move(cycle)) {
  const std::string refused = lock_memory();
  grant_.memory_locked = refused.empty();
  grant_.note = refused;
  thread_ = std::thread([this, priority] { run(priority); });
  started_.wait(false);
}

RealTimeLoop::~RealTimeLoop() {
  ending_ = true;
  thread_.join();
}

void RealTimeLoop::run(int priority) {
  pthread_setname_np(pthread_self(), "gantry-loop");
  if (const std::string refused = become_real_time(priority); refused.empty())
    grant_.fifo = true;
  else
    grant_.note += (grant_.note.empty() ? "" : "; ") + refused;
  started_ = true;
  started_.notify_one();

  const auto period_ns = static_cast<int64_t>(period_s_ * kNsPerS);
  int64_t due_ns = now_ns() + period_ns;
  while (!ending_) {
    sleep_until_ns(due_ns);
    const int64_t begin_ns = now_ns();
    late_.record(static_cast<double>(begin_ns - due_ns) / 1e3);
    cycle_();
    const int64_t end_ns = now_ns();
    busy_.record(static_cast<double>(end_ns - begin_ns) / 1e3);
    ++cycles_;
    due_ns += period_ns;
    if (end_ns > due_ns) {
      const int64_t skipped = (end_ns - due_ns) / period_ns + 1;
      missed_ += static_cast<uint64_t>(skipped);
      due_ns += skipped * period_ns;
    }
  }
}

LoopStatistics RealTimeLoop::statistics() const {
  LoopStatistics s;
  s.cycles = cycles_;
  s.missed = missed_;
  s.late_p50_us = late_.percentile_us(0.5);
  s.late_p99_us = late_.percentile_us(0.99);
  s.late_max_us = late_.max_us();
  s.busy_p50_us = busy_.percentile_us(0.5);
  s.busy_p99_us = busy_.percentile_us(0.99);
  s.busy_max_us = busy_.max_us();
  return s;
}

}  // namespace gantry
