// Drive profile files, which labs write themselves.

#include "fuzz.h"
#include "modbus/drive_profile.h"

namespace gantry::fuzz {

std::vector<std::string> seeds() {
  std::vector<std::string> all{
      "based_on: kinco_fd\nmodel: Acme\nword_order: DCBA\nregisters: { mode: { address: 0x41, type: u32 } }\n"
      "bits: { homed: { register: digital_inputs, bit: 17, active_low: true } }\nnumbers: { "
      "standstill_speed: 5 }\n"};
  for (const EmbeddedProfile& profile : embedded_profiles()) all.emplace_back(profile.text);
  return all;
}

}  // namespace gantry::fuzz

int LLVMFuzzerTestOneInput(const uint8_t* data, size_t size) {
  using namespace gantry;
  fuzz::value_or_input_error([&] {
    const DriveProfile profile = parse_drive_profile(fuzz::text_of(data, size), "profile.yaml");
    // What is accepted can be used: every bit lies in a range that is read.
    for (const auto& [name, bit] : profile.bits) {
      bool read = false;
      for (const RegisterRange& range : profile.status)
        read |= bit.word.address >= range.first &&
                bit.word.address + words_of(bit.word.type) <= range.first + size_t{range.count};
      if (!read) throw std::logic_error("bit " + name + " is never read");
      if (bit.bit >= static_cast<int>(16 * words_of(bit.word.type))) throw std::logic_error("no such bit");
    }
  });
  return 0;
}
