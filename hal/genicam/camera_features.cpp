#include "camera_features.h"

#include "gobject.h"

namespace gantry {

namespace {

FaultKind kind_of(const GError* error) {
  if (error->domain != ARV_DEVICE_ERROR) return FaultKind::kProtocol;
  switch (error->code) {
    case ARV_DEVICE_ERROR_TIMEOUT:
      return FaultKind::kTimeout;
    case ARV_DEVICE_ERROR_NOT_CONNECTED:
    case ARV_DEVICE_ERROR_NOT_FOUND:
    case ARV_DEVICE_ERROR_TRANSFER_ERROR:
      return FaultKind::kUnreachable;
    case ARV_DEVICE_ERROR_NOT_CONTROLLER:
    case ARV_DEVICE_ERROR_FEATURE_NOT_FOUND:
    case ARV_DEVICE_ERROR_PROTOCOL_ERROR_ACCESS_DENIED:
    case ARV_DEVICE_ERROR_PROTOCOL_ERROR_WRITE_PROTECT:
    case ARV_DEVICE_ERROR_PROTOCOL_ERROR_BUSY:
      return FaultKind::kRefused;
    default:
      return FaultKind::kProtocol;
  }
}

}  // namespace

void throw_fault(FaultKind kind, std::string device, std::string message) {
  throw FaultException{Fault{kind, std::move(device), std::move(message)}};
}

Features::Features(ArvCamera* camera, std::string device) : camera_(camera), device_(std::move(device)) {}

void Features::check(const GError* error, const std::string& action) const {
  if (error) throw_fault(kind_of(error), device_, "cannot " + action + ": " + error->message);
}

bool Features::offers(const char* feature) const {
  GErrorSlot error;
  return arv_camera_is_feature_available(camera_, feature, error.out()) && !error;
}

bool Features::offers(const char* feature, const char* entry) const {
  GErrorSlot error;
  return offers(feature) && arv_camera_is_enumeration_entry_available(camera_, feature, entry, error.out()) &&
         !error;
}

void Features::require(const char* feature, const char* purpose) const {
  GErrorSlot error;
  const bool available = arv_camera_is_feature_available(camera_, feature, error.out());
  check(error.get(), std::string("look for the feature ") + feature);
  if (!available) {
    throw_fault(
        FaultKind::kRefused, device_,
        std::string("the camera does not offer the feature ") + feature + ", which is needed for " + purpose);
  }
}

double Features::number(const char* feature) const {
  ArvGcNode* node = arv_device_get_feature(arv_camera_get_device(camera_), feature);
  if (node && ARV_IS_GC_INTEGER(node) && !ARV_IS_GC_FLOAT(node)) return static_cast<double>(integer(feature));
  GErrorSlot error;
  const double value = arv_camera_get_float(camera_, feature, error.out());
  check(error.get(), std::string("read ") + feature);
  return value;
}

int64_t Features::integer(const char* feature) const {
  GErrorSlot error;
  const int64_t value = arv_camera_get_integer(camera_, feature, error.out());
  check(error.get(), std::string("read ") + feature);
  return value;
}

bool Features::boolean(const char* feature) const {
  GErrorSlot error;
  const bool value = arv_camera_get_boolean(camera_, feature, error.out());
  check(error.get(), std::string("read ") + feature);
  return value;
}

std::string Features::text(const char* feature) const {
  GErrorSlot error;
  const char* value = arv_camera_get_string(camera_, feature, error.out());
  check(error.get(), std::string("read ") + feature);
  return value ? value : "";
}

std::string Features::text_or_empty(const char* feature) const {
  return offers(feature) ? text(feature) : "";
}

void Features::set_number(const char* feature, double value) const {
  GErrorSlot error;
  arv_camera_set_float(camera_, feature, value, error.out());
  check(error.get(), std::string("set ") + feature + " to " + std::to_string(value));
}

void Features::set_integer(const char* feature, int64_t value) const {
  GErrorSlot error;
  arv_camera_set_integer(camera_, feature, value, error.out());
  check(error.get(), std::string("set ") + feature + " to " + std::to_string(value));
}

void Features::set_boolean(const char* feature, bool value) const {
  GErrorSlot error;
  arv_camera_set_boolean(camera_, feature, value, error.out());
  check(error.get(), std::string("set ") + feature + (value ? " to true" : " to false"));
}

void Features::set_text(const char* feature, const char* value) const {
  GErrorSlot error;
  arv_camera_set_string(camera_, feature, value, error.out());
  check(error.get(), std::string("set ") + feature + " to " + value);
}

void Features::execute(const char* command) const {
  if (!execute_unless_busy(command)) {
    throw_fault(FaultKind::kRefused, device_,
                std::string("cannot execute ") + command + ": the camera is busy");
  }
}

bool Features::execute_unless_busy(const char* command) const {
  GErrorSlot error;
  arv_camera_execute_command(camera_, command, error.out());
  if (error && error.get()->domain == ARV_DEVICE_ERROR &&
      error.get()->code == ARV_DEVICE_ERROR_PROTOCOL_ERROR_BUSY) {
    return false;
  }
  check(error.get(), std::string("execute ") + command);
  return true;
}

}  // namespace gantry
