#pragma once

#include <memory>
#include <string>

#include "gantry/foundation/clock.h"
#include "gantry/hal/scanner.h"

namespace gantry {

/// How to reach a GenICam 3D camera over GigE Vision.
struct GenicamScannerConfig {
  std::string address = "127.0.0.1";  ///< IP address (fastest), or a device id as Aravis prints it.
  /// The whole of connect() ends by then. Leave room for the camera's heartbeat timeout (3 s by
  /// default): until it has passed, the camera belongs to a client that died without saying goodbye.
  double connect_timeout_s = 15.0;
  /// Bytes of one stream packet, IP and UDP headers included (GevSCPSPacketSize). 0: the largest that
  /// gets through, 64 kB on loopback.
  int packet_size = 0;
  /// Receive through AF_PACKET where the process is allowed to (CAP_NET_RAW); otherwise, and always
  /// when false, through a UDP socket with a large buffer.
  bool packet_socket = true;
};

/// A 3D camera that speaks GigE Vision and GenICam, through the library Aravis.
///
/// It must deliver PixelFormat Coord3D_ABC32f and describe it by the Scan3d features of the GenICam
/// Standard Features Naming Convention (SFNC 2.x, chapter "3D Scan Control"): Scan3dCoordinateScale and
/// -Offset of all three coordinates, Scan3dInvalidDataFlag and -Value, a metric or inch
/// Scan3dDistanceUnit, Cartesian coordinates. Range data without them has no meaning, so connect()
/// refuses a camera that lacks one, naming it. Frames are taken by software trigger; frame id,
/// timestamp and exposure come as chunks where the camera offers them.
///
/// Faults: kUnreachable (nobody answers, or control of the camera was lost), kTimeout (no answer or no
/// frame in time), kRefused (not connected, a missing feature, an exposure outside the camera's
/// range), kDataLoss (packets or a whole frame lost: the scan is not repeated silently), kProtocol
/// (a frame that contradicts the camera's own description, or that came twice). After kUnreachable,
/// kTimeout and kProtocol the connection is given up: connect() again. After kDataLoss and kRefused
/// the next capture() may follow at once.
///
/// Aravis's control calls block for seconds when the camera has died. They run on a thread of their
/// own, so every call here ends by its deadline, and the destructor within about a second.
/// Not thread-safe: one caller. `clock` must follow real time, since the camera does.
std::unique_ptr<Scanner> make_genicam_scanner(const GenicamScannerConfig& config, Clock& clock);

}  // namespace gantry
