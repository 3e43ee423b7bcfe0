#pragma once

#include <cstdint>

/// Where everything stands in the camera's memory. The bootstrap registers are the standard's, the others
/// (from 0xA000) are this camera's own: the GenICam description tells clients where they are.
namespace gantry::gige::address {

// Bootstrap registers, GigE Vision 2.0, section 28. The first 0xF8 bytes are also the discovery answer.
inline constexpr uint32_t kVersion = 0x0000;
inline constexpr uint32_t kDeviceMode = 0x0004;
inline constexpr uint32_t kMacHigh = 0x0008;
inline constexpr uint32_t kMacLow = 0x000C;
inline constexpr uint32_t kNetworkCapability = 0x0010;
inline constexpr uint32_t kNetworkConfiguration = 0x0014;
inline constexpr uint32_t kCurrentIp = 0x0024;
inline constexpr uint32_t kCurrentSubnet = 0x0034;
inline constexpr uint32_t kManufacturerName = 0x0048;
inline constexpr uint32_t kModelName = 0x0068;
inline constexpr uint32_t kDeviceVersion = 0x0088;
inline constexpr uint32_t kManufacturerInfo = 0x00A8;
inline constexpr uint32_t kSerialNumber = 0x00D8;
inline constexpr uint32_t kDiscoverySize = 0x00F8;
inline constexpr uint32_t kFirstUrl = 0x0200;
inline constexpr uint32_t kSecondUrl = 0x0400;
inline constexpr uint32_t kInterfaceCount = 0x0600;
inline constexpr uint32_t kMessageChannelCount = 0x0900;
inline constexpr uint32_t kStreamChannelCount = 0x0904;
inline constexpr uint32_t kActiveLinkCount = 0x0910;
inline constexpr uint32_t kGvspCapability = 0x092C;
inline constexpr uint32_t kGvcpCapability = 0x0934;
inline constexpr uint32_t kHeartbeatTimeout = 0x0938;
inline constexpr uint32_t kTickFrequency = 0x093C;
inline constexpr uint32_t kTimestampControl = 0x0944;
inline constexpr uint32_t kTimestampValue = 0x0948;
inline constexpr uint32_t kGvcpConfiguration = 0x0954;
inline constexpr uint32_t kPendingTimeout = 0x0958;
inline constexpr uint32_t kGvspConfiguration = 0x0960;
inline constexpr uint32_t kLinkCapability = 0x0964;
inline constexpr uint32_t kLinkConfiguration = 0x0968;
inline constexpr uint32_t kControlPrivilege = 0x0A00;
inline constexpr uint32_t kPrimaryPort = 0x0A04;
inline constexpr uint32_t kPrimaryIp = 0x0A14;
inline constexpr uint32_t kStreamPort = 0x0D00;           ///< SCP
inline constexpr uint32_t kStreamPacketSize = 0x0D04;     ///< SCPS
inline constexpr uint32_t kStreamPacketDelay = 0x0D08;    ///< SCPD
inline constexpr uint32_t kStreamAddress = 0x0D18;        ///< SCDA
inline constexpr uint32_t kStreamSourcePort = 0x0D1C;     ///< SCSP
inline constexpr uint32_t kStreamCapability = 0x0D20;     ///< SCC
inline constexpr uint32_t kStreamConfiguration = 0x0D24;  ///< SCCFG

// Features of this camera; all are one 32-bit word (integer or float) unless said otherwise.
inline constexpr uint32_t kFeatures = 0xA000;
inline constexpr uint32_t kSensorWidth = 0xA000;
inline constexpr uint32_t kSensorHeight = 0xA004;
inline constexpr uint32_t kWidth = 0xA008;
inline constexpr uint32_t kHeight = 0xA00C;
inline constexpr uint32_t kOffsetX = 0xA010;
inline constexpr uint32_t kOffsetY = 0xA014;
inline constexpr uint32_t kPixelFormat = 0xA018;
inline constexpr uint32_t kPayloadSize = 0xA01C;
inline constexpr uint32_t kAcquisitionMode = 0xA020;
inline constexpr uint32_t kAcquisitionStart = 0xA024;
inline constexpr uint32_t kAcquisitionStop = 0xA028;
inline constexpr uint32_t kAcquisitionFrameRate = 0xA02C;
inline constexpr uint32_t kTriggerSelector = 0xA030;
inline constexpr uint32_t kTriggerMode = 0xA034;
inline constexpr uint32_t kTriggerSource = 0xA038;
inline constexpr uint32_t kTriggerSoftware = 0xA03C;
inline constexpr uint32_t kExposureTime = 0xA040;
inline constexpr uint32_t kDeviceTemperature = 0xA044;
inline constexpr uint32_t kFirmwareVersion = 0xA048;  ///< 32 bytes.
inline constexpr uint32_t kCoordinateSelector = 0xA080;
inline constexpr uint32_t kDistanceUnit = 0xA084;
inline constexpr uint32_t kCoordinateSystem = 0xA088;
inline constexpr uint32_t kOutputMode = 0xA08C;
inline constexpr uint32_t kCoordinateScale = 0xA090;   ///< Three words: A, B, C.
inline constexpr uint32_t kCoordinateOffset = 0xA0A0;  ///< Three words.
inline constexpr uint32_t kInvalidDataFlag = 0xA0B0;   ///< Three words.
inline constexpr uint32_t kInvalidDataValue = 0xA0C0;  ///< Three words.
inline constexpr uint32_t kFocalLength = 0xA0D0;
inline constexpr uint32_t kPrincipalPointU = 0xA0D4;  ///< Of the whole sensor.
inline constexpr uint32_t kPrincipalPointV = 0xA0D8;
inline constexpr uint32_t kChunkModeActive = 0xA0E0;
inline constexpr uint32_t kChunkSelector = 0xA0E4;
inline constexpr uint32_t kChunkEnable = 0xA0E8;  ///< Three words: FrameID, Timestamp, ExposureTime.
inline constexpr uint32_t kFeaturesEnd = 0xA100;

inline constexpr uint32_t kXml = 0x00100000;

}  // namespace gantry::gige::address

namespace gantry::gige {

inline constexpr uint32_t kCoord3dAbc32f = 0x026000C0;  ///< PFNC: three 32-bit floats per pixel.

/// The packet size counts the IP, UDP and GVSP headers. 576 must always work; the other end is what a
/// UDP datagram can carry over loopback.
inline constexpr uint32_t kMinPacketSize = 576;
inline constexpr uint32_t kMaxPacketSize = 65500;
inline constexpr uint32_t kMinRegion = 8;  ///< Pixels, in each direction.
inline constexpr double kMinFrameRateHz = 0.01;
inline constexpr double kMaxFrameRateHz = 30;

/// The tags of the chunks in the payload.
inline constexpr uint32_t kChunkImage = 1;
inline constexpr uint32_t kChunkFrameId = 2;
inline constexpr uint32_t kChunkTimestamp = 3;
inline constexpr uint32_t kChunkExposureTime = 4;

}  // namespace gantry::gige
