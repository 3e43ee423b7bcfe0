#pragma once

#include <map>
#include <memory>
#include <mutex>
#include <optional>
#include <string>
#include <vector>

#include "gantry/foundation/clock.h"
#include "gantry/hal/safety_inputs.h"

namespace gantry {

/// One device with contacts: an emergency stop with two, a door with one, ...
struct SafetyDevice {
  std::string name;
  std::vector<int> channels;  ///< Where its contacts are wired: addresses of discrete inputs.
};

/// The contacts and wires behind an I/O module, and all that can happen to them: what a person does (press,
/// release), and what breaks (wires, contacts). Active-low: current flows while a device is released and its
/// wire is whole. Everything is undone by its opposite. Thread-safe; time is the given clock's.
class SafetyContacts {
 public:
  /// Starts with every device released. Throws InputError for names or channels that are used twice.
  SafetyContacts(std::vector<SafetyDevice> devices, Clock& clock);

  /// Opens the device's contacts: the first now, each further one `lag_s` later than the one before.
  void press(const std::string& device, double lag_s = 0);
  /// Closes them in the same way.
  void release(const std::string& device, double lag_s = 0);

  /// No current, whatever the contact does.
  void break_wire(int channel);
  /// The contact stays as it is now (welded, jammed), whatever the device does.
  void stick(int channel);
  /// Ends break_wire() and stick(): the channel follows its device again.
  void mend(int channel);
  /// The I/O module without supply at its inputs: no channel has current.
  void set_supply(bool on);

  /// Whether current flows at an input of the module; false where nothing is wired.
  bool level(int channel) const;
  const std::vector<SafetyDevice>& devices() const { return devices_; }

 private:
  struct Contact {
    bool closed = true;        ///< Before `change_at_s` ...
    bool closed_after = true;  ///< ... and after.
    double change_at_s = 0;
    bool wire_broken = false;
    std::optional<bool> stuck_at;
  };
  static bool closed_at(const Contact& contact, double now_s);
  void move(const std::string& device, bool closed, double lag_s);
  Contact& contact(int channel);

  std::vector<SafetyDevice> devices_;
  Clock& clock_;
  mutable std::mutex mutex_;
  std::map<int, Contact> contacts_;  ///< By channel.
  bool supply_ = true;
};

/// The contacts as safety inputs in this process, without an I/O module between. `contacts` must outlive
/// them.
std::unique_ptr<SafetyInputs> make_simulated_safety_inputs(const SafetyContacts& contacts,
                                                           std::vector<int> channels);

}  // namespace gantry
