#include "gantry/hal/modbus_safety_inputs.h"

#include <algorithm>

#include "modbus/modbus_bus.h"

namespace gantry {
namespace {

constexpr int kMostBitsOfOneRead = 2000;  // Modbus Application Protocol V1.1b3, 6.2.

class ModbusSafetyInputs final : public SafetyInputs {
 public:
  ModbusSafetyInputs(const ModbusSafetyInputsConfig& config, std::shared_ptr<ModbusBus> bus)
      : config_(config), bus_(std::move(bus)) {
    const auto [low, high] = std::minmax_element(config_.channels.begin(), config_.channels.end());
    first_ = *low;
    count_ = *high - *low + 1;
    device_ = "safety inputs (Modbus at " + bus_->address() + " unit " + std::to_string(config_.unit) + ")";
  }

  const std::string& device() const override { return device_; }

  Result<std::vector<bool>> read() override {
    auto bits = bus_->read_discrete_inputs(config_.unit, static_cast<uint16_t>(first_),
                                           static_cast<uint16_t>(count_), config_.response_timeout_s);
    if (!bits) {
      bits.error().device = device_;
      return bits;
    }
    std::vector<bool> levels;
    for (const int channel : config_.channels)
      levels.push_back((*bits)[static_cast<size_t>(channel - first_)]);
    return levels;
  }

 private:
  ModbusSafetyInputsConfig config_;
  std::shared_ptr<ModbusBus> bus_;
  std::string device_;
  int first_ = 0;
  int count_ = 0;
};

}  // namespace

std::unique_ptr<SafetyInputs> make_modbus_safety_inputs(const ModbusSafetyInputsConfig& config,
                                                        std::shared_ptr<ModbusBus> bus) {
  const auto require = [](bool ok, const std::string& what) {
    if (!ok) throw InputError("safety inputs: " + what);
  };
  require(!config.host.empty(), "the I/O module needs a host");
  require(config.port >= 1 && config.port <= 65535,
          "port " + std::to_string(config.port) + " is outside 1 to 65535");
  require(config.unit >= 1 && config.unit <= 247,
          "Modbus unit " + std::to_string(config.unit) + " is outside 1 to 247");
  require(config.response_timeout_s > 0, "the response timeout must be positive");
  require(!config.channels.empty() && config.channels.size() <= SafetyInputsSnapshot::kMaxChannels,
          "from 1 to " + std::to_string(SafetyInputsSnapshot::kMaxChannels) + " channels are needed, found " +
              std::to_string(config.channels.size()));
  for (const int channel : config.channels)
    require(channel >= 0 && channel <= 0xFFFF,
            "channel " + std::to_string(channel) + " is outside 0 to 65535");
  const auto [low, high] = std::minmax_element(config.channels.begin(), config.channels.end());
  require(*high - *low < kMostBitsOfOneRead,
          "channels " + std::to_string(*low) + " and " + std::to_string(*high) +
              " are too far apart to be read in one request (2000 inputs)");
  if (!bus) bus = make_modbus_bus(config.host, config.port);
  return std::make_unique<ModbusSafetyInputs>(config, std::move(bus));
}

}  // namespace gantry
