#include "gantry/hal/modbus_drives.h"

#include <algorithm>
#include <array>

#include "modbus/drive_profile.h"
#include "modbus/kinds/cia402.h"
#include "modbus/kinds/direct_data.h"
#include "modbus/kinds/numerical_move.h"
#include "modbus/kinds/pr_path.h"
#include "modbus/modbus_bus.h"
#include "modbus/modbus_unit.h"
#include "modbus/rtu_link.h"
#include "modbus/tcp_link.h"

namespace gantry {
namespace {

/// TCP repeats lost bytes itself; what is missing here, another attempt on a new connection would miss too.
constexpr int kTcpAttempts = 1;

}  // namespace

std::shared_ptr<ModbusBus> make_modbus_bus(const std::string& host, int port) {
  return std::make_shared<ModbusBus>(std::make_unique<TcpLink>(host, port), kTcpAttempts);
}

std::shared_ptr<ModbusBus> make_modbus_bus(const SerialLine& line) {
  const auto require = [&line](bool ok, const std::string& what) {
    if (!ok) throw InputError("serial line " + line.device + ": " + what);
  };
  constexpr std::array kBaudRates{9600, 19200, 38400, 57600, 115200, 230400};
  require(!line.device.empty(), "the line needs a device");
  require(std::find(kBaudRates.begin(), kBaudRates.end(), line.baud) != kBaudRates.end(),
          std::to_string(line.baud) + " is not one of 9600, 19200, 38400, 57600, 115200 and 230400 baud");
  require(line.stop_bits == 1 || line.stop_bits == 2, "there are 1 or 2 stop bits");
  require(line.read_attempts >= 1 && line.read_attempts <= 5, "1 to 5 attempts make sense");
  require(line.late_answer_s >= 0 && line.late_answer_s <= 60, "late_answer_s is outside 0 to 60");
  return std::make_shared<ModbusBus>(std::make_unique<RtuLink>(line), line.read_attempts);
}

std::string modbus_bus_address(const ModbusBus& bus) {
  return bus.address();
}

BusStatistics modbus_bus_statistics(const ModbusBus& bus) {
  return bus.statistics();
}

std::unique_ptr<Drive> make_modbus_drive(const ModbusDriveConfig& config, std::shared_ptr<ModbusBus> bus,
                                         Clock& clock) {
  const auto require = [&config](bool ok, const std::string& what) {
    if (!ok) throw InputError("axis " + config.axis + ": " + what);
  };
  DriveProfile profile;
  try {
    profile = load_drive_profile(config.profile);
  } catch (const InputError& error) {
    require(false, error.what());
  }
  const bool linear = config.kind == AxisKind::kLinear;
  require(linear ? profile.linear : profile.rotary,
          "a drive " + profile.model + " moves no " + (linear ? "linear" : "rotary") + " axis");
  if (!bus) {
    require(!config.host.empty(), "the drive needs a host");
    require(config.port >= 1 && config.port <= 65535,
            "port " + std::to_string(config.port) + " is outside 1 to 65535");
    bus = make_modbus_bus(config.host, config.port);
  }
  require(config.unit >= 1 && config.unit <= 247,
          "Modbus unit " + std::to_string(config.unit) + " is outside 1 to 247");
  require(config.response_timeout_s > 0, "the response timeout must be positive");
  require(config.in_position > 0, "the in-position band must be positive");

  RegisterDrive::Options options{config.counts_per_axis_unit, config.in_position};
  if (const auto fixed = profile.find_number("counts_per_mm")) {
    require(
        options.counts_per_axis_unit == 0 || options.counts_per_axis_unit == *fixed,
        "a drive " + profile.model + " always has " + std::to_string(std::lround(*fixed)) + " counts per mm");
    options.counts_per_axis_unit = *fixed;
  }
  require(options.counts_per_axis_unit > 0,
          "a drive " + profile.model + " needs counts per mm or per rad above 0");

  const std::string address = bus->address() + " unit " + std::to_string(config.unit);
  const ModbusUnit unit(bus, config.unit, {config.axis, profile.model, address}, config.response_timeout_s);
  if (profile.kind == "numerical_move")
    return std::make_unique<NumericalMoveDrive>(std::move(profile), unit, options, clock);
  if (profile.kind == "direct_data")
    return std::make_unique<DirectDataDrive>(std::move(profile), unit, options, clock);
  if (profile.kind == "pr_path") {
    const double turn = config.counts_per_motor_revolution > 0
                            ? config.counts_per_motor_revolution
                            : profile.number("counts_per_motor_revolution");
    return std::make_unique<PrPathDrive>(std::move(profile), unit, options, turn, clock);
  }
  return std::make_unique<Cia402Drive>(std::move(profile), unit, options, clock);
}

}  // namespace gantry
