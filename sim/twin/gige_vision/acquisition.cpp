#include "acquisition.h"

#include <exception>
#include <stdexcept>

namespace gantry::gige {

uint64_t DeviceClock::now_ns() const {
  return static_cast<uint64_t>(std::chrono::steady_clock::now().time_since_epoch().count() - start_ns_);
}

void DeviceClock::reset() {
  start_ns_ = std::chrono::steady_clock::now().time_since_epoch().count();
}

Acquisition::Acquisition(const GigeVisionOptions& options, GigeVisionCamera::Expose expose,
                         const DeviceClock& clock, StreamSender& sender)
    : options_(options),
      expose_(std::move(expose)),
      clock_(clock),
      sender_(sender),
      last_block_id_(options.first_block_id - 1),
      temperature_c_(static_cast<float>(options.temperature_c)) {
  thread_ = std::thread([this] { run(); });
}

Acquisition::~Acquisition() {
  {
    const std::lock_guard lock(mutex_);
    stopping_ = true;
    wake_.notify_all();
  }
  sender_.stop();
  thread_.join();
}

void Acquisition::configure(const AcquisitionSettings& settings) {
  const std::lock_guard lock(mutex_);
  settings_ = settings;
  wake_.notify_all();
}

void Acquisition::start() {
  const std::lock_guard lock(mutex_);
  if (active_) return;
  active_ = true;
  next_free_run_ = Clock::now();
  wake_.notify_all();
}

void Acquisition::stop() {
  const std::lock_guard lock(mutex_);
  active_ = false;
  triggered_ = false;
}

bool Acquisition::active() const {
  const std::lock_guard lock(mutex_);
  return active_;
}

GvcpStatus Acquisition::trigger() {
  const std::lock_guard lock(mutex_);
  if (!active_ || !settings_.trigger_on) {
    ++counts_.triggers_refused;
    return GvcpStatus::kAccessDenied;
  }
  if (triggered_ || exposing_) {
    ++counts_.triggers_refused;
    return GvcpStatus::kBusy;
  }
  triggered_ = true;
  ++counts_.triggers_accepted;
  wake_.notify_all();
  return GvcpStatus::kSuccess;
}

void Acquisition::reset_block_id() {
  const std::lock_guard lock(mutex_);
  last_block_id_ = options_.first_block_id - 1;
}

float Acquisition::temperature_c() const {
  const std::lock_guard lock(mutex_);
  return temperature_c_;
}

void Acquisition::add_to(GigeVisionStatistics& statistics) const {
  const std::lock_guard lock(mutex_);
  statistics.triggers_accepted += counts_.triggers_accepted;
  statistics.triggers_refused += counts_.triggers_refused;
  statistics.frames_lost += counts_.frames_lost;
  statistics.last_error = counts_.last_error;
}

void Acquisition::run() {
  std::unique_lock lock(mutex_);
  while (wait_for_exposure(lock)) {
    exposing_ = true;
    expose_and_send(lock);
    exposing_ = false;
  }
}

bool Acquisition::wait_for_exposure(std::unique_lock<std::mutex>& lock) {
  while (!stopping_) {
    const bool free_running = active_ && !settings_.trigger_on;
    if (active_ && triggered_) {
      triggered_ = false;
      return true;
    }
    if (free_running && Clock::now() >= next_free_run_) {
      next_free_run_ = Clock::now() + std::chrono::duration_cast<Clock::duration>(
                                          std::chrono::duration<double>(settings_.frame_period_s));
      return true;
    }
    if (free_running) {
      wake_.wait_until(lock, next_free_run_);
    } else {
      wake_.wait(lock);
    }
  }
  return false;
}

void Acquisition::expose_and_send(std::unique_lock<std::mutex>& lock) {
  const AcquisitionSettings settings = settings_;
  const uint64_t generation = sender_.generation();
  FrameFacts facts{.block_id = next_block_id(settings.stream.extended_ids),
                   .timestamp_ns = clock_.now_ns(),
                   .exposure_us = settings.exposure_us};
  lock.unlock();
  bool sent = false;
  std::string error;
  float temperature_c = 0;
  try {
    const TriggeredFrame frame = expose_(settings.exposure_us * 1e-6);
    const size_t expected =
        size_t{3} * static_cast<size_t>(options_.width) * static_cast<size_t>(options_.height);
    if (frame.xyz.size() != expected) {
      throw std::length_error("the frame has " + std::to_string(frame.xyz.size()) + " numbers, expected " +
                              std::to_string(expected));
    }
    temperature_c = static_cast<float>(frame.temperature_c);
    if (settings.stream.open()) {
      Block block =
          encode_block(frame.xyz, static_cast<uint32_t>(options_.width), options_.coordinates,
                       settings.region, settings.chunks, settings.stream, facts, sender_.take_buffer());
      sent = sender_.submit(std::move(block), generation);
    }
  } catch (const std::exception& failure) {
    error = failure.what();
  }
  lock.lock();
  if (error.empty()) {
    temperature_c_ = temperature_c;
  } else {
    counts_.last_error = error;
  }
  if (!sent) ++counts_.frames_lost;
  if (settings.single_frame) active_ = false;
}

uint64_t Acquisition::next_block_id(bool extended) {
  ++last_block_id_;
  // Block ids of 16 bits wrap from 65535 to 1: zero is reserved for test packets.
  if (!extended && last_block_id_ > 0xFFFF) last_block_id_ = 1;
  return last_block_id_;
}

}  // namespace gantry::gige
