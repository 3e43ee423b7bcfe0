// How punctual the control loop is, and how straight coordinated moves are: three Modbus TCP drives on two
// buses, answered by the twin on loopback, under the real threads. Writes the page
// docs/results/supervisor.md.

#include <algorithm>
#include <array>
#include <atomic>
#include <cmath>
#include <cstdio>
#include <cstdlib>
#include <fstream>
#include <numbers>
#include <thread>

#include "app.h"
#include "gantry/acquisition/motion.h"
#include "gantry/hal/modbus_drives.h"
#include "gantry/sim/twin/modbus_drives.h"
#include "markdown.h"

namespace {

using namespace gantry;
using namespace gantry::bench;

constexpr size_t kAxes = 3;
constexpr double kDeg = std::numbers::pi / 180;
constexpr double kStepsPerRevolution = 72000;

/// The demo cell's stages behind the twin's drives, and Motion on top.
class Rig {
 public:
  Rig() : slider_("127.0.0.1", 0, clock_), gateway_("127.0.0.1", 0, clock_) {
    stages_[0] = std::make_unique<SimulatedStage>(stage(1, {0, 300, 200, 1000, 100, 0.01, 0.005}), 1);
    stages_[1] = std::make_unique<SimulatedStage>(stage(kDeg, {-190, 190, 90, 400, 60, 0.005, 0.002}), 2);
    stages_[2] = std::make_unique<SimulatedStage>(stage(kDeg, {-80, 80, 60, 300, 40, 0.005, 0.002}), 3);
    const double step = 2 * std::numbers::pi / kStepsPerRevolution;
    slider_.add({"iai_robo_cylinder", 1, 0.01}, *stages_[0]);
    gateway_.add({"oriental_motor_az", 2, step}, *stages_[1]);
    gateway_.add({"oriental_motor_az", 3, step}, *stages_[2]);
    slider_.start();
    gateway_.start();

    const auto slider_bus = make_modbus_bus("127.0.0.1", slider_.port());
    const auto gateway_bus = make_modbus_bus("127.0.0.1", gateway_.port());
    std::vector<std::unique_ptr<Axis>> axes;
    std::vector<AxisSettings> settings;
    const auto add = [&](const char* name, AxisKind kind, int unit, double lower, double upper, double speed,
                         double acceleration, double band) {
      AxisSettings axis;
      axis.name = name;
      axis.kind = kind;
      const double scale = kind == AxisKind::kRotary ? kDeg : 1;
      axis.limits.lower = lower * scale;
      axis.limits.upper = upper * scale;
      axis.limits.speed = speed * scale;
      axis.limits.acceleration = acceleration * scale;
      axis.limits.in_position = band * scale;
      axis.limits.data_limit_s = 10;  // The twin has ordinary threads, which the load keeps waiting.
      ModbusDriveConfig config;
      config.axis = name;
      config.kind = kind;
      config.unit = unit;
      config.host = "127.0.0.1";
      config.response_timeout_s = 5;
      const bool linear = kind == AxisKind::kLinear;
      config.profile = linear ? "iai_robo_cylinder" : "oriental_motor_az";
      config.port = linear ? slider_.port() : gateway_.port();
      if (!linear) config.counts_per_axis_unit = kStepsPerRevolution / (2 * std::numbers::pi);
      axes.push_back(std::make_unique<Axis>(
          make_modbus_drive(config, linear ? slider_bus : gateway_bus, clock_), kind, axis.limits, clock_));
      settings.push_back(axis);
    };
    add("linear", AxisKind::kLinear, 1, 5, 295, 120, 600, 0.03);
    add("rotation", AxisKind::kRotary, 2, -185, 185, 60, 240, 0.02);
    add("tilt", AxisKind::kRotary, 3, -75, 75, 40, 160, 0.02);
    motion = std::make_unique<Motion>(std::move(axes), settings, MotionOptions{{}, 0, true, {0, 1, 1}, {}},
                                      clock_);
    require(motion->connect());
    require(motion->enable());
    require(motion->home({{"linear", "rotation", "tilt"}}));
  }

  static void require(const Result<void>& result) {
    if (!result) throw DeviceError(result.error());
  }

  std::array<double, kAxes> truth() {
    std::array<double, kAxes> q;
    for (size_t i = 0; i < kAxes; ++i) q[i] = stages_[i]->observe(clock_.now_s()).true_position;
    return q;
  }

  std::unique_ptr<Motion> motion;

 private:
  static StageDynamics stage(double scale, std::array<double, 7> v) {
    return {v[0] * scale, v[1] * scale, v[2] * scale, v[3] * scale, v[4] * scale, v[5] * scale, v[6] * scale};
  }

  SteadyClock clock_;
  std::array<std::unique_ptr<SimulatedStage>, kAxes> stages_;
  ModbusDriveServer slider_, gateway_;
};

/// Ordinary threads that compute without end, as fusion does.
class Load {
 public:
  explicit Load(unsigned threads) {
    for (unsigned i = 0; i < threads; ++i)
      threads_.emplace_back([this] {
        double x = 1;
        while (!ending_) x = std::sin(x) + 1.5;
        sink_ = x;
      });
  }
  ~Load() {
    ending_ = true;
    for (std::thread& thread : threads_) thread.join();
  }

