#pragma once

#include <array>
#include <cstdint>
#include <functional>
#include <memory>
#include <string>
#include <vector>

namespace gantry {

/// How one coordinate is coded on the wire (SFNC Scan3dCoordinateScale, -Offset, Scan3dInvalidDataValue):
/// value_mm = raw * scale + offset_mm. An invalid pixel holds `invalid_value`, raw, in all coordinates.
struct Scan3dCoordinate {
  float scale = 1;
  float offset_mm = 0;
  float invalid_value = -10000;
};

/// The 3D camera that the twin puts on the wire.
struct GigeVisionOptions {
  /// Loopback only. The GVCP port is 3956 by standard: one 127.0.0.N per camera.
  std::string address = "127.0.0.1";
  std::string vendor = "Gantry";  ///< At most 31 characters, like model and firmware.
  std::string model = "Twin3D";
  std::string serial = "1";  ///< At most 15 characters.
  std::string firmware = "1.0";
  int width = 1920;
  int height = 1200;
  double focal_length_px = 2400;
  double principal_u = 959.5;  ///< Pixels, of the whole sensor.
  double principal_v = 599.5;
  std::array<Scan3dCoordinate, 3> coordinates;  ///< X, Y, Z.
  double pacing_mb_per_s = 250;  ///< Bytes on the stream channel never leave faster (1 MB = 1e6 bytes).
  double min_exposure_us = 1000;
  double max_exposure_us = 10e6;
  double default_exposure_us = 100e3;
  double temperature_c = 35;  ///< DeviceTemperature until the first exposure reports one.
  int resend_frames = 2;      ///< Sent frames kept for PACKETRESEND.
  /// Number of the first frame after the stream opens; near 65535 it tries a receiver on the wrap to 1.
  uint64_t first_block_id = 1;
};

/// What an exposure yields.
struct TriggeredFrame {
  /// width * height * 3, row-major, mm in the `sensor` frame; NaN where there is no point.
  std::vector<float> xyz;
  double temperature_c = 35;
};

/// Misbehaviour for tests; reversible at any time.
struct GigeVisionFaults {
  int drop_every_nth_packet = 0;  ///< Of the first transmissions; resends are spared. 0: none.
  bool drop_resends = false;      ///< Resend requests are ignored, so that a dropped packet stays lost.
  bool silent = false;            ///< The camera hangs: no command is answered, nothing is streamed.
};

struct GigeVisionStatistics {
  uint64_t commands = 0;             ///< Well-formed GVCP commands.
  uint64_t discarded_datagrams = 0;  ///< Too short, too long, or without the GVCP key.
  uint64_t triggers_accepted = 0;
  uint64_t triggers_refused = 0;
  uint64_t frames_sent = 0;
  uint64_t frames_lost = 0;  ///< Exposed but not sent: no open stream, control lost, or a failed exposure.
  uint64_t packets_sent = 0;
  uint64_t packets_dropped = 0;  ///< By GigeVisionFaults.
  uint64_t packets_resent = 0;
  uint64_t packets_unavailable = 0;  ///< Asked for again, but no longer (or never) in memory.
  uint64_t send_errors = 0;          ///< Packets that the operating system refused.
  bool discoverable_by_broadcast = false;
  std::string last_error;  ///< Why the last exposure failed; empty if none did.
};

/// A GigE Vision 2.0 transmitter on loopback, written from the standard: GVCP (discovery, registers,
/// privilege, heartbeat), GVSP (image and extended-chunk payload, resend), and a GenICam description
/// of a 3D camera with SFNC's Scan3d features. Frames are Coord3D_ABC32f.
///
/// Triggers: TriggerSoftware is refused with GEV_STATUS_BUSY while a frame is being exposed or waits
/// for the stream, and with GEV_STATUS_ACCESS_DENIED unless acquisition runs with TriggerMode On.
/// Nothing is queued: a frame always answers the last accepted trigger. AcquisitionStop lets the
/// current frame finish (SFNC); closing the stream or losing control discards it.
///
/// Runs three threads of its own: control, exposure, stream. Destruction stops them, and waits for
/// an exposure in progress.
class GigeVisionCamera {
 public:
  /// Called on the exposure thread at each trigger; takes as long as it takes. An exception loses the frame.
  using Expose = std::function<TriggeredFrame(double exposure_s)>;

  /// Binds and answers from here on. Throws InputError for an impossible option or a taken address.
  GigeVisionCamera(const GigeVisionOptions& options, Expose expose);
  ~GigeVisionCamera();
  GigeVisionCamera(const GigeVisionCamera&) = delete;
  GigeVisionCamera& operator=(const GigeVisionCamera&) = delete;

  void set_faults(const GigeVisionFaults& faults);
  GigeVisionStatistics statistics() const;

 private:
  struct Impl;
  std::unique_ptr<Impl> impl_;
};

}  // namespace gantry
