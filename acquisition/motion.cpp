#include "gantry/acquisition/motion.h"

#include <algorithm>
#include <cmath>

namespace gantry {
namespace {

constexpr double kPollInterval_s = 0.02;
constexpr double kProgressInterval_s = 0.1;
constexpr double kBrakingTime_s = 3.0;  ///< Longer than any stage needs to come to a stop.

}  // namespace

Motion::Motion(std::vector<std::unique_ptr<Axis>> axes, std::vector<AxisSettings> settings, Clock& clock)
    : axes_(std::move(axes)), settings_(std::move(settings)), clock_(clock) {}

Motion::~Motion() {
  stop_all("the program ended");
}

void Motion::stop_all(const std::string& reason) {
  std::vector<Axis*> stopping;
  for (auto& axis : axes_) {
    const AxisState state = axis->status().state;
    if (state != AxisState::kHoming && state != AxisState::kDiscreteMotion) continue;
    axis->abort(reason);
    stopping.push_back(axis.get());
  }
  // The program may end after this: it ends when the stages stand, unless a drive cannot tell.
  const double deadline_s = clock_.now_s() + kBrakingTime_s;
  while (!stopping.empty() && clock_.now_s() < deadline_s) {
    std::erase_if(stopping, [](Axis* axis) {
      const auto status = axis->update();
      return !status || !status->drive.moving;
    });
    if (!stopping.empty()) clock_.sleep_s(kPollInterval_s);
  }
}

tl::unexpected<Fault> Motion::stopped_by(Fault fault) {
  stop_all("stopped because of " + fault.device);
  return tl::make_unexpected(std::move(fault));
}

Result<void> Motion::connect() {
  for (auto& axis : axes_)
    if (auto done = axis->connect(); !done) return done;
  return {};
}

Result<void> Motion::enable() {
  for (auto& axis : axes_) {
    if (axis->status().state != AxisState::kDisabled) continue;
    if (auto done = axis->enable(); !done) return stopped_by(done.error());
  }
  return {};
}

Result<void> Motion::update_all() {
  if (cancelled_ && cancelled_()) {
    stop_all("cancelled by the operator");
    return fault(FaultKind::kRefused, "cell", "cancelled by the operator; all axes were stopped");
  }
  for (auto& axis : axes_)
    if (auto status = axis->update(); !status) return stopped_by(status.error());
  if (progress_ && clock_.now_s() - last_progress_s_ >= kProgressInterval_s) {
    last_progress_s_ = clock_.now_s();
    std::vector<AxisStatus> statuses;
    for (auto& axis : axes_) statuses.push_back(axis->status());
    progress_(statuses);
  }
  return {};
}

Result<void> Motion::wait_for_standstill() {
  for (;;) {
    if (auto done = update_all(); !done) return done;
    if (std::all_of(axes_.begin(), axes_.end(),
                    [](const auto& axis) { return axis->status().state == AxisState::kStandstill; }))
      return {};
    clock_.sleep_s(kPollInterval_s);
  }
}

Result<void> Motion::home(const std::vector<std::string>& order) {
  for (const std::string& name : order) {
    for (auto& axis : axes_) {
      if (axis->name() != name) continue;
      if (auto done = axis->home(); !done) return stopped_by(done.error());
      if (auto done = wait_for_standstill(); !done) return done;
    }
  }
  return {};
}

bool Motion::homed() const {
  return std::all_of(axes_.begin(), axes_.end(), [](const auto& axis) { return axis->status().drive.homed; });
}

Result<Standstill> Motion::move_to(std::span<const double> q) {
  // All targets are checked before the first axis starts.
  for (size_t i = 0; i < axes_.size(); ++i) {
    const AxisLimits& limits = axes_[i]->limits();
    if (!(q[i] >= limits.lower && q[i] <= limits.upper))
      return fault(FaultKind::kLimit, axes_[i]->info().text(),
                   "move to " + axes_[i]->format(q[i]) + " refused: outside the soft limits " +
                       axes_[i]->format(limits.lower) + " to " + axes_[i]->format(limits.upper));
  }
  for (size_t i = 0; i < axes_.size(); ++i)
    if (auto done = axes_[i]->move_to(q[i]); !done) return stopped_by(done.error());
  if (auto done = wait_for_standstill(); !done) return tl::make_unexpected(done.error());

  double settle_s = 0;
  for (const AxisSettings& s : settings_) settle_s = std::max(settle_s, s.settle_s);
  const double give_up_s = clock_.now_s() + settle_s + 5.0;
  for (;;) {
    Standstill still;
    std::vector<double> low(axes_.size(), 1e300), high(axes_.size(), -1e300), sum(axes_.size(), 0);
    const double begin_s = clock_.now_s();
    bool inside = true;
    size_t culprit = 0;
    do {
      if (auto done = update_all(); !done) return tl::make_unexpected(done.error());
      for (size_t i = 0; i < axes_.size(); ++i) {
        const double position = axes_[i]->status().drive.position;
        if (std::abs(position - q[i]) > axes_[i]->limits().in_position) {
          inside = false;
          culprit = i;
        }
        low[i] = std::min(low[i], position);
        high[i] = std::max(high[i], position);
        sum[i] += position;
      }
      ++still.samples;
      still.duration_s = clock_.now_s() - begin_s;
      if (!inside || still.duration_s < settle_s) clock_.sleep_s(kPollInterval_s);
    } while (inside && still.duration_s < settle_s);
    if (inside) {
      for (size_t i = 0; i < axes_.size(); ++i) {
        still.q.push_back(sum[i] / still.samples);
        still.spread = std::max(still.spread, (high[i] - low[i]) / axes_[i]->limits().in_position);
      }
      return still;
    }
    if (clock_.now_s() > give_up_s)
      return stopped_by({FaultKind::kNotSettled, axes_[culprit]->info().text(),
                         "does not settle at " + axes_[culprit]->format(q[culprit]) + "; it reads " +
                             axes_[culprit]->format(axes_[culprit]->status().drive.position)});
  }
}

Result<std::vector<double>> Motion::read_positions() {
  if (auto done = update_all(); !done) return tl::make_unexpected(done.error());
  std::vector<double> q;
  for (auto& axis : axes_) q.push_back(axis->status().drive.position);
  return q;
}

Result<void> Motion::reset() {
  for (auto& axis : axes_) {
    if (axis->status().state != AxisState::kErrorStop) continue;
    if (auto done = axis->reset(); !done) return done;
  }
  return {};
}

}  // namespace gantry
