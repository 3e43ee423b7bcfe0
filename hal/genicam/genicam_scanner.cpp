#include "gantry/hal/genicam_scanner.h"

#include <algorithm>
#include <cmath>
#include <cstdio>
#include <string>

#include "camera_session.h"
#include "control_thread.h"
#include "frame_order.h"
#include "gantry/foundation/error.h"

namespace gantry {

namespace {

constexpr double kLostPollS = 0.05;  ///< How often a waiting capture looks whether control was lost.

/// Runs `work` and turns what it throws into a value.
template <typename T>
Result<T> caught(const std::function<T()>& work) {
  try {
    return work();
  } catch (const FaultException& exception) {
    return tl::make_unexpected(exception.fault);
  }
}

const char* text_of(ArvBufferStatus status) {
  switch (status) {
    case ARV_BUFFER_STATUS_TIMEOUT:
    case ARV_BUFFER_STATUS_MISSING_PACKETS:
      return "packets are missing";
    case ARV_BUFFER_STATUS_WRONG_PACKET_ID:
      return "a packet had a wrong number";
    case ARV_BUFFER_STATUS_SIZE_MISMATCH:
      return "it is larger than announced";
    case ARV_BUFFER_STATUS_ABORTED:
      return "reception was aborted";
    default:
      return "it was not completed";
  }
}

std::string seconds(double value) {
  char out[32];
  std::snprintf(out, sizeof(out), "%g s", value);
  return out;
}

class GenicamScanner final : public Scanner {
 public:
  GenicamScanner(const GenicamScannerConfig& config, Clock& clock) : config_(config), clock_(clock) {
    info_.address = config.address;
  }
  ~GenicamScanner() override { disconnect(); }

  const ScannerInfo& info() const override { return info_; }

  Result<void> connect() override {
    disconnect();
    const double deadline_s = clock_.now_s() + config_.connect_timeout_s;
    // The session may still be opening when this scanner is gone; the clock belongs to somebody who
    // outlives the scanner but not that. So the control thread measures for itself.
    const auto opened = [config = config_]() -> Result<std::shared_ptr<CameraSession>> {
      const SteadyClock steady;
      const double end_s = steady.now_s() + config.connect_timeout_s;
      return caught<std::shared_ptr<CameraSession>>(
          [&] { return std::make_shared<CameraSession>(config, [&] { return end_s - steady.now_s(); }); });
    };
    auto result = control_.run<Result<std::shared_ptr<CameraSession>>>(opened, deadline_s - clock_.now_s());
    if (!result) {
      control_.renew();
      return fail(FaultKind::kTimeout, "not connected within " + seconds(config_.connect_timeout_s));
    }
    if (!*result) {
      last_loss_ = result->error().message;
      return tl::make_unexpected(result->error());
    }
    session_ = std::move(**result);
    const std::string address = info_.address;
    info_ = session_->info();
    info_.address = address;
    order_ = {};
    last_loss_.clear();
    return {};
  }

  Result<Capture> capture(const CaptureSettings& settings) override {
    if (auto refused = check(settings); !refused) return tl::make_unexpected(refused.error());
    const double deadline_s = clock_.now_s() + settings.timeout_s;
    session_->stream().discard_received();
    const FrameStream::PacketCounts before = session_->stream().packets();

    const auto triggered = trigger(settings);
    if (!triggered) return tl::make_unexpected(triggered.error());
    auto frame = wait_for_frame(deadline_s, settings.timeout_s);
    if (!frame) return tl::make_unexpected(frame.error());

    auto capture = read(frame->get(), before);
    if (capture && capture->exposure_s == 0) capture->exposure_s = *triggered;
    frame->reset();
    if (!capture && capture.error().kind == FaultKind::kProtocol) give_up(capture.error().message);
    return capture;
  }

 private:
  Result<void> check(const CaptureSettings& settings) const {
    if (!session_) {
      if (last_loss_.empty()) return fail(FaultKind::kRefused, "not connected: connect first");
      return fail(FaultKind::kUnreachable, "the connection was given up (" + last_loss_ + "): connect again");
    }
    const auto [min_s, max_s] = session_->exposure_range();
    // One part in a million forgives the way from seconds to microseconds.
    if (!(settings.exposure_s >= min_s * (1 - 1e-6) && settings.exposure_s <= max_s * (1 + 1e-6))) {
      return fail(FaultKind::kRefused, "an exposure of " + seconds(settings.exposure_s) +
                                           " was asked for; the camera allows " + seconds(min_s) + " to " +
                                           seconds(max_s));
    }
    if (!(settings.timeout_s > 0)) {
      return fail(FaultKind::kRefused,
                  "the time limit is " + seconds(settings.timeout_s) + ", expected more than 0");
    }
    return {};
  }

