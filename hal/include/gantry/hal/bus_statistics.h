#pragma once

#include <array>
#include <cstdint>
#include <string>

namespace gantry {

/// How the exchanges of a bus have gone since it was made.
struct BusStatistics {
  int64_t requests = 0;       ///< Sent, repetitions included.
  int64_t retries = 0;        ///< Of these, repetitions of a read or of a write that may be repeated.
  int64_t timeouts = 0;       ///< No complete answer in time.
  int64_t wrong_answers = 0;  ///< Damaged, or not what was asked for.
  int64_t exceptions = 0;     ///< Proper answers that say no.
  int64_t unreachable = 0;    ///< No connection, or no serial device.
  int64_t reconnects = 0;     ///< Opened again after it was open before.
  int64_t strays = 0;         ///< Late or repeated answers that were told and thrown away.
  std::string last_error;     ///< Of the last exchange that failed.

  int64_t round_trips = 0;  ///< Answered requests; their times follow, 0 while there are none.
  double round_trip_min_us = 0;
  double round_trip_median_us = 0;
  double round_trip_p99_us = 0;
  double round_trip_max_us = 0;
};

/// Times in bins whose widths grow with them: memory that never grows, quantiles within 3 percent from 16
/// microseconds on (and within one below), up to 67 s.
class RoundTripHistogram {
 public:
  void add(double duration_us);
  int64_t count() const { return count_; }
  double min_us() const { return min_us_; }
  double max_us() const { return max_us_; }
  /// The duration that a share `fraction` of all did not exceed.
  double quantile_us(double fraction) const;

 private:
  static constexpr int kBinsPerOctave = 16, kOctaves = 22;
  std::array<int64_t, kBinsPerOctave*(kOctaves + 1)> bins_{};
  int64_t count_ = 0;
  double min_us_ = 0, max_us_ = 0;
};

}  // namespace gantry
