// How fast the Modbus buses are: commands per second and round trips, client and twin on this machine. Writes
// docs/results/buses.md.

#include <CLI/CLI.hpp>
#include <cstdio>
#include <fstream>
#include <functional>
#include <thread>

#include "app.h"
#include "gantry/hal/modbus_drives.h"
#include "gantry/sim/twin/modbus_drives.h"
#include "markdown.h"
#include "stopwatch.h"

namespace {

using namespace gantry;

constexpr int kUnits = 3;

/// Three AZ motors on one endpoint of the twin, and a client's drives on one bus.
class Rig {
 public:
  Rig(std::unique_ptr<ModbusDriveServer> server, Clock& clock) : server_(std::move(server)) {
    for (int unit = 1; unit <= kUnits; ++unit) {
      stages_.push_back(std::make_unique<SimulatedStage>(
          StageDynamics{.travel_max = 100, .max_speed = 100, .max_acceleration = 1000, .homing_speed = 10},
          unit));
      server_->add({"oriental_motor_az", unit, 0.001}, *stages_.back());
    }
    server_->start();
    if (server_->port() != 0) {
      bus_ = make_modbus_bus("127.0.0.1", server_->port());
    } else {
      SerialLine line;
      line.device = server_->device();
      bus_ = make_modbus_bus(line);
    }
    for (int unit = 1; unit <= kUnits; ++unit) {
      ModbusDriveConfig config;
      config.axis = "axis " + std::to_string(unit);
      config.profile = "oriental_motor_az";
      config.unit = unit;
      config.counts_per_axis_unit = 1000;
      drives_.push_back(make_modbus_drive(config, bus_, clock));
      if (const auto connected = drives_.back()->connect(); !connected) throw DeviceError(connected.error());
    }
  }

  Drive& drive(size_t i) { return *drives_[i]; }
  BusStatistics statistics() const { return modbus_bus_statistics(*bus_); }

 private:
  std::vector<std::unique_ptr<SimulatedStage>> stages_;
  std::unique_ptr<ModbusDriveServer> server_;
  std::shared_ptr<ModbusBus> bus_;
  std::vector<std::unique_ptr<Drive>> drives_;
};

/// Status readings (two requests each) by `threads` threads, each on a drive of its own, for so long.
int poll(Rig& rig, int threads, double duration_s) {
  std::vector<std::thread> pool;
  std::vector<int> done(static_cast<size_t>(threads), 0);
  const SteadyClock clock;
  const double end_s = clock.now_s() + duration_s;
  for (size_t i = 0; i < done.size(); ++i)
    pool.emplace_back([&, i] {
      while (clock.now_s() < end_s) done[i] += rig.drive(i).read_status().has_value();
    });
  for (auto& thread : pool) thread.join();
  int sum = 0;
  for (const int n : done) sum += n;
  return sum;
}

}  // namespace

int main(int argc, char** argv) {
  CLI::App app{"Commands per second and round trips of each kind of bus, against the twin on this machine.",
               "gantry-bench-buses"};
  CommonOptions common;
  add_common_options(app, common);
  std::filesystem::path out = "docs/results";
  double duration_s = 10;
  app.add_option("--out", out, "Folder of the page buses.md")->capture_default_str();
  app.add_option("--seconds", duration_s, "For each measurement")
      ->capture_default_str()
      ->check(CLI::PositiveNumber);
  return run_app(app, argc, argv, common, [&] {
    const struct {
      const char* name;
      std::function<std::unique_ptr<ModbusDriveServer>(Clock&)> serve;
    } buses[] = {
        {"TCP, loopback",
         [](Clock& clock) { return std::make_unique<ModbusDriveServer>("127.0.0.1", 0, clock); }},
        {"RTU, pty without wire time",
         [](Clock& clock) {
           return std::make_unique<ModbusDriveServer>(TwinSerialLine{{}, 115200, false}, clock);
         }},
        {"RTU, pty as slow as 115200 baud",
         [](Clock& clock) {
           return std::make_unique<ModbusDriveServer>(TwinSerialLine{{}, 115200, true}, clock);
         }},
    };
    bench::Table table(
        {"bus", "drives polled at once", "requests/s", "status readings/s", "median ms", "p99 ms", "max ms"});
    for (const auto& bus : buses) {
      for (const int threads : {1, kUnits}) {
        SteadyClock clock;
        Rig rig(bus.serve(clock), clock);
        const int64_t before = rig.statistics().requests;
        const bench::Stopwatch watch;
        const int readings = poll(rig, threads, duration_s);
        const double spent_s = watch.spent().wall_s;
        const BusStatistics s = rig.statistics();
        table.add({bus.name, std::to_string(threads),
                   bench::text("%.0f", static_cast<double>(s.requests - before) / spent_s),
                   bench::text("%.0f", readings / spent_s), bench::text("%.3f", s.round_trip_median_us / 1e3),
                   bench::text("%.3f", s.round_trip_p99_us / 1e3),
                   bench::text("%.2f", s.round_trip_max_us / 1e3)});
        std::printf("%s, %d: done\n", bus.name, threads);
      }
    }
    std::ofstream page(out / "buses.md");
    page << "# How fast the buses are\n\n"
            "Made by `scripts/bench buses`: three Oriental Motor AZ drives of the twin on one bus, client "
            "and twin in one "
            "process on this machine. A status reading is two requests of 6 and 4 registers. The round trip "
            "is that of one "
            "request, from its turn on the bus to the last byte of its answer, hence without the wait for "
            "the turn; on a "
            "serial line it includes the 1.75 ms of silence before a request that the specification asks for "
            "above 19200 "
            "baud.\n\n"
         << table.str()
         << "\nThe pty without wire time shows what silence and software cost; with wire time the bytes "
            "themselves are "
            "added (8 bytes out and 17 or 13 back, 11 bits each, and the drive's own 1.75 ms). With three "
            "drives on a line "
            "the queue serves them in turn: the sum is the same.\n";
    if (!page) throw InputError((out / "buses.md").string() + ": cannot be written");
    return ExitCode::kPass;
  });
}
