#include "gantry/hal/drive.h"
#include "gantry/hal/scanner.h"

namespace gantry {

std::string DriveInfo::text() const {
  return "axis " + axis + " (" + model + (address.empty() ? "" : " at " + address) + ")";
}

std::string ScannerInfo::text() const {
  std::string out = "scanner " + (model.empty() ? "(unknown)" : model);
  if (!serial.empty()) out += ", serial " + serial;
  if (!address.empty()) out += " at " + address;
  return out;
}

}  // namespace gantry
