#include "gantry/foundation/error.h"

namespace gantry {

std::string_view to_string(FaultKind kind) {
  switch (kind) {
    case FaultKind::kUnreachable:
      return "unreachable";
    case FaultKind::kTimeout:
      return "timeout";
    case FaultKind::kProtocol:
      return "protocol";
    case FaultKind::kRefused:
      return "refused";
    case FaultKind::kAlarm:
      return "alarm";
    case FaultKind::kLimit:
      return "limit";
    case FaultKind::kNotSettled:
      return "not settled";
    case FaultKind::kDataLoss:
      return "data loss";
  }
  return "unknown";
}

std::string Fault::text() const {
  return device + ": " + message + " [" + std::string(to_string(kind)) + "]";
}

}  // namespace gantry