  /// Returns the exposure that the camera chose.
  Result<double> trigger(const CaptureSettings& settings) {
    const auto [min_s, max_s] = session_->exposure_range();
    const double exposure_s = std::clamp(settings.exposure_s, min_s, max_s);
    const auto work = [session = session_, exposure_s, limit_s = settings.timeout_s]() -> Result<double> {
      return caught<double>([&] { return session->trigger(exposure_s, limit_s); });
    };
    if (session_->control_lost()) return lose(FaultKind::kUnreachable, "control of the camera was lost");
    auto result = control_.run<Result<double>>(work, settings.timeout_s);
    if (!result) {
      return lose(FaultKind::kTimeout,
                  "the camera did not take the trigger within " + seconds(settings.timeout_s));
    }
    if (!*result) {
      const Fault& why = result->error();
      if (why.kind == FaultKind::kRefused) return tl::make_unexpected(named(why));
      return lose(why.kind, why.message);
    }
    order_.triggered();
    return **result;
  }

  Result<FrameStream::Frame> wait_for_frame(double deadline_s, double timeout_s) {
    while (true) {
      const double remaining_s = deadline_s - clock_.now_s();
      if (auto frame = session_->stream().wait(std::min(remaining_s, kLostPollS))) return frame;
      if (session_->control_lost()) return lose(FaultKind::kUnreachable, "control of the camera was lost");
      if (remaining_s <= 0)
        return lose(FaultKind::kTimeout, "no frame within " + seconds(timeout_s) + " of the trigger");
    }
  }

  Result<Capture> read(ArvBuffer* buffer, const FrameStream::PacketCounts& before) {
    const ArvBufferStatus status = arv_buffer_get_status(buffer);
    const FrameStream::PacketCounts after = session_->stream().packets();
    if (status != ARV_BUFFER_STATUS_SUCCESS) {
      return fail(FaultKind::kDataLoss, std::string("the frame is incomplete: ") + text_of(status) + " (" +
                                            std::to_string(after.missing - before.missing) +
                                            " packets missing, " +
                                            std::to_string(after.resent - before.resent) + " resent)");
    }
    auto image = session_->image(buffer);
    if (!image) return tl::make_unexpected(named(image.error()));
    const CameraSession::FrameFacts facts = session_->facts(buffer);
    if (auto wrong = order_.accept(facts.id, facts.id_is_16_bit, facts.timestamp_ns)) {
      return fail(wrong->kind, wrong->message);
    }

    Capture capture;
    capture.scan = decode_range_image(session_->format(), *image);
    capture.frame_id = order_.last_id();
    capture.device_timestamp_ns = facts.timestamp_ns;
    capture.exposure_s = facts.exposure_s.value_or(0);
    capture.resent_packets = static_cast<int>(after.resent - before.resent);
    return capture;
  }

  tl::unexpected<Fault> fail(FaultKind kind, std::string message) const {
    return fault(kind, info_.text(), std::move(message));
  }
  Fault named(const Fault& other) const { return Fault{other.kind, info_.text(), other.message}; }

  /// The camera is gone or out of step: give the connection up.
  tl::unexpected<Fault> lose(FaultKind kind, std::string message) {
    session_->presume_dead();
    give_up(message);
    control_.renew();  // Closing a dead camera takes Aravis ten seconds; a reconnection need not wait for it.
    return fail(kind, std::move(message));
  }
  void give_up(const std::string& reason) {
    last_loss_ = reason;
    disconnect();
  }

  /// Closing talks to the camera: the last owner of a session is always the control thread.
  void disconnect() {
    if (!session_) return;
    control_.post([session = std::move(session_)]() mutable { session.reset(); });
    session_ = nullptr;
  }

  GenicamScannerConfig config_;
  Clock& clock_;
  ScannerInfo info_;
  ControlThread control_;
  std::shared_ptr<CameraSession> session_;  ///< Null when not connected.
  std::string last_loss_;                   ///< Why there is no session any more.
  FrameOrder order_;                        ///< Of the frames of this connection.
};

}  // namespace

std::unique_ptr<Scanner> make_genicam_scanner(const GenicamScannerConfig& config, Clock& clock) {
  return std::make_unique<GenicamScanner>(config, clock);
}

}  // namespace gantry
