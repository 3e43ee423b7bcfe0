#include "gantry/sim/twin/modbus_drives.h"

#include <algorithm>
#include <utility>

#include "drive_bank.h"
#include "iai_robo_cylinder.h"
#include "io_module.h"
#include "kinco_fd.h"
#include "leadshine_cs2rs.h"
#include "oriental_motor_az.h"
#include "serial_endpoint.h"
#include "tcp_endpoint.h"

namespace gantry {
namespace {

constexpr double kIaiMmPerCount = 0.01;

std::unique_ptr<TwinDrive> make_drive(const TwinDriveConfig& config, SimulatedStage& stage, double now_s) {
  const std::string unit = "Modbus unit " + std::to_string(config.unit);
  const double count = config.axis_units_per_count;
  if (config.profile == "iai_robo_cylinder") {
    if (count != kIaiMmPerCount)
      throw InputError(unit + ": an IAI ROBO Cylinder counts 0.01 mm, found axis_units_per_count " +
                       std::to_string(count));
    return std::make_unique<IaiRoboCylinder>(stage);
  }
  if (!(count > 0))
    throw InputError(unit + ": axis_units_per_count must be positive, found " + std::to_string(count));
  if (config.profile == "oriental_motor_az")
    return std::make_unique<OrientalMotorAz>(stage, count, now_s, config.communication_timeout_address);
  if (config.profile == "leadshine_cs2rs") return std::make_unique<LeadshineCs2rs>(stage, count);
  if (config.profile == "kinco_fd") return std::make_unique<KincoFd>(stage, count);
  std::string known;
  for (const std::string& name : twin_drive_profiles()) known += (known.empty() ? "" : ", ") + name;
  throw InputError(unit + ": the twin has no drive '" + config.profile + "'; it has " + known);
}

}  // namespace

const std::vector<std::string>& twin_drive_profiles() {
  static const std::vector<std::string> names{"iai_robo_cylinder", "kinco_fd", "leadshine_cs2rs",
                                              "oriental_motor_az"};
  return names;
}

class ModbusDriveServer::Impl {
 public:
  explicit Impl(Clock& clock) : bank(clock) {}

  DriveBank bank;
  std::unique_ptr<Endpoint> endpoint;
};

ModbusDriveServer::ModbusDriveServer(std::string address, int port, Clock& clock)
    : impl_(std::make_unique<Impl>(clock)) {
  impl_->endpoint = std::make_unique<TcpEndpoint>(std::move(address), port, impl_->bank);
}

ModbusDriveServer::ModbusDriveServer(const TwinSerialLine& line, Clock& clock)
    : impl_(std::make_unique<Impl>(clock)) {
  impl_->endpoint = std::make_unique<SerialEndpoint>(line, impl_->bank);
}

ModbusDriveServer::~ModbusDriveServer() = default;

void ModbusDriveServer::add(const TwinDriveConfig& config, SimulatedStage& stage) {
  impl_->bank.add(config.unit, make_drive(config, stage, impl_->bank.now_s()));
}
void ModbusDriveServer::add_io_module(int unit, const SafetyContacts& contacts) {
  impl_->bank.add(unit, std::make_unique<IoModule>(contacts));
}
void ModbusDriveServer::start() {
  impl_->endpoint->start();
}
int ModbusDriveServer::port() const {
  return impl_->endpoint->port();
}
std::string ModbusDriveServer::device() const {
  return impl_->endpoint->device();
}

void ModbusDriveServer::raise_alarm(int unit, int code, AlarmCause cause) {
  impl_->bank.with_drive(unit, [&](TwinDrive& drive, double now_s) {
    drive.raise_alarm(code, cause == AlarmCause::kPersists, now_s);
  });
}
void ModbusDriveServer::clear_alarm_cause(int unit) {
  impl_->bank.with_drive(unit, [](TwinDrive& drive, double) { drive.clear_alarm_cause(); });
}
void ModbusDriveServer::set_emergency_stop(int unit, bool active) {
  impl_->bank.with_drive(unit,
                         [&](TwinDrive& drive, double now_s) { drive.set_emergency_stop(active, now_s); });
}

WireFaults& ModbusDriveServer::wire_faults() {
  return impl_->bank.faults();
}
void ModbusDriveServer::set_plugged(bool plugged) {
  impl_->endpoint->set_plugged(plugged);
}

}  // namespace gantry