 private:
  std::atomic<bool> ending_{false};
  std::atomic<double> sink_{0};
  std::vector<std::thread> threads_;
};

/// Largest distances of the axes from the straight line, each with the middle one of the three as the
/// measure.
struct Deviation {
  std::array<double, kAxes> worst{};
};

Deviation move_and_measure(Rig& rig, const std::array<double, kAxes>& to) {
  const std::array<double, kAxes> from = rig.truth();
  std::atomic<bool> arrived{false};
  Deviation deviation;
  std::thread watcher([&] {
    while (!arrived) {
      const auto q = rig.truth();
      std::array<double, kAxes> s;
      for (size_t i = 0; i < kAxes; ++i) s[i] = (q[i] - from[i]) / (to[i] - from[i]);
      std::array<double, kAxes> sorted = s;
      std::sort(sorted.begin(), sorted.end());
      for (size_t i = 0; i < kAxes; ++i)
        deviation.worst[i] =
            std::max(deviation.worst[i], std::abs(s[i] - sorted[1]) * std::abs(to[i] - from[i]));
      std::this_thread::sleep_for(std::chrono::milliseconds(1));
    }
  });
  const auto moved = rig.motion->move_to(to);
  arrived = true;
  watcher.join();
  if (!moved) throw DeviceError(moved.error());
  return deviation;
}

const std::array<double, kAxes> kPlaces[] = {{280, 170 * kDeg, 60 * kDeg},
                                             {20, -160 * kDeg, -60 * kDeg},
                                             {100, 120 * kDeg, 30 * kDeg},
                                             {110, -120 * kDeg, -30 * kDeg}};

}  // namespace

int main(int argc, char** argv) {
  CLI::App app{
      "Punctuality of the control loop and straightness of coordinated moves.\n"
      "Example: scripts/bench supervisor",
      "gantry-bench-supervisor"};
  CommonOptions common;
  add_common_options(app, common);
  double duration_s = 60;
  std::filesystem::path out = "docs/results";
  app.add_option("--seconds", duration_s, "Of each measurement")
      ->check(number_within(1, 3600))
      ->capture_default_str();
  app.add_option("--out", out, "Folder of the page")->capture_default_str();
  return run_app(app, argc, argv, common, [&] {
    double load_before[3] = {};
    ::getloadavg(load_before, 3);
    const unsigned cores = std::max(1u, std::thread::hardware_concurrency());
    Table punctual(
        {"loop", "cycles", "missed", "late: median", "99 %", "largest", "busy: median", "99 %", "largest"});
    Table straight({"", "linear", "rotation", "tilt"});
    std::string granted;
    for (const bool loaded : {false, true}) {
      Rig rig;
      std::optional<Load> load;
      if (loaded) load.emplace(cores);
      const auto end = std::chrono::steady_clock::now() + std::chrono::duration<double>(duration_s);
      Deviation worst;
      size_t moves = 0;
      while (std::chrono::steady_clock::now() < end) {
        const Deviation d = move_and_measure(rig, kPlaces[moves++ % std::size(kPlaces)]);
        for (size_t i = 0; i < kAxes; ++i) worst.worst[i] = std::max(worst.worst[i], d.worst[i]);
      }
      const LoopStatistics s = *rig.motion->loop_statistics();
      const RealTimeGrant grant = *rig.motion->real_time_grant();
      granted = std::string(grant.fifo ? "SCHED_FIFO" : "ordinary scheduling") + ", memory " +
                (grant.memory_locked ? "locked" : "not locked");
      const std::string name = loaded ? text("with %u busy threads beside it", cores) : "alone";
      const auto us = [](double value) { return text("%.0f us", value); };
      punctual.add({name, std::to_string(s.cycles), std::to_string(s.missed), us(s.late_p50_us),
                    us(s.late_p99_us), us(s.late_max_us), us(s.busy_p50_us), us(s.busy_p99_us),
                    us(s.busy_max_us)});
      straight.add({text("%s, %zu moves", name.c_str(), moves), text("%.3f mm", worst.worst[0]),
                    text("%.3f deg", worst.worst[1] / kDeg), text("%.3f deg", worst.worst[2] / kDeg)});
    }
    std::filesystem::create_directories(out);
    std::ofstream page(out / "supervisor.md");
    page << "# Punctuality of the control loop, straightness of moves\n\n"
         << "Written by `scripts/bench supervisor` (" << duration_s << " s each, " << cores << " cores, "
         << granted << text("; load average before it began: %.1f", load_before[0])
         << "). Three drives on two Modbus TCP buses, answered by the twin\n"
         << "on loopback in the same process; the axes move all the time. Lateness is how long after its due "
            "time a "
            "cycle of 10 ms began; bins of 10 us.\n\n"
         << punctual.str()
         << "\nLargest distance of an axis from the straight line in joint space during coordinated moves "
            "over "
            "nearly the whole travel, measured on the true positions:\n\n"
         << straight.str()
         << "\nIt is the drives' different starting times (a command reaches one bus before the other, and "
            "one "
            "unit of a bus before the next) and the rounding of speed and\nacceleration to their units that "
            "make "
            "it; a real drive adds its own reaction time. A check of paths must leave so much room.\n";
    std::printf("%s\n%s\nwritten: %s\n", punctual.str().c_str(), straight.str().c_str(),
                (out / "supervisor.md").c_str());
    return ExitCode::kPass;
  });
}
