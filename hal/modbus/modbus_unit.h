#pragma once

#include <algorithm>
#include <cstdint>
#include <memory>
#include <span>
#include <string>
#include <utility>
#include <vector>

#include "gantry/hal/drive.h"
#include "modbus/modbus_bus.h"

namespace gantry {

/// One unit on a bus: what a drive reads and writes through. Its faults name the drive.
class ModbusUnit {
 public:
  /// `response_timeout_s` is for each of the attempts that the bus may make.
  ModbusUnit(std::shared_ptr<ModbusBus> bus, int unit, DriveInfo info, double response_timeout_s)
      : bus_(std::move(bus)),
        unit_(unit),
        info_(std::move(info)),
        timeout_s_(response_timeout_s * bus_->attempts()) {}

  const DriveInfo& info() const { return info_; }

  Result<std::vector<uint16_t>> read(uint16_t first, uint16_t count) const {
    return name(bus_->read_registers(unit_, first, count, timeout_s_));
  }
  /// A read that may take as long as opening a connection over a slow network does.
  Result<std::vector<uint16_t>> first_read(uint16_t first, uint16_t count) const {
    return name(bus_->read_registers(unit_, first, count, std::max(timeout_s_, kConnectTimeout_s)));
  }
  Result<void> write(uint16_t first, std::span<const uint16_t> values, WriteHandling handling = {}) const {
    return name(bus_->write_registers(unit_, first, values, timeout_s_, handling));
  }
  /// By function 06, which takes one register only.
  Result<void> write_one(uint16_t address, uint16_t value, WriteHandling handling = {}) const {
    return name(bus_->write_register(unit_, address, value, timeout_s_, handling));
  }
  Result<void> write_coil(uint16_t coil, bool on, WriteHandling handling = {}) const {
    return name(bus_->write_coil(unit_, coil, on, timeout_s_, handling));
  }

  tl::unexpected<Fault> refused(std::string message) const {
    return fault(FaultKind::kRefused, info_.text(), std::move(message));
  }

 private:
  static constexpr double kConnectTimeout_s = 1.0;

  template <typename T>
  Result<T> name(Result<T> result) const {
    if (!result) result.error().device = info_.text();
    return result;
  }

  std::shared_ptr<ModbusBus> bus_;
  int unit_;
  DriveInfo info_;
  double timeout_s_;
};

}  // namespace gantry
