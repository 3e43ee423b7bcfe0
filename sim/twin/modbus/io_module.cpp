#include "io_module.h"

#include <string>

#include "gantry/foundation/error.h"

namespace gantry {
namespace {

constexpr int kReadDiscreteInputs = 0x02;

[[noreturn]] void refuse_injection(const char* what) {
  throw InputError(std::string("the twin's I/O module has no motor: ") + what +
                   " is injected at its contacts (SafetyContacts)");
}

}  // namespace

IoModule::IoModule(const SafetyContacts& contacts) : contacts_(contacts) {
  for (const SafetyDevice& device : contacts.devices())
    for (const int channel : device.channels)
      if (channel < 0 || channel >= kInputs)
        throw InputError("the twin's I/O module has inputs 0 to " + std::to_string(kInputs - 1) + "; '" +
                         device.name + "' is wired to " + std::to_string(channel));
}

bool IoModule::serves(int function) const {
  return function == kReadDiscreteInputs;
}

ModbusAnswer<std::vector<uint8_t>> IoModule::read_bits(int address, int count, double) {
  if (address + count > kInputs) return tl::make_unexpected(ModbusException::kIllegalAddress);
  std::vector<uint8_t> bits;
  for (int channel = address; channel < address + count; ++channel)
    bits.push_back(contacts_.level(channel) ? 1 : 0);
  return bits;
}

ModbusAnswer<std::vector<uint16_t>> IoModule::read_registers(int, int, double) {
  return tl::make_unexpected(ModbusException::kIllegalFunction);
}

ModbusAnswer<void> IoModule::write_bit(int, bool, double) {
  return tl::make_unexpected(ModbusException::kIllegalFunction);
}

ModbusAnswer<void> IoModule::write_registers(int, std::span<const uint16_t>, double) {
  return tl::make_unexpected(ModbusException::kIllegalFunction);
}

void IoModule::raise_alarm(int, bool, double) {
  refuse_injection("an alarm");
}

void IoModule::clear_alarm_cause() {
  refuse_injection("the end of an alarm");
}

void IoModule::set_emergency_stop(bool, double) {
  refuse_injection("an emergency stop");
}

}  // namespace gantry
