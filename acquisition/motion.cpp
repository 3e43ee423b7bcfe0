#include "gantry/acquisition/motion.h"

#include <algorithm>
#include <cmath>

#include "gantry/acquisition/coordination.h"

namespace gantry {
namespace {

constexpr double kProgressInterval_s = 0.1;
constexpr double kBrakingTime_s = 3.0;  ///< Longer than any stage needs to come to a stop.
constexpr double kReadingWithin_s = 2.0;
constexpr double kSettleMargin_s = 5.0;
/// How far a jog before homing may run on one press: the limits are unknown.
constexpr double kUnhomedJog_s = 30.0;

std::vector<Axis*> pointers(const std::vector<std::unique_ptr<Axis>>& axes) {
  std::vector<Axis*> out;
  for (const auto& axis : axes) out.push_back(axis.get());
  return out;
}

MotionOptions with_buses(MotionOptions options, size_t axes) {
  if (options.bus_of_axis.empty())
    for (size_t i = 0; i < axes; ++i) options.bus_of_axis.push_back(i);
  if (options.bus_of_axis.size() != axes)
    throw InputError("motion: one bus is needed for each axis, or none at all");
  return options;
}

bool in_motion(const AxisFigures& axis) {
  return axis.state == AxisState::kHoming || axis.state == AxisState::kDiscreteMotion ||
         axis.state == AxisState::kStopping || axis.pending;
}

}  // namespace

Motion::Motion(std::vector<std::unique_ptr<Axis>> axes, std::vector<AxisSettings> settings,
               MotionOptions options, Clock& clock, MotionPermit* permit)
    : axes_(std::move(axes)),
      settings_(std::move(settings)),
      options_(with_buses(std::move(options), axes_.size())),
      clock_(clock),
      permit_(permit),
      supervisor_(pointers(axes_), options_.supervisor, permit) {}

Motion::~Motion() {
  stop_all("the program ended");
  threads_.reset();
  // A drive that would miss us must not take our leaving for a fault.
  if (connected_ && options_.drive_timeout_s > 0)
    for (auto& axis : axes_) (void)axis->channel().drive().set_communication_timeout(0);
}

std::string Motion::stop_reason() const {
  std::lock_guard lock(reason_mutex_);
  return stop_reason_;
}

AxisSet Motion::all() const {
  return axis_bit(axes_.size()) - 1;
}

std::optional<size_t> Motion::axis_named(const std::string& name) const {
  for (size_t i = 0; i < axes_.size(); ++i)
    if (axes_[i]->name() == name) return i;
  return std::nullopt;
}

// ---- Time and status --------------------------------------------------------------------------

void Motion::turn() {
  if (!threads_) {
    for (const IoService& other : options_.services) other.service();
    for (auto& axis : axes_) axis->channel().service();
    supervisor_.tick(clock_.now_s());
  }
  clock_.sleep_s(options_.supervisor.period_s);
}

std::vector<AxisStatus> Motion::statuses() const {
  const SupervisorStatus figures = supervisor_.status();
  std::vector<AxisStatus> out;
  for (size_t i = 0; i < axes_.size(); ++i) {
    const AxisFigures& axis = figures.axes[i];
    AxisStatus status{axis.state, axis.drive.status, axis.target, {}};
    if (axis.error.reason == AxisReason::kOtherAxis)
      status.error = "stopped because of " + axes_[static_cast<size_t>(axis.error.code)]->info().text();
    else if (axis.error.reason == AxisReason::kOperator)
      status.error = stop_reason();
    else if (axis.error.reason != AxisReason::kNone)
      status.error = axes_[i]->fault_of(axis.error).message;
    out.push_back(std::move(status));
  }
  return out;
}

// What stopped the cell: not what was stopped because of it.
std::optional<Fault> Motion::fault_of(const SupervisorStatus& status) const {
  std::optional<size_t> failed;
  for (size_t i = 0; i < axes_.size(); ++i) {
    if (status.axes[i].state != AxisState::kErrorStop) continue;
    const bool first = !failed || status.axes[*failed].error.reason == AxisReason::kOtherAxis;
    if (first || i == status.first_failed) failed = i;
  }
  if (!failed) return std::nullopt;
  const AxisError& error = status.axes[*failed].error;
  if (error.reason == AxisReason::kSafety && permit_)
    return Fault{FaultKind::kRefused, "safety chain", permit_->why()};
  if (error.reason == AxisReason::kOperator) return Fault{FaultKind::kRefused, "cell", stop_reason()};
  return axes_[*failed]->fault_of(error);
}

Fault Motion::refused(const SupervisorStatus& status, const MotionRequest& request) const {
  const size_t i = status.refused_axis;
  if (status.refusal == AxisRefusal::kSafety && permit_)
    return {FaultKind::kRefused, "safety chain", permit_->why()};
  return axes_[i]->refusal(status.refusal, request.command, request.moves[i].target, status.axes[i].state,
                           status.axes[i].error);
}

bool Motion::homed() const {
  const SupervisorStatus status = supervisor_.status();
  return std::all_of(status.axes.begin(), status.axes.begin() + static_cast<long>(axes_.size()),
                     [](const AxisFigures& axis) { return axis.drive.status.homed; });
}

std::vector<double> Motion::positions() const {
  const SupervisorStatus status = supervisor_.status();
  std::vector<double> q;
  for (size_t i = 0; i < axes_.size(); ++i) q.push_back(status.axes[i].drive.status.position);
  return q;
}

std::optional<LoopStatistics> Motion::loop_statistics() const {
  if (!threads_) return std::nullopt;
  return threads_->statistics();
}

std::optional<RealTimeGrant> Motion::real_time_grant() const {
  if (!threads_) return std::nullopt;
  return threads_->grant();
}

// ---- Waiting ----------------------------------------------------------------------------------

// One look at everything that can end a wait.
Result<void> Motion::watch() {
  if (cancelled_ && cancelled_()) {
    stop_all("cancelled by the operator; all axes were stopped");
    return fault(FaultKind::kRefused, "cell", "cancelled by the operator; all axes were stopped");
  }
  if (const auto failure = fault_of(supervisor_.status())) {
    stop_all("stopped because of " + failure->device);
    return tl::make_unexpected(*failure);
  }
  if (progress_ && clock_.now_s() - last_progress_s_ >= kProgressInterval_s) {
    last_progress_s_ = clock_.now_s();
    progress_(statuses());
  }
  return {};
}

Result<void> Motion::watch_for(double duration_s) {
  const double end_s = clock_.now_s() + duration_s;
  do {
    turn();
    if (auto fine = watch(); !fine) return fine;
  } while (clock_.now_s() < end_s);
  return {};
}

void Motion::wait_for(double duration_s) {
  const double end_s = clock_.now_s() + duration_s;
  do turn();
  while (clock_.now_s() < end_s);
}

Result<void> Motion::send(const MotionRequest& request) {
  uint64_t number = 0;
  while ((number = supervisor_.request(request)) == 0) turn();
  for (;;) {
    turn();
    const SupervisorStatus status = supervisor_.status();
    if (status.answered < number) continue;
    if (status.refusal == AxisRefusal::kNone) return {};
    return tl::make_unexpected(refused(status, request));
  }
}

Result<void> Motion::wait_until_still(AxisSet axes) {
  for (;;) {
    if (auto fine = watch(); !fine) return fine;
    const SupervisorStatus status = supervisor_.status();
    bool still = true;
    for (size_t i = 0; i < axes_.size(); ++i)
      if (axes & axis_bit(i)) still = still && status.axes[i].state == AxisState::kStandstill;
    if (still) return {};
    turn();
  }
}

void Motion::stop_all(const std::string& reason) {
  const auto anything = [this](auto condition) {
    const SupervisorStatus status = supervisor_.status();
    return std::any_of(status.axes.begin(), status.axes.begin() + static_cast<long>(axes_.size()), condition);
  };
  const bool stopped = anything(in_motion);
  if (stopped) {
    {
      std::lock_guard lock(reason_mutex_);
      stop_reason_ = reason;
    }
    supervisor_.stop(true);
    turn();
    turn();
  }
  // The program may end after this: it ends when the stages stand, unless a drive cannot tell.
  const double deadline_s = clock_.now_s() + kBrakingTime_s;
  const auto may_move = [this](const AxisFigures& axis) {
    return in_motion(axis) || (axis.state == AxisState::kErrorStop && axis.drive.status.moving &&
                               axis.drive.age_s(clock_.now_s()) < 0.5);
  };
  while (clock_.now_s() < deadline_s && anything(may_move)) turn();
  if (stopped && !threads_)
    for (auto& axis : axes_) axis->channel().service();  // What the last cycle commanded.
}

// ---- Commands ---------------------------------------------------------------------------------

Result<void> Motion::connect() {
  if (!connected_) {
    for (auto& axis : axes_) {
      const auto opened = axis->channel().connect();
      if (!opened || options_.drive_timeout_s <= 0) continue;
      if (auto set = axis->channel().drive().set_communication_timeout(options_.drive_timeout_s); !set)
        remarks_.push_back(axis->name() + ": " + set.error().message);
    }
    if (options_.threads)
      threads_ =
          std::make_unique<MotionThreads>(supervisor_, options_.bus_of_axis, options_.services, clock_);
    connected_ = true;
  }
  turn();
  turn();
  if (const auto failure = fault_of(supervisor_.status())) return tl::make_unexpected(*failure);
  return {};
}

Result<void> Motion::enable() {
  const SupervisorStatus before = supervisor_.status();
  MotionRequest request;
  request.command = AxisTrigger::kEnable;
  for (size_t i = 0; i < axes_.size(); ++i)
    if (!is_powered(before.axes[i].state)) request.axes |= axis_bit(i);
  if (auto taken = send(request); !taken) return taken;
  return wait_until_still(request.axes);
}

Result<void> Motion::disable() {
  const SupervisorStatus before = supervisor_.status();
  MotionRequest request;
  request.command = AxisTrigger::kDisable;
  for (size_t i = 0; i < axes_.size(); ++i)
    if (is_powered(before.axes[i].state)) request.axes |= axis_bit(i);
  if (auto taken = send(request); !taken) return taken;
  turn();
  turn();
  return {};
}

Result<void> Motion::home(const HomingOrder& order) {
  for (const auto& group : order) {
    MotionRequest request;
    request.command = AxisTrigger::kHome;
    for (const std::string& name : group) {
      const auto axis = axis_named(name);
      if (!axis) return fault(FaultKind::kRefused, "cell", "there is no axis '" + name + "'");
      request.axes |= axis_bit(*axis);
    }
    if (auto taken = send(request); !taken) return taken;
    if (auto done = wait_until_still(request.axes); !done) return done;
  }
  return {};
}

Result<void> Motion::check_targets(std::span<const double> q) const {
  if (q.size() != axes_.size())
    return fault(FaultKind::kRefused, "cell", "move refused: one target is needed for each axis");
  const SupervisorStatus status = supervisor_.status();
  for (size_t i = 0; i < axes_.size(); ++i) {
    const AxisLimits& limits = axes_[i]->limits();
    AxisRefusal refusal = AxisRefusal::kNone;
    if (!status.axes[i].drive.status.homed) refusal = AxisRefusal::kNotHomed;
    if (!(q[i] >= limits.lower && q[i] <= limits.upper)) refusal = AxisRefusal::kSoftLimit;
    if (refusal != AxisRefusal::kNone)
      return tl::make_unexpected(
          axes_[i]->refusal(refusal, AxisTrigger::kMove, q[i], status.axes[i].state, status.axes[i].error));
  }
  return {};
}

Result<void> Motion::move_line(std::span<const double> from, std::span<const double> to) {
  std::vector<AxisLimits> limits;
  for (const auto& axis : axes_) limits.push_back(axis->limits());
  const CoordinatedMove move = coordinate(from, to, limits);
  MotionRequest request;
  request.command = AxisTrigger::kMove;
  request.axes = all();
  std::copy(move.axes.begin(), move.axes.end(), request.moves.begin());
  if (auto taken = send(request); !taken) return taken;
  return wait_until_still(all());
}

Result<Standstill> Motion::move_to(std::span<const double> q) {
  // Everything is checked before the first axis starts.
  const auto checked = [&](std::span<const double> from, std::span<const double> to) -> Result<void> {
    if (auto fine = check_targets(to); !fine) return fine;
    return path_check_ ? path_check_(from, to) : Result<void>{};
  };
  if (auto fine = check_targets(q); !fine) return tl::make_unexpected(fine.error());
  const std::vector<double> here = positions();
  // Where the last way would come from the wrong side, or be too short, go past the target first.
  std::vector<double> via(q.begin(), q.end());
  for (size_t i = 0; i < q.size(); ++i) {
    const AxisSettings& axis = settings_[i];
    const double side = axis.approach == Approach::kAny ? 0 : axis.approach == Approach::kFromBelow ? 1 : -1;
    if (side * (q[i] - here[i]) < axis.approach_distance) via[i] = q[i] - side * axis.approach_distance;
  }
  const bool detour = !std::equal(via.begin(), via.end(), q.begin());
  if (auto fine = checked(here, via); !fine) return tl::make_unexpected(fine.error());
  if (detour) {
    if (auto fine = checked(via, q); !fine) return tl::make_unexpected(fine.error());
    if (auto moved = move_line(here, via); !moved) return tl::make_unexpected(moved.error());
  }
  if (auto moved = move_line(positions(), q); !moved) return tl::make_unexpected(moved.error());
  return prove_standstill(q);
}

Result<Standstill> Motion::prove_standstill(std::span<const double> q) {
  double settle_s = 0;
  for (const AxisSettings& s : settings_) settle_s = std::max(settle_s, s.settle_s);
  const double give_up_s = clock_.now_s() + settle_s + kSettleMargin_s;
  const size_t n = axes_.size();
  for (;;) {
    Standstill still;
    std::vector<double> low(n, 1e300), high(n, -1e300), sum(n, 0), sampled_s(n, clock_.now_s());
    const double begin_s = clock_.now_s();
    bool inside = true;
    size_t culprit = 0;
    do {
      turn();
      if (auto fine = watch(); !fine) return tl::make_unexpected(fine.error());
      const SupervisorStatus status = supervisor_.status();
      bool news = true;
      for (size_t i = 0; i < n; ++i) news = news && status.axes[i].drive.status.sampled_at_s >= sampled_s[i];
      if (!news) continue;
      for (size_t i = 0; i < n; ++i) {
        const DriveStatus& drive = status.axes[i].drive.status;
        sampled_s[i] = std::nextafter(drive.sampled_at_s, 1e300);
        if (std::abs(drive.position - q[i]) > axes_[i]->limits().in_position) {
          inside = false;
          culprit = i;
        }
        low[i] = std::min(low[i], drive.position);
        high[i] = std::max(high[i], drive.position);
        sum[i] += drive.position;
      }
      ++still.samples;
      still.duration_s = clock_.now_s() - begin_s;
    } while (inside && (still.samples == 0 || still.duration_s < settle_s));
    if (inside) {
      for (size_t i = 0; i < n; ++i) {
        still.q.push_back(sum[i] / still.samples);
        still.spread = std::max(still.spread, (high[i] - low[i]) / axes_[i]->limits().in_position);
      }
      return still;
    }
    if (clock_.now_s() > give_up_s) {
      const Fault unsettled{FaultKind::kNotSettled, axes_[culprit]->info().text(),
                            "does not settle at " + axes_[culprit]->format(q[culprit]) + "; it reads " +
                                axes_[culprit]->format(positions()[culprit])};
      stop_all("stopped because of " + unsettled.device);
      return tl::make_unexpected(unsettled);
    }
  }
}

Result<void> Motion::jog_by(size_t axis, double distance) {
  const AxisLimits& limits = axes_[axis]->limits();
  const std::vector<double> here = positions();
  std::vector<double> there = here;
  there[axis] += distance;
  if (homed() && path_check_)
    if (auto fine = path_check_(here, there); !fine) return fine;
  MotionRequest request;
  request.command = AxisTrigger::kJog;
  request.axes = axis_bit(axis);
  request.moves[axis] = {there[axis], limits.jogging_speed(), limits.acceleration};
  if (auto taken = send(request); !taken) return taken;
  return wait_until_still(request.axes);
}

Result<void> Motion::start_jog(size_t axis, int direction) {
  const AxisLimits& limits = axes_[axis]->limits();
  const DriveStatus drive = supervisor_.status().axes[axis].drive.status;
  MotionRequest request;
  request.command = AxisTrigger::kJog;
  request.axes = axis_bit(axis);
  request.hold_to_run = true;
  const double end = drive.homed
                         ? (direction < 0 ? limits.lower : limits.upper)
                         : drive.position + direction * kUnhomedJog_s * limits.unhomed_jogging_speed();
  request.moves[axis] = {end, limits.jogging_speed(), limits.acceleration};
  return send(request);
}

Result<std::vector<double>> Motion::read_positions() {
  const double begin_s = clock_.now_s();
  for (;;) {
    turn();
    if (auto fine = watch(); !fine) return tl::make_unexpected(fine.error());
    const SupervisorStatus status = supervisor_.status();
    const auto late =
        std::find_if(status.axes.begin(), status.axes.begin() + static_cast<long>(axes_.size()),
                     [&](const AxisFigures& a) { return a.drive.status.sampled_at_s < begin_s; });
    const auto axis = static_cast<size_t>(late - status.axes.begin());
    if (axis == axes_.size()) return positions();
    if (clock_.now_s() > begin_s + kReadingWithin_s)
      return fault(FaultKind::kTimeout, axes_[axis]->info().text(), "no new reading within 2 s");
  }
}

Result<void> Motion::reset() {
  MotionRequest request;
  request.command = AxisTrigger::kReset;
  if (auto taken = send(request); !taken) return taken;
  for (;;) {
    const SupervisorStatus status = supervisor_.status();
    const bool pending =
        std::any_of(status.axes.begin(), status.axes.begin() + static_cast<long>(axes_.size()),
                    [](const AxisFigures& axis) { return axis.pending; });
    if (!pending) break;
    turn();
  }
  if (const auto failure = fault_of(supervisor_.status())) return tl::make_unexpected(*failure);
  return {};
}

}  // namespace gantry
