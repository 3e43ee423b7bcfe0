#pragma once

#include <memory>

#include "gantry/acquisition/cell.h"
#include "gantry/acquisition/safety_permit.h"
#include "gantry/sim/safety_contacts.h"

namespace gantry {

/// The safety inputs of a cell as CELL.yaml names them, and the permit that judges them. Nothing is connected
/// yet: the first service() of the channel is.
struct SafetyDevices {
  std::unique_ptr<SafetyContacts> contacts;      ///< Only when they are simulated in this process.
  std::shared_ptr<SafetyInputsChannel> channel;  ///< To be serviced every CellSafety::poll_s.
  std::unique_ptr<SafetyPermit> permit;
};

SafetyDevices make_safety_devices(const CellSafety& safety, Clock& clock);

/// Contacts for every input of the chain, all released: what the twin's I/O module is wired to.
std::unique_ptr<SafetyContacts> make_safety_contacts(const CellSafety& safety, Clock& clock);

}  // namespace gantry
