#include "genicam_xml.h"

#include <spdlog/fmt/fmt.h>

#include <cctype>
#include <initializer_list>
#include <string_view>
#include <utility>
#include <vector>

#include "device_registers.h"

namespace gantry::gige {
namespace {

using Entries = std::vector<std::pair<std::string_view, int64_t>>;

constexpr std::string_view kReadOnly = "RO";
constexpr std::string_view kReadWrite = "RW";
constexpr std::string_view kWriteOnly = "WO";

/// Writes GenApi nodes. A feature is a node with a public name in a category; the register behind it is a
/// second node, NAME with "Reg" behind it, where the feature needs more than the bare word.
class Description {
 public:
  /// Features named in `features` show under this heading.
  void category(std::string_view name, std::initializer_list<std::string_view> features) {
    line(R"(<Category Name="{}" NameSpace="Standard">)", name);
    for (const auto feature : features) line("  <pFeature>{}</pFeature>", feature);
    line("</Category>");
  }

  void text(std::string_view name, uint32_t address, int size) {
    line(R"(<StringReg Name="{}" NameSpace="Standard">)", name);
    address_of(address, size, kReadOnly);
    line("</StringReg>");
  }

  void integer_register(std::string_view name, uint32_t address, std::string_view access, int size = 4,
                        std::string_view index = {}) {
    line(R"(<IntReg Name="{}">)", name);
    address_of(address, size, access, index);
    line("  <Sign>Unsigned</Sign>");
    line("  <Endianess>BigEndian</Endianess>");
    line("</IntReg>");
  }

  /// `limits`: Min, Max, Inc or pMin, pMax elements.
  void integer(std::string_view name, uint32_t address, std::string_view access, std::string_view limits = {},
               int size = 4, std::string_view unit = {}) {
    const std::string reg = fmt::format("{}Reg", name);
    line(R"(<Integer Name="{}" NameSpace="Standard">)", name);
    line("  <pValue>{}</pValue>", reg);
    if (!limits.empty()) line("  {}", limits);
    if (!unit.empty()) line("  <Unit>{}</Unit>", unit);
    line("</Integer>");
    integer_register(reg, address, access, size);
  }

  /// Bits `lsb` to `msb` of a bootstrap register, counted as GigE Vision does: bit 0 is the most significant.
  void bits(std::string_view name, uint32_t address, int msb, int lsb, std::string_view access,
            std::string_view limits = {}) {
    const std::string reg = fmt::format("{}Reg", name);
    line(R"(<Integer Name="{}" NameSpace="Standard">)", name);
    line("  <pValue>{}</pValue>", reg);
    if (!limits.empty()) line("  {}", limits);
    line("</Integer>");
    bits_register(reg, address, msb, lsb, access);
  }

  void bits_register(std::string_view name, uint32_t address, int msb, int lsb, std::string_view access) {
    line(R"(<MaskedIntReg Name="{}">)", name);
    address_of(address, 4, access);
    line("  <LSB>{}</LSB>", lsb);
    line("  <MSB>{}</MSB>", msb);
    line("  <Sign>Unsigned</Sign>");
    line("  <Endianess>BigEndian</Endianess>");
    line("</MaskedIntReg>");
  }

  /// `index`: the register node that selects one of several consecutive words.
  void floating(std::string_view name, uint32_t address, std::string_view access, std::string_view unit = {},
                std::string_view index = {}, std::string_view limits = {}) {
    const std::string reg = fmt::format("{}Reg", name);
    line(R"(<Float Name="{}" NameSpace="Standard">)", name);
    line("  <pValue>{}</pValue>", reg);
    if (!limits.empty()) line("  {}", limits);
    if (!unit.empty()) line("  <Unit>{}</Unit>", unit);
    line("</Float>");
    floating_register(reg, address, access, index);
  }

