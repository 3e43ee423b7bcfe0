#include "shrink.h"

#include <algorithm>
#include <cmath>

namespace gantry {
namespace {

class Shrinker {
 public:
  Shrinker(FaultSchedule schedule, const StillFails& still_fails, int budget)
      : best_(std::move(schedule)), still_fails_(still_fails), budget_(budget) {}

  FaultSchedule run() {
    drop_entries();
    for (size_t k = 0; k < best_.entries.size(); ++k) simplify(k);
    drop_entries();
    return best_;
  }

 private:
  bool take(FaultSchedule candidate) {
    if (budget_ <= 0 || candidate == best_) return false;
    --budget_;
    if (!still_fails_(candidate)) return false;
    best_ = std::move(candidate);
    return true;
  }

  // Ever smaller chunks; back to large ones is not needed for so few entries.
  void drop_entries() {
    for (size_t chunk = std::max<size_t>(1, best_.entries.size() / 2);; chunk /= 2) {
      for (size_t begin = 0; begin < best_.entries.size();) {
        FaultSchedule candidate = best_;
        const auto from = candidate.entries.begin() + static_cast<long>(begin);
        const size_t count = std::min(chunk, candidate.entries.size() - begin);
        candidate.entries.erase(from, from + static_cast<long>(count));
        if (!take(std::move(candidate))) begin += count;
      }
      if (chunk <= 1) return;
    }
  }

  bool change(size_t k, const std::function<void(FaultEntry&)>& edit) {
    FaultSchedule candidate = best_;
    edit(candidate.entries[k]);
    return take(std::move(candidate));
  }

  void simplify(size_t k) {
    for (int i = 0; i < 10 && best_.entries[k].for_s > 0.02; ++i)
      if (!change(k, [](FaultEntry& e) { e.for_s /= 2; })) break;
    for (const double step : {1.0, 0.1, 0.01}) {
      const auto rounded = [step](double value) { return std::round(value / step) * step; };
      if (change(k, [&](FaultEntry& e) { e.at_s = rounded(e.at_s); })) break;
    }
    for (const double step : {1.0, 0.1, 0.01}) {
      if (best_.entries[k].for_s < step) continue;
      if (change(k, [&](FaultEntry& e) { e.for_s = std::round(e.for_s / step) * step; })) break;
    }
    change(k, [](FaultEntry& e) { e.probability = 1; });
    change(k, [](FaultEntry& e) { e.lag_s = 0; });
  }

  FaultSchedule best_;
  const StillFails& still_fails_;
  int budget_;
};

}  // namespace

FaultSchedule shrink(const FaultSchedule& schedule, const StillFails& still_fails, int budget) {
  return Shrinker(schedule, still_fails, budget).run();
}

}  // namespace gantry
