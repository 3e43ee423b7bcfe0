#pragma once

#include <array>
#include <cstdint>
#include <deque>
#include <map>
#include <mutex>
#include <optional>
#include <random>
#include <set>

namespace gantry {

/// What can happen to one exchange on the wire.
enum class WireFault {
  kLoseRequest,     ///< The drive never hears it.
  kDropReply,       ///< The drive acts, its reply is lost.
  kDelayReply,      ///< The reply comes late; what the drive is asked meanwhile it answers after that.
  kTruncateReply,   ///< Only the beginning of the reply comes.
  kCorruptReply,    ///< A bit is wrong. On TCP one of the header: its own checksum protects the rest.
  kDuplicateReply,  ///< The reply comes twice.
  kException        ///< The drive does nothing and answers exception 06, device busy.
};
inline constexpr size_t kWireFaults = 7;

/// The faults of one bus of the twin: by chance or for the next requests, on all units or on one. Seeded, so
/// that the same requests meet the same faults again; everything can be taken back. Thread-safe.
class WireFaults {
 public:
  explicit WireFaults(uint64_t seed = 1) : random_(seed) {}

  /// Starts the random numbers anew; what was set stays.
  void reseed(uint64_t seed);
  /// Every request meets this fault with this probability from now on; 0 ends it.
  void set_probability(WireFault fault, double probability);
  /// The next `count` requests to `unit` meet this fault for certain, after those that were planned before.
  void plan(WireFault fault, int unit, int count = 1);
  /// A silent slave hears nothing and says nothing.
  void set_silent(int unit, bool silent);
  /// How late a late reply is.
  void set_delay_s(double delay_s);
  /// Ends everything that was set, planned or silenced.
  void clear();

  /// What becomes of a request to `unit` that has just come.
  std::optional<WireFault> next(int unit);
  double delay_s() const;
  /// A number from 0 to `end` - 1, for where to cut and which bit to turn.
  size_t pick(size_t end);

 private:
  mutable std::mutex mutex_;
  std::mt19937_64 random_;
  std::array<double, kWireFaults> probability_{};
  std::map<int, std::deque<WireFault>> planned_;
  std::set<int> silent_;
  double delay_s_ = 0.5;
};

}  // namespace gantry