  void floating_register(std::string_view name, uint32_t address, std::string_view access,
                         std::string_view index = {}) {
    line(R"(<FloatReg Name="{}">)", name);
    address_of(address, 4, access, index);
    line("  <Endianess>BigEndian</Endianess>");
    line("</FloatReg>");
  }

  void boolean(std::string_view name, uint32_t address, std::string_view access,
               std::string_view index = {}) {
    const std::string reg = fmt::format("{}Reg", name);
    line(R"(<Boolean Name="{}" NameSpace="Standard">)", name);
    line("  <pValue>{}</pValue>", reg);
    line("  <OnValue>1</OnValue>");
    line("  <OffValue>0</OffValue>");
    line("</Boolean>");
    integer_register(reg, address, access, 4, index);
  }

  /// The register behind it is not written here (see integer_register, bits_register).
  void enumeration_of(std::string_view name, std::string_view reg, const Entries& entries,
                      std::initializer_list<std::string_view> selected = {}) {
    line(R"(<Enumeration Name="{}" NameSpace="Standard">)", name);
    for (const auto& [entry, value] : entries) {
      line(R"(  <EnumEntry Name="{}" NameSpace="Standard"><Value>{}</Value></EnumEntry>)", entry, value);
    }
    line("  <pValue>{}</pValue>", reg);
    for (const auto feature : selected) line("  <pSelected>{}</pSelected>", feature);
    line("</Enumeration>");
  }

  void enumeration(std::string_view name, uint32_t address, std::string_view access, const Entries& entries,
                   std::initializer_list<std::string_view> selected = {}) {
    const std::string reg = fmt::format("{}Reg", name);
    enumeration_of(name, reg, entries, selected);
    integer_register(reg, address, access);
  }

  void command(std::string_view name, uint32_t address, int64_t value = 1) {
    const std::string reg = fmt::format("{}Reg", name);
    line(R"(<Command Name="{}" NameSpace="Standard">)", name);
    line("  <pValue>{}</pValue>", reg);
    line("  <CommandValue>{}</CommandValue>", value);
    line("</Command>");
    integer_register(reg, address, kWriteOnly);
  }

  void chunk_port(std::string_view name, uint32_t chunk_id) {
    line(R"(<Port Name="{}">)", name);
    line("  <ChunkID>{:x}</ChunkID>", chunk_id);
    line("</Port>");
  }

  template <typename... Arguments>
  void line(fmt::format_string<Arguments...> format, Arguments&&... arguments) {
    text_ += fmt::format(format, std::forward<Arguments>(arguments)...);
    text_ += '\n';
  }

  std::string take() { return std::move(text_); }

 private:
  void address_of(uint32_t address, int size, std::string_view access, std::string_view index = {}) {
    line("  <Address>{:#x}</Address>", address);
    if (!index.empty()) line(R"(  <pIndex Offset="4">{}</pIndex>)", index);
    line("  <Length>{}</Length>", size);
    line("  <AccessMode>{}</AccessMode>", access);
    line("  <pPort>Device</pPort>");
    line("  <Cachable>NoCache</Cachable>");
  }

