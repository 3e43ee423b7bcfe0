// FAULTS.yaml.

#include "gantry/sim/fault_schedule.h"

#include "fuzz.h"

namespace {

const gantry::FaultTargetNames kNames = {
    {{"linear", false}, {"tilt", true}}, {"drives"}, {{"emergency stop", 2}, {"door", 1}}};

}  // namespace

std::vector<std::string> gantry::fuzz::seeds() {
  FaultSchedule every;
  for (const FaultModeInfo& mode : fault_modes()) {
    FaultEntry entry;
    entry.device = mode.device;
    entry.mode = mode.mode;
    entry.at_s = 1.25;
    if (mode.lasts) entry.for_s = 0.1;
    if (mode.device == FaultDevice::kAxis) entry.name = "tilt";
    if (mode.device == FaultDevice::kBus) entry.name = "drives";
    if (mode.device == FaultDevice::kSafety) entry.name = "emergency stop";
    if (mode.mode == FaultMode::kSlip) entry.event = FaultEvent::kExposure;
    every.entries.push_back(entry);
  }
  return {fault_schedule_text(every, kNames, "every kind"), "seed: 3\nfaults: []\n"};
}

int LLVMFuzzerTestOneInput(const uint8_t* data, size_t size) {
  using namespace gantry;
  static const fuzz::InputFile file("faults.yaml"), again("again.yaml");
  const auto& path = file.write(fuzz::text_of(data, size));
  fuzz::value_or_input_error([&] {
    const FaultSchedule schedule = read_fault_schedule(path, kNames);
    if (!(read_fault_schedule(again.write(fault_schedule_text(schedule, kNames, "")), kNames) == schedule))
      throw std::logic_error("a schedule that is not read back as it was");
  });
  return 0;
}
