#pragma once

#include <condition_variable>
#include <deque>
#include <mutex>
#include <optional>

#include "gantry/geometry/scan.h"

namespace gantry {

/// Hands tagged scans from the run to fusion on another thread. Bounded: a run that is ahead waits, it
/// never drops a scan. Thread-safe.
class ScanQueue {
 public:
  explicit ScanQueue(size_t capacity) : capacity_(capacity) {}

  /// Blocks while the queue is full. False when the queue was closed: nobody will read the scan.
  bool push(TaggedScan scan) {
    std::unique_lock lock(mutex_);
    changed_.wait(lock, [&] { return closed_ || scans_.size() < capacity_; });
    if (closed_) return false;
    scans_.push_back(std::move(scan));
    changed_.notify_all();
    return true;
  }

  /// Blocks until there is a scan; nothing once the queue is closed and empty.
  std::optional<TaggedScan> pop() {
    std::unique_lock lock(mutex_);
    changed_.wait(lock, [&] { return closed_ || !scans_.empty(); });
    if (scans_.empty()) return std::nullopt;
    TaggedScan scan = std::move(scans_.front());
    scans_.pop_front();
    changed_.notify_all();
    return scan;
  }

  void close() {
    std::lock_guard lock(mutex_);
    closed_ = true;
    changed_.notify_all();
  }

 private:
  const size_t capacity_;
  std::mutex mutex_;
  std::condition_variable changed_;
  std::deque<TaggedScan> scans_;
  bool closed_ = false;
};

}  // namespace gantry
