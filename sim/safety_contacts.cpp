#include "gantry/sim/safety_contacts.h"

#include <set>

#include "gantry/foundation/error.h"

namespace gantry {
namespace {

class SimulatedSafetyInputs final : public SafetyInputs {
 public:
  SimulatedSafetyInputs(const SafetyContacts& contacts, std::vector<int> channels)
      : contacts_(contacts), channels_(std::move(channels)) {}

  const std::string& device() const override { return device_; }

  Result<std::vector<bool>> read() override {
    std::vector<bool> levels;
    for (const int channel : channels_) levels.push_back(contacts_.level(channel));
    return levels;
  }

 private:
  const std::string device_ = "safety inputs (simulated)";
  const SafetyContacts& contacts_;
  std::vector<int> channels_;
};

}  // namespace

SafetyContacts::SafetyContacts(std::vector<SafetyDevice> devices, Clock& clock)
    : devices_(std::move(devices)), clock_(clock) {
  std::set<std::string> names;
  for (const SafetyDevice& device : devices_) {
    if (!names.insert(device.name).second)
      throw InputError("safety contacts: two devices are called '" + device.name + "'");
    for (const int channel : device.channels)
      if (!contacts_.try_emplace(channel).second)
        throw InputError("safety contacts: channel " + std::to_string(channel) + " is used twice");
  }
}

bool SafetyContacts::closed_at(const Contact& contact, double now_s) {
  if (contact.stuck_at) return *contact.stuck_at;
  return now_s >= contact.change_at_s ? contact.closed_after : contact.closed;
}

SafetyContacts::Contact& SafetyContacts::contact(int channel) {
  const auto found = contacts_.find(channel);
  if (found == contacts_.end())
    throw InputError("safety contacts: nothing is wired to channel " + std::to_string(channel));
  return found->second;
}

void SafetyContacts::move(const std::string& device, bool closed, double lag_s) {
  const double now_s = clock_.now_s();
  std::lock_guard lock(mutex_);
  for (const SafetyDevice& each : devices_) {
    if (each.name != device) continue;
    double at_s = now_s;
    for (const int channel : each.channels) {
      Contact& moved = contact(channel);
      moved.closed = now_s >= moved.change_at_s ? moved.closed_after : moved.closed;
      moved.closed_after = closed;
      moved.change_at_s = at_s;
      at_s += lag_s;
    }
    return;
  }
  throw InputError("safety contacts: there is no device '" + device + "'");
}

void SafetyContacts::press(const std::string& device, double lag_s) {
  move(device, false, lag_s);
}

void SafetyContacts::release(const std::string& device, double lag_s) {
  move(device, true, lag_s);
}

void SafetyContacts::break_wire(int channel) {
  std::lock_guard lock(mutex_);
  contact(channel).wire_broken = true;
}

void SafetyContacts::stick(int channel) {
  const double now_s = clock_.now_s();
  std::lock_guard lock(mutex_);
  Contact& stuck = contact(channel);
  stuck.stuck_at = closed_at(stuck, now_s);
}

void SafetyContacts::mend(int channel) {
  std::lock_guard lock(mutex_);
  Contact& mended = contact(channel);
  mended.wire_broken = false;
  mended.stuck_at.reset();
}

void SafetyContacts::set_supply(bool on) {
  std::lock_guard lock(mutex_);
  supply_ = on;
}

bool SafetyContacts::level(int channel) const {
  const double now_s = clock_.now_s();
  std::lock_guard lock(mutex_);
  const auto found = contacts_.find(channel);
  return supply_ && found != contacts_.end() && !found->second.wire_broken && closed_at(found->second, now_s);
}

std::unique_ptr<SafetyInputs> make_simulated_safety_inputs(const SafetyContacts& contacts,
                                                           std::vector<int> channels) {
  return std::make_unique<SimulatedSafetyInputs>(contacts, std::move(channels));
}

}  // namespace gantry
