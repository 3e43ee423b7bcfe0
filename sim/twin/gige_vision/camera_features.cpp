#include "camera_features.h"

#include <algorithm>
#include <bit>
#include <cstdio>

#include "device_registers.h"
#include "genicam_xml.h"

namespace gantry::gige {
namespace {

constexpr uint32_t kMinHeartbeatMs = 500;
constexpr uint32_t kDefaultHeartbeatMs = 3000;
constexpr uint64_t kTicksPerSecond = 1'000'000'000;

// The standard numbers bits from the most significant one.
constexpr uint32_t bit(int number) {
  return 0x80000000u >> number;
}

constexpr uint32_t kFireTestPacket = bit(0);
constexpr uint32_t kDoNotFragment = bit(1);
constexpr uint32_t kExtendedIds = bit(1);           // Of GVSP Configuration.
constexpr uint32_t kExtendedStatusCodes = bit(29);  // Of GVCP Configuration.
constexpr uint32_t kTimestampLatch = bit(30);
constexpr uint32_t kTimestampReset = bit(31);

/// Registers that shape the payload or its transport: fixed while acquisition runs.
bool locked_during_acquisition(uint32_t address) {
  using namespace address;
  switch (address) {
    case kStreamPacketSize:
    case kStreamAddress:
    case kGvspConfiguration:
    case kWidth:
    case kHeight:
    case kOffsetX:
    case kOffsetY:
    case kPixelFormat:
    case kAcquisitionMode:
    case kChunkModeActive:
    case kChunkEnable:
    case kChunkEnable + 4:
    case kChunkEnable + 8:
      return true;
    default:
      return false;
  }
}

}  // namespace

CameraFeatures::CameraFeatures(const GigeVisionOptions& options, uint32_t ip, DeviceClock& clock,
                               StreamSender& sender, Acquisition& acquisition)
    : options_(options), clock_(clock), sender_(sender), acquisition_(acquisition) {
  lay_out(options, ip);
  acquisition_.configure(settings());
}

void CameraFeatures::lay_out(const GigeVisionOptions& options, uint32_t ip) {
  using namespace address;
  const std::string xml = genicam_xml(options);
  memory_.add_block(kVersion, kDiscoverySize);
  memory_.add_block(kFirstUrl, 0x400);
  memory_.add_block(kInterfaceCount, 4);
  memory_.add_block(kMessageChannelCount, 0x14);
  memory_.add_block(kGvspCapability, 0x40);
  memory_.add_block(kControlPrivilege, 0x18);
  memory_.add_block(kStreamPort, 0x28);
  memory_.add_block(kFeatures, kFeaturesEnd - kFeatures);
  memory_.add_block(kXml, static_cast<uint32_t>(xml.size()));

  memory_.set_u32(kVersion, 0x00020000);
  memory_.set_u32(kDeviceMode, bit(0) | 1);  // Big-endian transmitter, one link, UTF-8.
  // A locally administered address that is unique per loopback address.
  memory_.set_u32(kMacHigh, 0x0200);
  memory_.set_u32(kMacLow, ip);
  memory_.set_u32(kNetworkCapability, bit(29) | bit(30));
  memory_.set_u32(kNetworkConfiguration, bit(29) | bit(30));
  memory_.set_u32(kCurrentIp, ip);
  memory_.set_u32(kCurrentSubnet, 0xFF000000);
  memory_.set_text(kManufacturerName, options.vendor, 32);
  memory_.set_text(kModelName, options.model, 32);
  memory_.set_text(kDeviceVersion, "1.0", 32);
  memory_.set_text(kManufacturerInfo, "simulated 3D camera", 48);
  memory_.set_text(kSerialNumber, options.serial, 16);
  char url[64];
  std::snprintf(url, sizeof url, "Local:camera.xml;%X;%zX", kXml, xml.size());
  memory_.set_text(kFirstUrl, url, 512);
  memory_.set_text(kSecondUrl, "", 512);
  memory_.set_bytes(kXml, std::span(reinterpret_cast<const uint8_t*>(xml.data()), xml.size()));

  memory_.set_u32(kInterfaceCount, 1);
  memory_.set_u32(kStreamChannelCount, 1);
  memory_.set_u32(kActiveLinkCount, 1);
  memory_.set_u32(kGvspCapability, bit(0) | bit(1));  // Source port register; 16-bit block ids too.
  // Serial number, application port and address, extended status codes, resend, WRITEMEM, concatenation.
  memory_.set_u32(kGvcpCapability, bit(1) | bit(4) | bit(9) | bit(29) | bit(30) | bit(31));
  memory_.set_u32(kHeartbeatTimeout, kDefaultHeartbeatMs);
  memory_.set_u64(kTickFrequency, kTicksPerSecond);
  memory_.set_u32(kPendingTimeout, 100);
  memory_.set_u32(kLinkCapability, bit(31));
  memory_.set_u32(kStreamPacketSize, 1500);
  memory_.set_u32(kStreamSourcePort, sender_.source_port());
  // This camera knows the extended chunk payload only, so that it is always enabled.
  memory_.set_u32(kStreamCapability, bit(31));
  memory_.set_u32(kStreamConfiguration, bit(31));

  const auto width = static_cast<uint32_t>(options.width);
  const auto height = static_cast<uint32_t>(options.height);
  memory_.set_u32(kSensorWidth, width);
  memory_.set_u32(kSensorHeight, height);
  memory_.set_u32(kWidth, width);
  memory_.set_u32(kHeight, height);
  memory_.set_u32(kPixelFormat, kCoord3dAbc32f);
  memory_.set_f32(kAcquisitionFrameRate, 1);
  memory_.set_f32(kExposureTime, static_cast<float>(options.default_exposure_us));
  memory_.set_text(kFirmwareVersion, options.firmware, 32);
  for (uint32_t i = 0; i < 3; ++i) {
    memory_.set_f32(kCoordinateScale + 4 * i, options.coordinates[i].scale);
    memory_.set_f32(kCoordinateOffset + 4 * i, options.coordinates[i].offset_mm);
    memory_.set_u32(kInvalidDataFlag + 4 * i, 1);
    memory_.set_f32(kInvalidDataValue + 4 * i, options.coordinates[i].invalid_value);
  }
  memory_.set_f32(kFocalLength, static_cast<float>(options.focal_length_px));
  memory_.set_f32(kPrincipalPointU, static_cast<float>(options.principal_u));
  memory_.set_f32(kPrincipalPointV, static_cast<float>(options.principal_v));

  for (const uint32_t writable : {kHeartbeatTimeout,
                                  kTimestampControl,
                                  kGvcpConfiguration,
                                  kGvspConfiguration,
                                  kStreamPort,
                                  kStreamPacketSize,
                                  kStreamPacketDelay,
                                  kStreamAddress,
                                  kWidth,
                                  kHeight,
                                  kOffsetX,
                                  kOffsetY,
                                  kPixelFormat,
                                  kAcquisitionMode,
                                  kAcquisitionStart,
                                  kAcquisitionStop,
                                  kAcquisitionFrameRate,
                                  kTriggerSelector,
                                  kTriggerMode,
                                  kTriggerSource,
                                  kTriggerSoftware,
                                  kExposureTime,
                                  kCoordinateSelector,
                                  kChunkModeActive,
                                  kChunkSelector,
                                  kChunkEnable,
                                  kChunkEnable + 4,
                                  kChunkEnable + 8}) {
    memory_.allow_write(writable);
  }
}

GvcpStatus CameraFeatures::read(uint32_t address, std::span<uint8_t> out) {
  const Region region = settings().region;
  memory_.set_u32(address::kPayloadSize, region.width * region.height * 12 + chunks().overhead());
  memory_.set_f32(address::kDeviceTemperature, acquisition_.temperature_c());
  return memory_.read(address, out);
}

GvcpStatus CameraFeatures::write(uint32_t address, uint32_t value) {
  if (const auto status = memory_.check_write(address); status != GvcpStatus::kSuccess) return status;
  if (locked_during_acquisition(address) && acquisition_.active()) return GvcpStatus::kAccessDenied;
  return address < address::kFeatures ? write_bootstrap(address, value) : write_feature(address, value);
}

GvcpStatus CameraFeatures::write_bootstrap(uint32_t address, uint32_t value) {
  using namespace address;
  switch (address) {
    case kHeartbeatTimeout:
      memory_.set_u32(address, std::max(value, kMinHeartbeatMs));
      break;
    case kTimestampControl:
      if (value & kTimestampReset) clock_.reset();
      if (value & kTimestampLatch) memory_.set_u64(kTimestampValue, clock_.now_ns());
      break;
    case kGvcpConfiguration:
      memory_.set_u32(address, value & kExtendedStatusCodes);
      break;
    case kGvspConfiguration:
      memory_.set_u32(address, value & kExtendedIds);
      break;
    case kStreamPort:
      // Opening and closing both begin with a clean channel.
      sender_.clear();
      acquisition_.reset_block_id();
      memory_.set_u32(address, value & 0xFFFF);
      break;
    case kStreamPacketSize:
      return write_packet_size(value);
    case kStreamAddress:
      // The twin streams on this machine only: to loopback, or to the address that its controller uses
      // (the command came over loopback, so that it is an address of this machine).
      if (value != 0 && value >> 24 != 127 && value != memory_.u32(kPrimaryIp)) {
        return GvcpStatus::kInvalidParameter;
      }
      memory_.set_u32(address, value);
      break;
    case kStreamPacketDelay:
      memory_.set_u32(address, value);
      break;
    default:
      return GvcpStatus::kWriteProtect;
  }
  acquisition_.configure(settings());
  return GvcpStatus::kSuccess;
}

GvcpStatus CameraFeatures::write_packet_size(uint32_t value) {
  const uint32_t asked = value & 0xFFFF;
  const uint32_t rounded = std::clamp(asked / 4 * 4, kMinPacketSize, kMaxPacketSize);
  memory_.set_u32(address::kStreamPacketSize, (value & kDoNotFragment) | rounded);
  acquisition_.configure(settings());
  // No test packet for a size that is not supported.
  if ((value & kFireTestPacket) && asked == rounded && stream_format().open()) {
    sender_.send_test_packet(stream_format());
  }
  return GvcpStatus::kSuccess;
}

GvcpStatus CameraFeatures::write_feature(uint32_t address, uint32_t value) {
  using namespace address;
  const auto width = static_cast<uint32_t>(options_.width);
  const auto height = static_cast<uint32_t>(options_.height);
  switch (address) {
    case kWidth:
      return write_extent(address, value, kMinRegion, width - memory_.u32(kOffsetX));
    case kHeight:
      return write_extent(address, value, kMinRegion, height - memory_.u32(kOffsetY));
    case kOffsetX:
      return write_extent(address, value, 0, width - memory_.u32(kWidth));
    case kOffsetY:
      return write_extent(address, value, 0, height - memory_.u32(kHeight));
    case kPixelFormat:
      return write_extent(address, value, kCoord3dAbc32f, kCoord3dAbc32f);
    case kTriggerSelector:
    case kTriggerSource:
      return write_choice(address, value, 1);
    case kAcquisitionMode:
    case kTriggerMode:
    case kChunkModeActive:
    case kChunkEnable:
    case kChunkEnable + 4:
    case kChunkEnable + 8:
      return write_choice(address, value, 2);
    case kCoordinateSelector:
    case kChunkSelector:
      return write_choice(address, value, 3);
    case kExposureTime:
      return write_number(address, value, options_.min_exposure_us, options_.max_exposure_us);
    case kAcquisitionFrameRate:
      return write_number(address, value, kMinFrameRateHz, kMaxFrameRateHz);
    default:
      break;
  }
  // What is left are commands.
  if (value != 1) return GvcpStatus::kInvalidParameter;
  switch (address) {
    case kAcquisitionStart:
      acquisition_.start();
      return GvcpStatus::kSuccess;
    case kAcquisitionStop:
      acquisition_.stop();
      return GvcpStatus::kSuccess;
    case kTriggerSoftware:
      return acquisition_.trigger();
    default:
      return GvcpStatus::kWriteProtect;
  }
}

GvcpStatus CameraFeatures::write_choice(uint32_t address, uint32_t value, uint32_t count) {
  return write_extent(address, value, 0, count - 1);
}

GvcpStatus CameraFeatures::write_extent(uint32_t address, uint32_t value, uint32_t min, uint32_t max) {
  if (value < min || value > max) return GvcpStatus::kInvalidParameter;
  memory_.set_u32(address, value);
  acquisition_.configure(settings());
  return GvcpStatus::kSuccess;
}

GvcpStatus CameraFeatures::write_number(uint32_t address, uint32_t value, double min, double max) {
  const auto number = std::bit_cast<float>(value);
  // The limits as the client's single precision sees them; written so that NaN fails.
  if (!(number >= static_cast<float>(min) && number <= static_cast<float>(max))) {
    return GvcpStatus::kInvalidParameter;
  }
  memory_.set_u32(address, value);
  acquisition_.configure(settings());
  return GvcpStatus::kSuccess;
}

void CameraFeatures::show_privilege(uint32_t privilege, Endpoint primary) {
  memory_.set_u32(address::kControlPrivilege, privilege);
  memory_.set_u32(address::kPrimaryPort, primary.port);
  memory_.set_u32(address::kPrimaryIp, primary.ip);
}

void CameraFeatures::close_stream() {
  acquisition_.stop();
  memory_.set_u32(address::kStreamPort, 0);
  memory_.set_u32(address::kStreamAddress, 0);
  acquisition_.configure(settings());
  sender_.clear();
}

uint32_t CameraFeatures::heartbeat_timeout_ms() const {
  return memory_.u32(address::kHeartbeatTimeout);
}

StreamFormat CameraFeatures::stream_format() const {
  using namespace address;
  const uint32_t size = memory_.u32(kStreamPacketSize);
  return {.destination = {memory_.u32(kStreamAddress), static_cast<uint16_t>(memory_.u32(kStreamPort))},
          .packet_size = size & 0xFFFF,
          .packet_delay_ns = memory_.u32(kStreamPacketDelay),
          .do_not_fragment = (size & kDoNotFragment) != 0,
          .extended_ids = (memory_.u32(kGvspConfiguration) & kExtendedIds) != 0,
          .mark_resends = (memory_.u32(kGvcpConfiguration) & kExtendedStatusCodes) != 0};
}

std::vector<uint8_t> CameraFeatures::discovery() const {
  std::vector<uint8_t> answer(address::kDiscoverySize);
  memory_.read(address::kVersion, answer);
  return answer;
}

ChunkLayout CameraFeatures::chunks() const {
  using namespace address;
  return {.active = memory_.u32(kChunkModeActive) != 0,
          .frame_id = memory_.u32(kChunkEnable) != 0,
          .timestamp = memory_.u32(kChunkEnable + 4) != 0,
          .exposure_time = memory_.u32(kChunkEnable + 8) != 0};
}

AcquisitionSettings CameraFeatures::settings() const {
  using namespace address;
  return {.trigger_on = memory_.u32(kTriggerMode) != 0,
          .single_frame = memory_.u32(kAcquisitionMode) != 0,
          .exposure_us = memory_.f32(kExposureTime),
          .frame_period_s = 1 / memory_.f32(kAcquisitionFrameRate),
          .region = {memory_.u32(kOffsetX), memory_.u32(kOffsetY), memory_.u32(kWidth), memory_.u32(kHeight)},
          .chunks = chunks(),
          .stream = stream_format()};
}

}  // namespace gantry::gige
