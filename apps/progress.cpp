#include "progress.h"

#include <cstdio>

namespace gantry {

void Progress::axes(const std::vector<std::unique_ptr<Axis>>& axes, const std::vector<AxisStatus>& statuses) {
  if (!enabled_) return;
  std::lock_guard lock(mutex_);
  axes_.clear();
  for (size_t i = 0; i < axes.size(); ++i) {
    const DriveStatus& drive = statuses[i].drive;
    axes_ += "  " + axes[i]->name() + " " + (drive.homed ? axes[i]->format(drive.position) : "not homed");
  }
  draw();
}

void Progress::stage(const std::string& text) {
  if (!enabled_) return;
  std::lock_guard lock(mutex_);
  stage_ = text;
  draw();
}

void Progress::clear() {
  if (!enabled_) return;
  std::lock_guard lock(mutex_);
  std::printf("\r\033[K");
  std::fflush(stdout);
}

void Progress::draw() {
  std::printf("\r\033[K%-42s%s", stage_.c_str(), axes_.c_str());
  std::fflush(stdout);
}

}  // namespace gantry
