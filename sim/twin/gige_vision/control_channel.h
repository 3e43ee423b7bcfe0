#pragma once

#include <atomic>
#include <chrono>
#include <cstdint>
#include <optional>
#include <span>
#include <thread>
#include <vector>

#include "camera_features.h"
#include "gantry/sim/twin/gige_vision_camera.h"
#include "gvcp.h"
#include "stream_sender.h"
#include "udp_socket.h"

namespace gantry::gige {

/// GVCP: answers commands on UDP port 3956, grants and revokes control, watches the heartbeat.
class ControlChannel {
 public:
  /// `socket` is bound to the camera's address; `broadcast` to 255.255.255.255, or closed.
  ControlChannel(UdpSocket& socket, UdpSocket& broadcast, CameraFeatures& features, StreamSender& sender);
  ~ControlChannel();

  void set_silent(bool silent) { silent_ = silent; }
  void add_to(GigeVisionStatistics& statistics) const;

 private:
  using Clock = std::chrono::steady_clock;
  using Bytes = std::vector<uint8_t>;

  void run();
  int poll_timeout_ms() const;
  void receive(const UdpSocket& socket, bool discovery_only);
  Bytes answer(const GvcpCommand& command, Endpoint from);
  Bytes read_registers(const GvcpCommand& command);
  Bytes write_registers(const GvcpCommand& command, Endpoint from);
  Bytes read_memory(const GvcpCommand& command);
  Bytes write_memory(const GvcpCommand& command, Endpoint from);
  void resend(const GvcpCommand& command, Endpoint from);
  GvcpStatus write_word(uint32_t address, uint32_t value, Endpoint from);
  GvcpStatus write_privilege(uint32_t value, Endpoint from);
  bool may_read(Endpoint from) const;
  void release_control();

  UdpSocket& socket_;
  UdpSocket& broadcast_;
  CameraFeatures& features_;
  StreamSender& sender_;
  int wake_fd_ = -1;

  std::optional<Endpoint> primary_;  ///< The application in control.
  bool exclusive_ = false;
  Clock::time_point last_heard_;  ///< From the primary application.
  /// The last write: a repetition (its acknowledge was lost) gets the same answer and is not executed again.
  Endpoint written_from_;
  Bytes written_command_;
  Bytes written_ack_;

  std::atomic<bool> stopping_ = false;
  std::atomic<bool> silent_ = false;
  std::atomic<uint64_t> commands_ = 0;
  std::atomic<uint64_t> discarded_ = 0;
  std::thread thread_;
};

}  // namespace gantry::gige
