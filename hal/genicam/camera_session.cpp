#include "camera_session.h"

#include <algorithm>
#include <chrono>
#include <thread>

#include "discovery.h"

namespace gantry {

namespace {

constexpr const char* kTriggerPurpose = "a scan on command";
constexpr int kLoopbackPacketBytes = 65000;  ///< An IP datagram ends at 65535.
constexpr int kSafePacketBytes = 1440;       ///< Fits every Ethernet.
constexpr size_t kMaxChunkBytes = 1 << 20;
constexpr double kMicrosecond = 1e-6;
constexpr std::chrono::milliseconds kBusyPause(2);

std::string describe(const std::string& address) {
  return "camera at " + address;
}

}  // namespace

CameraSession::CameraSession(const GenicamScannerConfig& config, const std::function<double()>& remaining_s)
    : device_(describe(config.address)), control_lost_(std::make_shared<std::atomic<bool>>(false)) {
  if (!answers_discovery(config.address)) {
    throw_fault(FaultKind::kUnreachable, device_, "no GigE Vision device answers there");
  }
  GErrorSlot error;
  camera_.reset(arv_camera_new(config.address.c_str(), error.out()));
  if (!camera_) {
    throw_fault(
        FaultKind::kUnreachable, device_,
        "no GenICam camera answers there: " + (error ? error.message() : std::string("no reason given")));
  }
  if (!arv_camera_is_gv_device(camera_.get())) {
    throw_fault(FaultKind::kRefused, device_, "this is not a GigE Vision camera");
  }
  features_.emplace(camera_.get(), device_);
  take_control(remaining_s);

  // The handler runs on Aravis's heartbeat thread and may outlive this object by a moment.
  auto* lost = new std::shared_ptr<std::atomic<bool>>(control_lost_);
  g_signal_connect_data(
      arv_camera_get_device(camera_.get()), "control-lost",
      G_CALLBACK(+[](ArvDevice*, std::shared_ptr<std::atomic<bool>>* flag) { **flag = true; }), lost,
      +[](void* flag, GClosure*) { delete static_cast<std::shared_ptr<std::atomic<bool>>*>(flag); },
      static_cast<GConnectFlags>(0));

  // A client that died may have left the camera acquiring, with its settings locked.
  if (features_->offers("AcquisitionStop")) features_->execute("AcquisitionStop");
  const bool lockable = features_->offers("TLParamsLocked");
  if (lockable) features_->set_integer("TLParamsLocked", 0);

  format_ = configure_range_format(*features_);
  read_info();
  select_software_trigger();
  enable_chunks();
  arv_camera_gv_set_packet_size_adjustment(camera_.get(), ARV_GV_PACKET_SIZE_ADJUSTMENT_NEVER);
  set_packet_size(config.packet_size);
  stream_.emplace(*features_, payload_bytes(), config.packet_socket);
  if (lockable) features_->set_integer("TLParamsLocked", 1);
  features_->execute("AcquisitionStart");
}

CameraSession::~CameraSession() {
  const bool alive = !presumed_dead_ && !control_lost() && stream_;
  if (alive) {
    GErrorSlot error;
    arv_camera_execute_command(camera_.get(), "AcquisitionStop", error.out());
    if (!error && features_->offers("TLParamsLocked")) {
      arv_camera_set_integer(camera_.get(), "TLParamsLocked", 0, error.out());
    }
  }
}

void CameraSession::take_control(const std::function<double()>& remaining_s) {
  auto* device = ARV_GV_DEVICE(arv_camera_get_device(camera_.get()));
  GErrorSlot error;
  while (!arv_gv_device_is_controller(device) && !arv_gv_device_take_control(device, error.out())) {
    if (remaining_s() < 0.5) {
      throw_fault(FaultKind::kRefused, device_,
                  "another program controls the camera (a program that died keeps it until the camera's "
                  "heartbeat timeout): " +
                      error.message());
    }
    std::this_thread::sleep_for(std::chrono::milliseconds(200));
  }
}

void CameraSession::read_info() {
  info_.vendor = features_->text_or_empty("DeviceVendorName");
  info_.model = features_->text_or_empty("DeviceModelName");
  info_.serial = features_->text_or_empty("DeviceSerialNumber");
  if (info_.serial.empty()) info_.serial = features_->text_or_empty("DeviceID");
  info_.firmware = features_->text_or_empty("DeviceFirmwareVersion");
  if (info_.firmware.empty()) info_.firmware = features_->text_or_empty("DeviceVersion");
  info_.width = format_.width;
  info_.height = format_.height;

  features_->require("ExposureTime", kTriggerPurpose);
  if (features_->offers("ExposureAuto", "Off")) features_->set_text("ExposureAuto", "Off");
  GErrorSlot error;
  double min_us = 0;
  double max_us = 0;
  arv_camera_get_float_bounds(camera_.get(), "ExposureTime", &min_us, &max_us, error.out());
  features_->check(error.get(), "read the bounds of ExposureTime");
  exposure_range_ = {min_us * kMicrosecond, max_us * kMicrosecond};

  const guint64 ticks = arv_gv_device_get_timestamp_tick_frequency(
      ARV_GV_DEVICE(arv_camera_get_device(camera_.get())), error.out());
  if (!error && ticks > 0) ticks_per_s_ = ticks;
}

void CameraSession::select_software_trigger() {
  for (const char* feature : {"TriggerMode", "TriggerSource", "TriggerSoftware", "AcquisitionStart"}) {
    features_->require(feature, kTriggerPurpose);
  }
  if (features_->offers("AcquisitionMode")) features_->set_text("AcquisitionMode", "Continuous");
  if (features_->offers("TriggerSelector")) features_->set_text("TriggerSelector", "FrameStart");
  features_->set_text("TriggerMode", "On");
  features_->set_text("TriggerSource", "Software");
}

void CameraSession::enable_chunks() {
  if (!features_->offers("ChunkModeActive") || !features_->offers("ChunkSelector")) return;
  features_->set_boolean("ChunkModeActive", true);
  const auto enable = [this](const char* entry) {
    if (!features_->offers("ChunkSelector", entry)) return false;
    features_->set_text("ChunkSelector", entry);
    features_->set_boolean("ChunkEnable", true);
    return true;
  };
  has_id_chunk_ = enable("FrameID");
  has_timestamp_chunk_ = enable("Timestamp");
  has_exposure_chunk_ = enable("ExposureTime");
  chunks_.reset(arv_camera_create_chunk_parser(camera_.get()));
}

bool CameraSession::on_loopback() const {
  GSocketAddress* address =
      arv_gv_device_get_device_address(ARV_GV_DEVICE(arv_camera_get_device(camera_.get())));
  return address && G_IS_INET_SOCKET_ADDRESS(address) &&
         g_inet_address_get_is_loopback(g_inet_socket_address_get_address(G_INET_SOCKET_ADDRESS(address)));
}

void CameraSession::set_packet_size(int requested) {
  GErrorSlot error;
  if (requested > 0) {
    arv_camera_gv_set_packet_size(camera_.get(), requested, error.out());
    features_->check(error.get(), "set the packet size to " + std::to_string(requested));
    const int actual = static_cast<int>(arv_camera_gv_get_packet_size(camera_.get(), error.out()));
    features_->check(error.get(), "read the packet size");
    if (actual != requested) {
      throw_fault(FaultKind::kRefused, device_,
                  "the camera made packets of " + std::to_string(actual) + " bytes of the requested " +
                      std::to_string(requested));
    }
    return;
  }
  if (on_loopback()) {
    gint64 min = 0;
    gint64 max = kLoopbackPacketBytes;
    if (features_->offers("GevSCPSPacketSize")) {
      arv_camera_get_integer_bounds(camera_.get(), "GevSCPSPacketSize", &min, &max, error.out());
      features_->check(error.get(), "read the bounds of GevSCPSPacketSize");
    }
    const auto size = static_cast<int>(std::min<gint64>(max, kLoopbackPacketBytes)) & ~3;
    arv_camera_gv_set_packet_size(camera_.get(), size, error.out());
    features_->check(error.get(), "set the packet size to " + std::to_string(size));
    return;
  }
  // Sends test packets of growing size; a camera that cannot do that gets the size that always fits.
  arv_camera_gv_auto_packet_size(camera_.get(), error.out());
  if (error) {
    arv_camera_gv_set_packet_size(camera_.get(), kSafePacketBytes, error.out());
    features_->check(error.get(), "set the packet size to " + std::to_string(kSafePacketBytes));
  }
}

size_t CameraSession::payload_bytes() const {
  const int64_t payload = features_->integer("PayloadSize");
  const auto least = static_cast<int64_t>(format_.image_bytes());
  if (payload < least || payload > least + static_cast<int64_t>(kMaxChunkBytes)) {
    throw_fault(FaultKind::kProtocol, device_,
                "PayloadSize is " + std::to_string(payload) + ", expected " + std::to_string(least) +
                    " bytes for " + std::to_string(format_.width) + " x " + std::to_string(format_.height) +
                    " pixels of Coord3D_ABC32f, and chunks");
  }
  return static_cast<size_t>(payload);
}

double CameraSession::trigger(double exposure_s, double limit_s) {
  const auto end = std::chrono::steady_clock::now() + std::chrono::duration<double>(limit_s);
  features_->set_number("ExposureTime", exposure_s / kMicrosecond);
  const double actual_s = features_->number("ExposureTime") * kMicrosecond;
  while (!features_->execute_unless_busy("TriggerSoftware")) {
    if (std::chrono::steady_clock::now() > end) {
      throw_fault(FaultKind::kTimeout, device_, "the camera is busy and takes no trigger");
    }
    std::this_thread::sleep_for(kBusyPause);
  }
  return actual_s;
}

CameraSession::FrameFacts CameraSession::facts(ArvBuffer* buffer) const {
  FrameFacts facts{};
  const bool readable = chunks_ && arv_buffer_has_chunks(buffer);
  const auto integer_chunk = [&](bool enabled, const char* name) -> std::optional<uint64_t> {
    if (!enabled || !readable) return std::nullopt;
    GErrorSlot error;
    const gint64 value = arv_chunk_parser_get_integer_value(chunks_.get(), buffer, name, error.out());
    if (error) return std::nullopt;
    return static_cast<uint64_t>(value);
  };
  const auto id = integer_chunk(has_id_chunk_, "ChunkFrameID");
  facts.id = id.value_or(arv_buffer_get_frame_id(buffer));
  facts.id_is_16_bit = !id && facts.id <= 0xFFFF;

  facts.timestamp_ns = arv_buffer_get_timestamp(buffer);
  if (const auto ticks = integer_chunk(has_timestamp_chunk_, "ChunkTimestamp")) {
    constexpr uint64_t kNanoseconds = 1'000'000'000;
    // Seconds and the rest apart: ticks * 1e9 would overflow within minutes.
    facts.timestamp_ns =
        *ticks / ticks_per_s_ * kNanoseconds + *ticks % ticks_per_s_ * kNanoseconds / ticks_per_s_;
  }
  if (has_exposure_chunk_ && readable) {
    GErrorSlot error;
    const double exposure_us =
        arv_chunk_parser_get_float_value(chunks_.get(), buffer, "ChunkExposureTime", error.out());
    if (!error) facts.exposure_s = exposure_us * kMicrosecond;
  }
  return facts;
}

Result<std::span<const std::byte>> CameraSession::image(ArvBuffer* buffer) const {
  const ArvBufferPayloadType payload = arv_buffer_get_payload_type(buffer);
  if (payload != ARV_BUFFER_PAYLOAD_TYPE_IMAGE && payload != ARV_BUFFER_PAYLOAD_TYPE_EXTENDED_CHUNK_DATA) {
    return fault(FaultKind::kProtocol, device_,
                 "a frame came with payload type " + std::to_string(payload) + ", expected an image");
  }
  if (arv_buffer_get_image_pixel_format(buffer) != ARV_PIXEL_FORMAT_COORD3D_ABC_32F ||
      arv_buffer_get_image_width(buffer) != format_.width ||
      arv_buffer_get_image_height(buffer) != format_.height) {
    return fault(FaultKind::kProtocol, device_,
                 "a frame came with " + std::to_string(arv_buffer_get_image_width(buffer)) + " x " +
                     std::to_string(arv_buffer_get_image_height(buffer)) + " pixels of format " +
                     std::to_string(arv_buffer_get_image_pixel_format(buffer)) + ", expected " +
                     std::to_string(format_.width) + " x " + std::to_string(format_.height) +
                     " of Coord3D_ABC32f");
  }
  size_t bytes = 0;
  const void* data = arv_buffer_get_image_data(buffer, &bytes);  // The size includes a tail of chunks.
  if (!data || bytes < format_.image_bytes()) {
    return fault(FaultKind::kDataLoss, device_,
                 "a frame came with " + std::to_string(bytes) + " bytes, expected " +
                     std::to_string(format_.image_bytes()));
  }
  return std::span(static_cast<const std::byte*>(data), format_.image_bytes());
}

}  // namespace gantry
