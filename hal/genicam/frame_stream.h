#pragma once

#include <arv.h>

#include <cstdint>
#include <memory>

#include "camera_features.h"
#include "gobject.h"

namespace gantry {

/// The receiving end of a GigE Vision stream: buffers that are already in memory, a socket that can
/// hold a burst, lost packets asked for again.
class FrameStream {
 public:
  struct GiveBack {
    ArvStream* stream;
    void operator()(ArvBuffer* buffer) const { arv_stream_push_buffer(stream, buffer); }
  };
  /// A received buffer, complete or not; returns to the stream when dropped.
  using Frame = std::unique_ptr<ArvBuffer, GiveBack>;

  struct PacketCounts {
    uint64_t resent = 0;
    uint64_t missing = 0;
  };

  /// Opens the stream channel for frames of `payload_bytes`; `packet_socket` prefers AF_PACKET to UDP.
  /// Throws FaultException.
  FrameStream(const Features& features, size_t payload_bytes, bool packet_socket);

  /// The next frame, or null when none ended within `timeout_s`.
  Frame wait(double timeout_s);
  /// Forgets frames that arrived before.
  void discard_received();
  /// Since the stream was opened.
  PacketCounts packets() const;

 private:
  void open(const Features& features, ArvGvStreamOption option);
  bool received_anything() const;

  GObjectPtr<ArvStream> stream_;
};

}  // namespace gantry
