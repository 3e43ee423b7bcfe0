#pragma once

#include <arv.h>

#include <atomic>
#include <functional>
#include <memory>
#include <optional>

#include "camera_features.h"
#include "frame_stream.h"
#include "gantry/hal/genicam_scanner.h"
#include "gobject.h"
#include "range_format.h"

namespace gantry {

/// One connection to one camera, from taking control to giving it back: configured for triggered range
/// images and streaming. Opening, trigger() and the destructor talk to the camera and may block for
/// seconds: they belong on the control thread. The rest is memory.
class CameraSession {
 public:
  struct ExposureRange {
    double min_s;
    double max_s;
  };
  /// What the camera says of one frame.
  struct FrameFacts {
    uint64_t id;
    bool id_is_16_bit;  ///< GigE Vision's short block id, 1 to 65535 and around, where no chunk tells better.
    uint64_t timestamp_ns;
    std::optional<double> exposure_s;
  };

  /// Throws FaultException. `remaining_s` tells how long opening may still take.
  CameraSession(const GenicamScannerConfig& config, const std::function<double()>& remaining_s);
  ~CameraSession();
  CameraSession(const CameraSession&) = delete;
  CameraSession& operator=(const CameraSession&) = delete;

  const ScannerInfo& info() const { return info_; }
  const RangeFormat& format() const { return format_; }
  const ExposureRange& exposure_range() const { return exposure_range_; }
  FrameStream& stream() { return *stream_; }

  /// Sets the exposure and takes one frame; returns the exposure that the camera chose. A camera that
  /// is still busy with the frame before is asked again until `limit_s` is over. Throws FaultException.
  double trigger(double exposure_s, double limit_s);

  FrameFacts facts(ArvBuffer* buffer) const;
  /// The image of a complete buffer, or why it is not the image that the camera promised.
  Result<std::span<const std::byte>> image(ArvBuffer* buffer) const;

  /// The camera stopped answering heartbeats, or somebody else took it.
  bool control_lost() const { return *control_lost_; }
  /// The camera is not expected to answer: closing spares it a long farewell.
  void presume_dead() { presumed_dead_ = true; }

 private:
  void take_control(const std::function<double()>& remaining_s);
  void read_info();
  void select_software_trigger();
  void enable_chunks();
  void set_packet_size(int requested);
  bool on_loopback() const;
  size_t payload_bytes() const;

  std::string device_;  ///< For messages.
  std::shared_ptr<std::atomic<bool>> control_lost_;
  std::atomic<bool> presumed_dead_ = false;
  GObjectPtr<ArvCamera> camera_;
  std::optional<Features> features_;
  std::optional<FrameStream> stream_;
  GObjectPtr<ArvChunkParser> chunks_;  ///< Null when the camera offers none.
  bool has_id_chunk_ = false;
  bool has_timestamp_chunk_ = false;
  bool has_exposure_chunk_ = false;
  uint64_t ticks_per_s_ = 1'000'000'000;
  ScannerInfo info_;
  RangeFormat format_;
  ExposureRange exposure_range_{};
};

}  // namespace gantry
