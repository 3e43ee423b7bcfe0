#pragma once

#include <atomic>
#include <chrono>
#include <condition_variable>
#include <cstdint>
#include <mutex>
#include <string>
#include <thread>

#include "gantry/sim/twin/gige_vision_camera.h"
#include "gvcp.h"
#include "gvsp.h"
#include "stream_sender.h"

namespace gantry::gige {

/// What the registers say about acquisition.
struct AcquisitionSettings {
  bool trigger_on = false;
  bool single_frame = false;
  double exposure_us = 0;
  double frame_period_s = 1;  ///< Between free-running frames.
  Region region;
  ChunkLayout chunks;
  StreamFormat stream;
};

/// The camera's clock: nanoseconds since it was switched on or last reset.
class DeviceClock {
 public:
  uint64_t now_ns() const;
  void reset();

 private:
  std::atomic<int64_t> start_ns_ = std::chrono::steady_clock::now().time_since_epoch().count();
};

/// Exposes at each trigger (or on its own, with TriggerMode Off) on its own thread, and hands the coded
/// frames to the sender. Thread-safe.
class Acquisition {
 public:
  Acquisition(const GigeVisionOptions& options, GigeVisionCamera::Expose expose, const DeviceClock& clock,
              StreamSender& sender);
  ~Acquisition();

  void configure(const AcquisitionSettings& settings);
  void start();
  /// No further exposure begins; the present one still finishes and is sent.
  void stop();
  bool active() const;
  GvcpStatus trigger();
  /// The next block is the first one again: the stream channel was opened.
  void reset_block_id();
  float temperature_c() const;
  void add_to(GigeVisionStatistics& statistics) const;

 private:
  using Clock = std::chrono::steady_clock;

  void run();
  bool wait_for_exposure(std::unique_lock<std::mutex>& lock);
  void expose_and_send(std::unique_lock<std::mutex>& lock);
  uint64_t next_block_id(bool extended);

  const GigeVisionOptions& options_;
  const GigeVisionCamera::Expose expose_;
  const DeviceClock& clock_;
  StreamSender& sender_;

  mutable std::mutex mutex_;
  std::condition_variable wake_;
  AcquisitionSettings settings_;
  bool stopping_ = false;
  bool active_ = false;
  bool triggered_ = false;
  bool exposing_ = false;
  Clock::time_point next_free_run_;
  uint64_t last_block_id_;
  float temperature_c_;
  GigeVisionStatistics counts_;
  std::thread thread_;
};

}  // namespace gantry::gige
