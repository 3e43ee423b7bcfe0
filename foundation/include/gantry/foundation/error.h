#pragma once

#include <stdexcept>
#include <string>
#include <string_view>
#include <tl/expected.hpp>

namespace gantry {

/// What every executable returns to the shell; scripts rely on these numbers.
enum class ExitCode : int {
  kPass = 0,         ///< Done; where there is a verdict, it is PASS.
  kFail = 1,         ///< The part is out of tolerance.
  kInputError = 2,   ///< A wrong option or a bad file.
  kDeviceFault = 3,  ///< A device was unreachable, refused or failed.
  kUndecided = 4     ///< The result is not certain enough for PASS or FAIL.
};

/// A file or option that a person must mend. Thrown once, where the mistake is found; the message
/// names the file, the line or key, what was found and what was expected. Ends in exit code 2.
class InputError : public std::runtime_error {
 public:
  using std::runtime_error::runtime_error;
};

/// What kind of thing went wrong with a device.
enum class FaultKind {
  kUnreachable,  ///< Nobody answers at the address.
  kTimeout,      ///< It answered before but not in time now.
  kProtocol,     ///< It answered something that the protocol does not allow.
  kRefused,      ///< The command is not allowed in the present state, or was rejected by the device.
  kAlarm,        ///< The device reports an alarm of its own.
  kLimit,        ///< The target lies outside a soft limit.
  kNotSettled,   ///< Motion ended, but standstill at the target could not be proved.
  kDataLoss      ///< Data arrived incomplete.
};

std::string_view to_string(FaultKind kind);

/// Why a device call did not succeed. Faults are normal around hardware, so they are returned, not
/// thrown: see Result.
struct Fault {
  FaultKind kind = FaultKind::kProtocol;
  std::string device;   ///< Which device, as a person names it: "axis tilt (OM AZ at 127.0.0.1:1503 unit 1)".
  std::string message;  ///< What happened and, where known, what to do.

  /// "device: message [kind]", one line for a person.
  std::string text() const;
};

template <typename T>
using Result = tl::expected<T, Fault>;

inline tl::unexpected<Fault> fault(FaultKind kind, std::string device, std::string message) {
  return tl::make_unexpected(Fault{kind, std::move(device), std::move(message)});
}

/// Carries a Fault up to main() where no step in between can do better. Ends in exit code 3.
class DeviceError : public std::runtime_error {
 public:
  explicit DeviceError(const Fault& fault) : std::runtime_error(fault.text()) {}
};

}  // namespace gantry
