#include "gantry/hal/modbus_drives.h"

#include "modbus/iai_robo_cylinder.h"
#include "modbus/modbus_bus.h"
#include "modbus/modbus_unit.h"
#include "modbus/oriental_motor_az.h"

namespace gantry {

std::shared_ptr<ModbusBus> make_modbus_bus(const std::string& host, int port) {
  return std::make_shared<ModbusBus>(host, port);
}

std::unique_ptr<Drive> make_modbus_drive(const ModbusDriveConfig& config, std::shared_ptr<ModbusBus> bus,
                                         Clock& clock) {
  const auto require = [&config](bool ok, const std::string& what) {
    if (!ok) throw InputError("axis " + config.axis + ": " + what);
  };
  const bool iai = config.profile == "iai_robo_cylinder";
  require(iai || config.profile == "oriental_motor_az",
          "unknown drive profile '" + config.profile + "', expected iai_robo_cylinder or oriental_motor_az");
  require(!config.host.empty(), "the drive needs a host");
  require(config.port >= 1 && config.port <= 65535,
          "port " + std::to_string(config.port) + " is outside 1 to 65535");
  require(config.unit >= 1 && config.unit <= 247,
          "Modbus unit " + std::to_string(config.unit) + " is outside 1 to 247");
  require(config.response_timeout_s > 0, "the response timeout must be positive");

  if (!bus) bus = make_modbus_bus(config.host, config.port);
  const std::string address = bus->address() + " unit " + std::to_string(config.unit);
  const auto unit = [&](const char* model) {
    return ModbusUnit(bus, config.unit, {config.axis, model, address}, config.response_timeout_s);
  };
  if (iai) {
    require(config.kind == AxisKind::kLinear, "profile iai_robo_cylinder needs a linear axis");
    require(
        config.counts_per_axis_unit == 0 || config.counts_per_axis_unit == IaiRoboCylinderDrive::kCountsPerMm,
        "an IAI ROBO Cylinder always has 100 counts per mm");
    require(config.in_position_mm > 0, "the in-position band must be positive");
    return std::make_unique<IaiRoboCylinderDrive>(unit(IaiRoboCylinderDrive::kModel), config.in_position_mm,
                                                  clock);
  }
  require(config.counts_per_axis_unit > 0, "profile oriental_motor_az needs steps per mm or per rad above 0");
  return std::make_unique<OrientalMotorAzDrive>(unit(OrientalMotorAzDrive::kModel),
                                                config.counts_per_axis_unit, clock);
}

}  // namespace gantry
