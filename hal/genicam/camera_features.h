#pragma once

#include <arv.h>

#include <cstdint>
#include <string>

#include "gantry/foundation/error.h"

namespace gantry {

/// How a fault travels inside this folder, where one operation is dozens of feature accesses;
/// CameraSession's callers turn it into a Result at the border.
struct FaultException {
  Fault fault;
};

[[noreturn]] void throw_fault(FaultKind kind, std::string device, std::string message);

/// The GenICam features of one camera by their SFNC names. Every failure is thrown as a
/// FaultException whose message names the feature.
class Features {
 public:
  /// `device` is how messages name the camera.
  Features(ArvCamera* camera, std::string device);

  const std::string& device() const { return device_; }
  ArvCamera* camera() const { return camera_; }

  bool offers(const char* feature) const;
  /// Whether the enumeration `feature` has this entry.
  bool offers(const char* feature, const char* entry) const;
  /// Refuses the camera when it lacks the feature; `purpose` ends "..., which is needed for".
  void require(const char* feature, const char* purpose) const;

  double number(const char* feature) const;  ///< Of a Float or an Integer.
  int64_t integer(const char* feature) const;
  bool boolean(const char* feature) const;
  std::string text(const char* feature) const;
  /// Empty when the camera does not offer it.
  std::string text_or_empty(const char* feature) const;

  void set_number(const char* feature, double value) const;
  void set_integer(const char* feature, int64_t value) const;
  void set_boolean(const char* feature, bool value) const;
  /// Of an enumeration or a string.
  void set_text(const char* feature, const char* value) const;
  void execute(const char* command) const;
  /// False, and nothing happened, when the device answered that it is busy (GEV_STATUS_BUSY).
  bool execute_unless_busy(const char* command) const;

  /// Throws when `error` holds one; `action` is what was tried: "read Width".
  void check(const GError* error, const std::string& action) const;

 private:
  ArvCamera* camera_;  ///< Owned by the session.
  std::string device_;
};

}  // namespace gantry
