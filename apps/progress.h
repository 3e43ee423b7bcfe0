#pragma once

#include <mutex>
#include <string>
#include <vector>

#include "gantry/acquisition/motion.h"

namespace gantry {

/// One line on the terminal that follows the run: axes, scan k of n, stage. Silent when stdout is not a
/// terminal. Thread-safe.
class Progress {
 public:
  explicit Progress(bool enabled) : enabled_(enabled) {}
  ~Progress() { clear(); }

  void axes(const std::vector<std::unique_ptr<Axis>>& axes, const std::vector<AxisStatus>& statuses);
  void stage(const std::string& text);
  /// Removes the line, so that other output starts on a clean one.
  void clear();

 private:
  void draw();

  const bool enabled_;
  std::mutex mutex_;
  std::string axes_, stage_;
};

}  // namespace gantry