  std::string text_;
};

/// GenApi wants identifiers there.
std::string identifier(const std::string& name) {
  std::string result;
  for (const char c : name) result += std::isalnum(static_cast<unsigned char>(c)) ? c : '_';
  return result;
}

void device_control(Description& xml) {
  xml.category("DeviceControl",
               {"DeviceVendorName", "DeviceModelName", "DeviceManufacturerInfo", "DeviceVersion",
                "DeviceFirmwareVersion", "DeviceSerialNumber", "DeviceID", "DeviceTemperature"});
  xml.text("DeviceVendorName", address::kManufacturerName, 32);
  xml.text("DeviceModelName", address::kModelName, 32);
  xml.text("DeviceManufacturerInfo", address::kManufacturerInfo, 48);
  xml.text("DeviceVersion", address::kDeviceVersion, 32);
  xml.text("DeviceFirmwareVersion", address::kFirmwareVersion, 32);
  xml.text("DeviceSerialNumber", address::kSerialNumber, 16);
  xml.text("DeviceID", address::kSerialNumber, 16);
  xml.floating("DeviceTemperature", address::kDeviceTemperature, kReadOnly, "C");
}

void image_format_control(Description& xml) {
  xml.category("ImageFormatControl", {"SensorWidth", "SensorHeight", "WidthMax", "HeightMax", "Width",
                                      "Height", "OffsetX", "OffsetY", "PixelFormat"});
  xml.integer("SensorWidth", address::kSensorWidth, kReadOnly);
  xml.integer("SensorHeight", address::kSensorHeight, kReadOnly);
  xml.integer("WidthMax", address::kSensorWidth, kReadOnly);
  xml.integer("HeightMax", address::kSensorHeight, kReadOnly);
  const auto difference = [&xml](std::string_view name, std::string_view whole, std::string_view part) {
    xml.line(R"(<IntSwissKnife Name="{}">)", name);
    xml.line(R"(  <pVariable Name="WHOLE">{}</pVariable>)", whole);
    xml.line(R"(  <pVariable Name="PART">{}</pVariable>)", part);
    xml.line("  <Formula>WHOLE - PART</Formula>");
    xml.line("</IntSwissKnife>");
  };
  difference("WidthLimit", "SensorWidthReg", "OffsetXReg");
  difference("HeightLimit", "SensorHeightReg", "OffsetYReg");
  difference("OffsetXLimit", "SensorWidthReg", "WidthReg");
  difference("OffsetYLimit", "SensorHeightReg", "HeightReg");
  const auto between = [](uint32_t min, std::string_view max) {
    return fmt::format("<Min>{}</Min><pMax>{}</pMax><Inc>1</Inc>", min, max);
  };
  xml.integer("Width", address::kWidth, kReadWrite, between(kMinRegion, "WidthLimit"));
  xml.integer("Height", address::kHeight, kReadWrite, between(kMinRegion, "HeightLimit"));
  xml.integer("OffsetX", address::kOffsetX, kReadWrite, between(0, "OffsetXLimit"));
  xml.integer("OffsetY", address::kOffsetY, kReadWrite, between(0, "OffsetYLimit"));
  xml.enumeration("PixelFormat", address::kPixelFormat, kReadWrite, {{"Coord3D_ABC32f", kCoord3dAbc32f}});
}

void acquisition_control(Description& xml, const GigeVisionOptions& options) {
  xml.category("AcquisitionControl",
               {"AcquisitionMode", "AcquisitionStart", "AcquisitionStop", "AcquisitionFrameRate",
                "TriggerSelector", "TriggerMode", "TriggerSource", "TriggerSoftware", "ExposureTime"});
  xml.enumeration("AcquisitionMode", address::kAcquisitionMode, kReadWrite,
                  {{"Continuous", 0}, {"SingleFrame", 1}});
  xml.command("AcquisitionStart", address::kAcquisitionStart);
  xml.command("AcquisitionStop", address::kAcquisitionStop);
  xml.floating("AcquisitionFrameRate", address::kAcquisitionFrameRate, kReadWrite, "Hz", {},
               fmt::format("<Min>{}</Min><Max>{}</Max>", kMinFrameRateHz, kMaxFrameRateHz));
  xml.enumeration("TriggerSelector", address::kTriggerSelector, kReadWrite, {{"FrameStart", 0}},
                  {"TriggerMode", "TriggerSource", "TriggerSoftware"});
  xml.enumeration("TriggerMode", address::kTriggerMode, kReadWrite, {{"Off", 0}, {"On", 1}});
  xml.enumeration("TriggerSource", address::kTriggerSource, kReadWrite, {{"Software", 0}});
  xml.command("TriggerSoftware", address::kTriggerSoftware);
  xml.floating("ExposureTime", address::kExposureTime, kReadWrite, "us", {},
               fmt::format("<Min>{}</Min><Max>{}</Max>", options.min_exposure_us, options.max_exposure_us));
}

void scan3d_control(Description& xml) {
  xml.category("Scan3dControl", {"Scan3dDistanceUnit", "Scan3dCoordinateSystem", "Scan3dOutputMode",
                                 "Scan3dCoordinateSelector", "Scan3dCoordinateScale",
                                 "Scan3dCoordinateOffset", "Scan3dInvalidDataFlag", "Scan3dInvalidDataValue",
                                 "Scan3dFocalLength", "Scan3dPrincipalPointU", "Scan3dPrincipalPointV"});
  xml.enumeration("Scan3dDistanceUnit", address::kDistanceUnit, kReadOnly, {{"Millimeter", 0}});
  xml.enumeration("Scan3dCoordinateSystem", address::kCoordinateSystem, kReadOnly, {{"Cartesian", 0}});
  xml.enumeration("Scan3dOutputMode", address::kOutputMode, kReadOnly, {{"CalibratedABC_Grid", 0}});
  xml.enumeration(
      "Scan3dCoordinateSelector", address::kCoordinateSelector, kReadWrite,
      {{"CoordinateA", 0}, {"CoordinateB", 1}, {"CoordinateC", 2}},
      {"Scan3dCoordinateScale", "Scan3dCoordinateOffset", "Scan3dInvalidDataFlag", "Scan3dInvalidDataValue"});
  constexpr std::string_view kSelector = "Scan3dCoordinateSelectorReg";
  xml.floating("Scan3dCoordinateScale", address::kCoordinateScale, kReadOnly, {}, kSelector);
  xml.floating("Scan3dCoordinateOffset", address::kCoordinateOffset, kReadOnly, "mm", kSelector);
  xml.boolean("Scan3dInvalidDataFlag", address::kInvalidDataFlag, kReadOnly, kSelector);
  xml.floating("Scan3dInvalidDataValue", address::kInvalidDataValue, kReadOnly, {}, kSelector);
  xml.floating("Scan3dFocalLength", address::kFocalLength, kReadOnly, "px");
  // SFNC counts the principal point from the corner of the region, not of the sensor.
  const auto principal_point = [&xml](std::string_view axis, uint32_t address, std::string_view offset) {
    xml.line(R"(<SwissKnife Name="Scan3dPrincipalPoint{}" NameSpace="Standard">)", axis);
    xml.line(R"(  <pVariable Name="SENSOR">SensorPrincipalPoint{}Reg</pVariable>)", axis);
    xml.line(R"(  <pVariable Name="OFFSET">{}</pVariable>)", offset);
    xml.line("  <Formula>SENSOR - OFFSET</Formula>");
    xml.line("  <Unit>px</Unit>");
    xml.line("</SwissKnife>");
    xml.floating_register(fmt::format("SensorPrincipalPoint{}Reg", axis), address, kReadOnly);
  };
  principal_point("U", address::kPrincipalPointU, "OffsetXReg");
  principal_point("V", address::kPrincipalPointV, "OffsetYReg");
}

void chunk_data_control(Description& xml) {
  xml.category("ChunkDataControl", {"ChunkModeActive", "ChunkSelector", "ChunkEnable", "ChunkFrameID",
                                    "ChunkTimestamp", "ChunkExposureTime"});
  xml.boolean("ChunkModeActive", address::kChunkModeActive, kReadWrite);
  xml.enumeration("ChunkSelector", address::kChunkSelector, kReadWrite,
                  {{"FrameID", 0}, {"Timestamp", 1}, {"ExposureTime", 2}}, {"ChunkEnable"});
  xml.boolean("ChunkEnable", address::kChunkEnable, kReadWrite, "ChunkSelectorReg");
  xml.chunk_port("FrameIdPort", kChunkFrameId);
  xml.chunk_port("TimestampPort", kChunkTimestamp);
  xml.chunk_port("ExposureTimePort", kChunkExposureTime);
  const auto chunk = [&xml](std::string_view kind, std::string_view name, std::string_view port) {
    xml.line(R"(<{} Name="{}" NameSpace="Standard">)", kind, name);
    xml.line("  <Address>0</Address>");
    xml.line("  <Length>8</Length>");
    xml.line("  <AccessMode>RO</AccessMode>");
    xml.line("  <pPort>{}</pPort>", port);
    xml.line("  <Cachable>NoCache</Cachable>");
    if (kind == "IntReg") xml.line("  <Sign>Unsigned</Sign>");
    xml.line("  <Endianess>BigEndian</Endianess>");
    xml.line("</{}>", kind);
  };
  chunk("IntReg", "ChunkFrameID", "FrameIdPort");
  chunk("IntReg", "ChunkTimestamp", "TimestampPort");
  chunk("FloatReg", "ChunkExposureTime", "ExposureTimePort");
}

void transport_layer_control(Description& xml) {
  xml.category("TransportLayerControl", {"PayloadSize",
                                         "TLParamsLocked",
                                         "GevVersionMajor",
                                         "GevVersionMinor",
                                         "GevCurrentIPAddress",
                                         "GevCurrentSubnetMask",
                                         "GevStreamChannelCount",
                                         "GevHeartbeatTimeout",
                                         "GevGVCPHeartbeatTimeout",
                                         "GevTimestampTickFrequency",
                                         "GevTimestampControlLatch",
                                         "GevTimestampControlReset",
                                         "GevTimestampValue",
                                         "GevCCP",
                                         "GevStreamChannelSelector",
                                         "GevSCPHostPort",
                                         "GevSCPSFireTestPacket",
                                         "GevSCPSDoNotFragment",
                                         "GevSCPSPacketSize",
                                         "GevSCPD",
                                         "GevSCDA",
                                         "GevSCSP",
                                         "GevGVSPExtendedIDMode"});
  xml.integer("PayloadSize", address::kPayloadSize, kReadOnly, {}, 4, "B");
  xml.line(R"(<Integer Name="TLParamsLocked" NameSpace="Standard">)");
  xml.line("  <Visibility>Invisible</Visibility>");
  xml.line("  <Value>0</Value><Min>0</Min><Max>1</Max>");
  xml.line("</Integer>");
  xml.bits("GevVersionMajor", address::kVersion, 0, 15, kReadOnly);
  xml.bits("GevVersionMinor", address::kVersion, 16, 31, kReadOnly);
  xml.integer("GevCurrentIPAddress", address::kCurrentIp, kReadOnly);
  xml.integer("GevCurrentSubnetMask", address::kCurrentSubnet, kReadOnly);
  xml.integer("GevStreamChannelCount", address::kStreamChannelCount, kReadOnly);
  // The old and the present SFNC name of the same register.
  xml.integer("GevHeartbeatTimeout", address::kHeartbeatTimeout, kReadWrite, "<Min>500</Min>", 4, "ms");
  xml.integer("GevGVCPHeartbeatTimeout", address::kHeartbeatTimeout, kReadWrite, "<Min>500</Min>", 4, "ms");
  xml.integer("GevTimestampTickFrequency", address::kTickFrequency, kReadOnly, {}, 8, "Hz");
  xml.command("GevTimestampControlLatch", address::kTimestampControl, 2);
  xml.command("GevTimestampControlReset", address::kTimestampControl, 1);
  xml.integer("GevTimestampValue", address::kTimestampValue, kReadOnly, {}, 8);
  xml.enumeration_of("GevCCP", "GevCCPReg",
                     {{"OpenAccess", 0}, {"ExclusiveAccess", 1}, {"ControlAccess", 2}});
  xml.bits_register("GevCCPReg", address::kControlPrivilege, 30, 31, kReadWrite);
  xml.line(R"(<Integer Name="GevStreamChannelSelector" NameSpace="Standard">)");
  xml.line("  <Value>0</Value><Min>0</Min><Max>0</Max>");
  for (const std::string_view feature : {"GevSCPHostPort", "GevSCPSFireTestPacket", "GevSCPSDoNotFragment",
                                         "GevSCPSPacketSize", "GevSCPD", "GevSCDA", "GevSCSP"}) {
    xml.line("  <pSelected>{}</pSelected>", feature);
  }
  xml.line("</Integer>");
  xml.bits("GevSCPHostPort", address::kStreamPort, 16, 31, kReadWrite);
  const auto flag = [&xml](std::string_view name, int bit) {
    xml.line(R"(<Boolean Name="{}" NameSpace="Standard">)", name);
    xml.line("  <pValue>{}Reg</pValue>", name);
    xml.line("  <OnValue>1</OnValue><OffValue>0</OffValue>");
    xml.line("</Boolean>");
    xml.bits_register(fmt::format("{}Reg", name), address::kStreamPacketSize, bit, bit, kReadWrite);
  };
  flag("GevSCPSFireTestPacket", 0);
  flag("GevSCPSDoNotFragment", 1);
  xml.bits("GevSCPSPacketSize", address::kStreamPacketSize, 16, 31, kReadWrite,
           fmt::format("<Min>{}</Min><Max>{}</Max><Inc>4</Inc>", kMinPacketSize, kMaxPacketSize));
  xml.integer("GevSCPD", address::kStreamPacketDelay, kReadWrite);
  xml.integer("GevSCDA", address::kStreamAddress, kReadWrite);
  xml.bits("GevSCSP", address::kStreamSourcePort, 16, 31, kReadOnly);
  xml.enumeration_of("GevGVSPExtendedIDMode", "GevGVSPExtendedIDModeReg", {{"Off", 0}, {"On", 1}});
  xml.bits_register("GevGVSPExtendedIDModeReg", address::kGvspConfiguration, 1, 1, kReadWrite);
}

}  // namespace

std::string genicam_xml(const GigeVisionOptions& options) {
  Description xml;
  xml.line(R"(<?xml version="1.0" encoding="utf-8"?>)");
  xml.line(
      R"(<RegisterDescription ModelName="{}" VendorName="{}" ToolTip="Simulated 3D camera" StandardNameSpace="GEV")",
      identifier(options.model), identifier(options.vendor));
  xml.line(R"( SchemaMajorVersion="1" SchemaMinorVersion="1" SchemaSubMinorVersion="0")");
  xml.line(R"( MajorVersion="1" MinorVersion="0" SubMinorVersion="0")");
  xml.line(R"( ProductGuid="6A1E7A52-2C0B-4F0E-9C57-3D5B6E0E1C01")");
  xml.line(R"( VersionGuid="6A1E7A52-2C0B-4F0E-9C57-3D5B6E0E1C02")");
  xml.line(R"( xmlns="http://www.genicam.org/GenApi/Version_1_1")");
  xml.line(R"( xmlns:xsi="http://www.w3.org/2001/XMLSchema-instance")");
  xml.line(
      R"( xsi:schemaLocation="http://www.genicam.org/GenApi/Version_1_1 GenApiSchema_Version_1_1.xsd">)");
  xml.category("Root", {"DeviceControl", "ImageFormatControl", "AcquisitionControl", "Scan3dControl",
                        "ChunkDataControl", "TransportLayerControl"});
  device_control(xml);
  image_format_control(xml);
  acquisition_control(xml, options);
  scan3d_control(xml);
  chunk_data_control(xml);
  transport_layer_control(xml);
  xml.line(R"(<Port Name="Device" NameSpace="Standard"/>)");
  xml.line("</RegisterDescription>");
  std::string text = xml.take();
  // Memory is read in words of four bytes.
  text.resize((text.size() + 3) / 4 * 4, '\n');
  return text;
}

}  // namespace gantry::gige
