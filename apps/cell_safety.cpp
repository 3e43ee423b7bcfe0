#include "cell_safety.h"

#include "gantry/hal/modbus_safety_inputs.h"

namespace gantry {

std::unique_ptr<SafetyContacts> make_safety_contacts(const CellSafety& safety, Clock& clock) {
  std::vector<SafetyDevice> devices;
  for (const SafetyInputSettings& input : safety.chain.inputs)
    devices.push_back({input.name, input.channels});
  return std::make_unique<SafetyContacts>(std::move(devices), clock);
}

SafetyDevices make_safety_devices(const CellSafety& safety, Clock& clock) {
  std::vector<int> channels;
  for (const SafetyInputSettings& input : safety.chain.inputs)
    channels.insert(channels.end(), input.channels.begin(), input.channels.end());
  SafetyDevices devices;
  std::unique_ptr<SafetyInputs> inputs;
  if (safety.module.kind == "simulated") {
    devices.contacts = make_safety_contacts(safety, clock);
    inputs = make_simulated_safety_inputs(*devices.contacts, channels);
  } else {
    ModbusSafetyInputsConfig config;
    config.host = safety.module.host;
    config.port = safety.module.port;
    config.unit = safety.module.unit;
    config.channels = channels;
    config.response_timeout_s = safety.module.response_timeout_s;
    inputs = make_modbus_safety_inputs(config, nullptr);
  }
  devices.channel = std::make_shared<SafetyInputsChannel>(std::move(inputs), clock);
  devices.permit = std::make_unique<SafetyPermit>(safety.chain, devices.channel);
  return devices;
}

}  // namespace gantry
