#pragma once

#include <cstdint>
#include <string>

#include "gantry/foundation/error.h"
#include "gantry/geometry/scan.h"

namespace gantry {

/// Who the scanner is, for messages and the record.
struct ScannerInfo {
  std::string vendor;
  std::string model;
  std::string serial;
  std::string firmware;
  std::string address;  ///< Empty for a device in this process.
  int width = 0;        ///< Pixels.
  int height = 0;

  /// "scanner Twin3D (Gantry, serial 1, at 127.0.0.1)".
  std::string text() const;
};

struct CaptureSettings {
  double exposure_s = 0.1;
  double timeout_s = 10.0;  ///< From trigger to complete scan.
};

/// One complete scan as it left the device. An incomplete one is a Fault, never a Capture.
struct Capture {
  Scan scan;
  uint64_t frame_id = 0;
  uint64_t device_timestamp_ns = 0;
  double exposure_s = 0;   ///< As the device reports it.
  int resent_packets = 0;  ///< Packets that had to be asked for again.
};

/// A 3D sensor that takes one organised scan on command. The same rules hold for every
/// implementation (tests/hal/scanner_conformance.h): points are mm in the `sensor` frame, pixels
/// without data are NaN, a capture starts after the call and is complete when it returns.
class Scanner {
 public:
  virtual ~Scanner() = default;
  virtual const ScannerInfo& info() const = 0;
  /// Opens the device, checks that it can deliver scans, prepares streaming. Safe to call again after
  /// a fault: it reconnects.
  virtual Result<void> connect() = 0;
  /// Exposes and waits for the scan.
  virtual Result<Capture> capture(const CaptureSettings& settings) = 0;
};

}  // namespace gantry
