#pragma once

#include <array>
#include <cstddef>
#include <cstdint>
#include <memory>
#include <mutex>
#include <string>
#include <vector>

#include "gantry/foundation/clock.h"
#include "gantry/foundation/error.h"

namespace gantry {

/// The contacts of emergency stops, doors and light curtains as an I/O module reads them: one level per
/// channel, true while current flows (closed, healthy). The inputs are active-low: pressed, open, a broken
/// wire and a module without supply all read false.
class SafetyInputs {
 public:
  virtual ~SafetyInputs() = default;
  /// Who answers, for messages: "safety inputs (Modbus at 127.0.0.1:15023 unit 10)".
  virtual const std::string& device() const = 0;
  /// One level for each channel, in the order in which the channels were asked for. Blocks for the exchange.
  virtual Result<std::vector<bool>> read() = 0;
};

/// The last reading, as a plain struct that is copied without allocating.
struct SafetyInputsSnapshot {
  static constexpr size_t kMaxChannels = 32;

  bool valid = false;  ///< There has been a reading at all.
  double sampled_at_s =
      0;             ///< When it was asked for: the levels are at least as fresh. By the injected clock.
  size_t count = 0;  ///< Channels read.
  std::array<bool, kMaxChannels> closed{};
};

/// How the readings went so far.
struct SafetyInputsHealth {
  uint64_t readings = 0;
  uint64_t faults = 0;
  std::string last_fault;  ///< Empty when there was none.
};

/// Stands between the thread that talks to the I/O module and the loop that must not wait: service() does
/// the blocking exchange and publishes what it read; latest() copies the last good reading and never waits
/// for I/O. A failed exchange publishes nothing: the reading grows old, and whoever uses it judges its age.
/// Thread-safe.
class SafetyInputsChannel {
 public:
  SafetyInputsChannel(std::unique_ptr<SafetyInputs> inputs, Clock& clock);

  void service();
  SafetyInputsSnapshot latest() const;
  SafetyInputsHealth health() const;
  const std::string& device() const { return inputs_->device(); }

 private:
  std::unique_ptr<SafetyInputs> inputs_;
  Clock& clock_;
  mutable std::mutex mutex_;  ///< Held for copies only.
  SafetyInputsSnapshot latest_;
  SafetyInputsHealth health_;
};

}  // namespace gantry
