#include "gantry/hal/bus_statistics.h"

#include <algorithm>
#include <bit>
#include <cmath>

namespace gantry {

// Bin i below 16 holds i us; above, each octave [2^k, 2^(k+1)) is cut into 16.
void RoundTripHistogram::add(double duration_us) {
  min_us_ = count_ == 0 ? duration_us : std::min(min_us_, duration_us);
  max_us_ = count_ == 0 ? duration_us : std::max(max_us_, duration_us);
  ++count_;
  const auto us = static_cast<uint64_t>(std::clamp(duration_us, 0.0, 1e12));
  size_t bin = us;
  if (us >= kBinsPerOctave) {
    const int octave = std::bit_width(us) - std::bit_width(static_cast<uint64_t>(kBinsPerOctave)) + 1;
    bin = static_cast<size_t>(octave) * kBinsPerOctave + ((us >> (octave - 1)) - kBinsPerOctave);
  }
  ++bins_[std::min(bin, bins_.size() - 1)];
}

double RoundTripHistogram::quantile_us(double fraction) const {
  if (count_ == 0) return 0;
  const auto wanted = static_cast<int64_t>(std::ceil(fraction * static_cast<double>(count_)));
  int64_t seen = 0;
  for (size_t bin = 0; bin < bins_.size(); ++bin) {
    seen += bins_[bin];
    if (seen < wanted) continue;
    const size_t octave = bin / kBinsPerOctave, step = bin % kBinsPerOctave;
    const double width = octave == 0 ? 1 : std::ldexp(1.0, static_cast<int>(octave) - 1);
    const double begin =
        octave == 0 ? static_cast<double>(step) : static_cast<double>(kBinsPerOctave + step) * width;
    return std::clamp(begin + width / 2, min_us_, max_us_);
  }
  return max_us_;
}

}  // namespace gantry
