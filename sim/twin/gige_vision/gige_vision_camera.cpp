#include "gantry/sim/twin/gige_vision_camera.h"

#include <arpa/inet.h>

#include <cerrno>
#include <cmath>
#include <cstring>
#include <optional>

#include "acquisition.h"
#include "camera_features.h"
#include "control_channel.h"
#include "device_registers.h"
#include "gantry/foundation/error.h"
#include "gvcp.h"
#include "stream_sender.h"
#include "udp_socket.h"

namespace gantry {
namespace {

[[noreturn]] void reject(const std::string& message) {
  throw InputError("GigE Vision camera: " + message);
}

void require_text(const std::string& name, const std::string& text, size_t max_length) {
  if (text.size() > max_length) {
    reject(name + " '" + text + "' is longer than the " + std::to_string(max_length) +
           " characters of its register");
  }
}

/// The address in host byte order.
uint32_t loopback_address(const std::string& text) {
  in_addr address{};
  if (::inet_pton(AF_INET, text.c_str(), &address) != 1) reject("'" + text + "' is not an IPv4 address");
  const uint32_t ip = ntohl(address.s_addr);
  if (ip >> 24 != 127) reject("address " + text + " is not a loopback address (127.0.0.N)");
  return ip;
}

const GigeVisionOptions& validated(const GigeVisionOptions& options) {
  require_text("vendor", options.vendor, 31);
  require_text("model", options.model, 31);
  require_text("serial", options.serial, 15);
  require_text("firmware", options.firmware, 31);
  constexpr int kMaxSide = 8192;
  for (const int side : {options.width, options.height}) {
    if (side < static_cast<int>(gige::kMinRegion) || side > kMaxSide) {
      reject("size " + std::to_string(options.width) + " x " + std::to_string(options.height) +
             " px, expected 8 to 8192 each");
    }
  }
  for (const Scan3dCoordinate& c : options.coordinates) {
    if (!std::isfinite(c.scale) || c.scale == 0 || !std::isfinite(c.offset_mm) ||
        !std::isfinite(c.invalid_value)) {
      reject("Scan3d scale, offset and invalid value must be finite, and the scale not zero");
    }
  }
  if (!(options.pacing_mb_per_s > 0)) reject("pacing_mb_per_s must be positive");
  if (!(options.min_exposure_us > 0 && options.min_exposure_us <= options.default_exposure_us &&
        options.default_exposure_us <= options.max_exposure_us)) {
    reject("exposure limits must satisfy 0 < min <= default <= max");
  }
  if (options.resend_frames < 0) reject("resend_frames must not be negative");
  if (options.first_block_id == 0) reject("first_block_id must not be 0, which is reserved");
  return options;
}

void bind_control(gige::UdpSocket& socket, uint32_t ip, const std::string& address) {
  const int error = socket.bind({ip, gige::kGvcpPort});
  if (error == 0) return;
  const std::string where = address + ":" + std::to_string(gige::kGvcpPort) + " (UDP)";
  if (error == EADDRINUSE) {
    reject(where + " is taken by another program; give this camera an address of its own, 127.0.0.N");
  }
  reject("cannot bind " + where + ": " + std::strerror(error));
}

}  // namespace

struct GigeVisionCamera::Impl {
  Impl(const GigeVisionOptions& given, Expose expose)
      : options(validated(given)),
        ip(loopback_address(options.address)),
        sender(ip, options.pacing_mb_per_s, options.resend_frames),
        acquisition(options, std::move(expose), clock, sender),
        features(options, ip, clock, sender, acquisition) {
    bind_control(control_socket, ip, options.address);
    // Without it the camera is found by its address only.
    broadcast_socket.bind({INADDR_BROADCAST, gige::kGvcpPort}, true);
    control.emplace(control_socket, broadcast_socket, features, sender);
  }

  const GigeVisionOptions options;
  const uint32_t ip;
  gige::DeviceClock clock;
  gige::UdpSocket control_socket;
  gige::UdpSocket broadcast_socket;
  gige::StreamSender sender;
  gige::Acquisition acquisition;
  gige::CameraFeatures features;
  std::optional<gige::ControlChannel> control;  // Last: its thread uses all of the above.
};

GigeVisionCamera::GigeVisionCamera(const GigeVisionOptions& options, Expose expose)
    : impl_(std::make_unique<Impl>(options, std::move(expose))) {}

GigeVisionCamera::~GigeVisionCamera() = default;

void GigeVisionCamera::set_faults(const GigeVisionFaults& faults) {
  impl_->control->set_silent(faults.silent);
  impl_->sender.set_faults(faults);
}

GigeVisionStatistics GigeVisionCamera::statistics() const {
  GigeVisionStatistics statistics;
  impl_->control->add_to(statistics);
  impl_->acquisition.add_to(statistics);
  impl_->sender.add_to(statistics);
  statistics.discoverable_by_broadcast = impl_->broadcast_socket.is_open();
  return statistics;
}

}  // namespace gantry
