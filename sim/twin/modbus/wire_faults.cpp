#include "gantry/sim/twin/wire_faults.h"

#include <string>

#include "gantry/foundation/error.h"

namespace gantry {

void WireFaults::reseed(uint64_t seed) {
  std::lock_guard lock(mutex_);
  random_.seed(seed);
}

void WireFaults::set_probability(WireFault fault, double probability) {
  if (!(probability >= 0 && probability <= 1))
    throw InputError("wire fault: probability " + std::to_string(probability) + " is outside 0 to 1");
  std::lock_guard lock(mutex_);
  probability_[static_cast<size_t>(fault)] = probability;
}

void WireFaults::plan(WireFault fault, int unit, int count) {
  std::lock_guard lock(mutex_);
  planned_[unit].insert(planned_[unit].end(), static_cast<size_t>(count), fault);
}

void WireFaults::set_silent(int unit, bool silent) {
  std::lock_guard lock(mutex_);
  if (silent) {
    silent_.insert(unit);
  } else {
    silent_.erase(unit);
  }
}

void WireFaults::set_delay_s(double delay_s) {
  if (!(delay_s >= 0)) throw InputError("wire fault: a delay cannot be negative");
  std::lock_guard lock(mutex_);
  delay_s_ = delay_s;
}

void WireFaults::clear() {
  std::lock_guard lock(mutex_);
  probability_.fill(0);
  planned_.clear();
  silent_.clear();
}

std::optional<WireFault> WireFaults::next(int unit) {
  std::lock_guard lock(mutex_);
  if (silent_.contains(unit)) return WireFault::kLoseRequest;
  if (auto planned = planned_.find(unit); planned != planned_.end() && !planned->second.empty()) {
    const WireFault fault = planned->second.front();
    planned->second.pop_front();
    return fault;
  }
  for (size_t i = 0; i < kWireFaults; ++i)
    if (probability_[i] > 0 && std::generate_canonical<double, 53>(random_) < probability_[i])
      return static_cast<WireFault>(i);
  return std::nullopt;
}

double WireFaults::delay_s() const {
  std::lock_guard lock(mutex_);
  return delay_s_;
}

size_t WireFaults::pick(size_t end) {
  std::lock_guard lock(mutex_);
  return std::uniform_int_distribution<size_t>(0, end - 1)(random_);
}

}  // namespace gantry
