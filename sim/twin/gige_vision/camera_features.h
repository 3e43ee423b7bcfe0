#pragma once

#include <cstdint>
#include <span>
#include <string>

#include "acquisition.h"
#include "gantry/sim/twin/gige_vision_camera.h"
#include "gvcp.h"
#include "register_memory.h"
#include "stream_sender.h"

namespace gantry::gige {

/// What the camera's registers hold and what writing one does. Knows nothing of sockets or privileges;
/// used by the control thread alone.
class CameraFeatures {
 public:
  CameraFeatures(const GigeVisionOptions& options, uint32_t ip, DeviceClock& clock, StreamSender& sender,
                 Acquisition& acquisition);

  GvcpStatus read(uint32_t address, std::span<uint8_t> out);
  /// Writes one word, as WRITEREG does and WRITEMEM word by word.
  GvcpStatus write(uint32_t address, uint32_t value);

  /// Who controls the camera shows in registers; the control channel decides it.
  void show_privilege(uint32_t privilege, Endpoint primary);
  /// Control has been given up or lost: nothing streams without a controller.
  void close_stream();

  uint32_t heartbeat_timeout_ms() const;
  StreamFormat stream_format() const;
  /// The answer to DISCOVERY_CMD.
  std::vector<uint8_t> discovery() const;

 private:
  void lay_out(const GigeVisionOptions& options, uint32_t ip);
  GvcpStatus write_bootstrap(uint32_t address, uint32_t value);
  GvcpStatus write_packet_size(uint32_t value);
  GvcpStatus write_feature(uint32_t address, uint32_t value);
  GvcpStatus write_choice(uint32_t address, uint32_t value, uint32_t count);
  GvcpStatus write_extent(uint32_t address, uint32_t value, uint32_t min, uint32_t max);
  GvcpStatus write_number(uint32_t address, uint32_t value, double min, double max);
  AcquisitionSettings settings() const;
  ChunkLayout chunks() const;

  const GigeVisionOptions& options_;
  DeviceClock& clock_;
  StreamSender& sender_;
  Acquisition& acquisition_;
  RegisterMemory memory_;
};

}  // namespace gantry::gige
