#include "frame_stream.h"

#include <netinet/in.h>
#include <sys/socket.h>

#include <charconv>
#include <chrono>
#include <cstring>
#include <filesystem>
#include <thread>

namespace gantry {

namespace {

/// Only one frame is under way at a time; the second buffer takes one that comes uncalled for.
constexpr int kBuffers = 2;
constexpr int kSocketBufferBytes = 8 << 20;  ///< The kernel clips it to net.core.rmem_max.
/// Resends must have time to be asked for several times on a busy machine before a frame is given up.
constexpr unsigned kPacketTimeoutUs = 40'000;
constexpr unsigned kFrameRetentionUs = 400'000;
/// Aravis gives a frame up once it has asked again for a quarter of its packets: with the few large
/// packets of a small frame, for none.
constexpr double kRequestRatio = 1.0;
/// Aravis opens its AF_PACKET socket some milliseconds before it sets the filter, so traffic of other
/// programs gets in and is taken for stream packets: a nonsensical frame id makes it discard the real
/// frames as late. No frame can come before the acquisition starts, so anything received is foreign,
/// and the stream is opened anew. The kernel hands over what is in the ring after 5 ms.
constexpr std::chrono::milliseconds kRingDelay(25);
constexpr int kPacketSocketAttempts = 3;

/// A buffer whose pages exist: on fresh pages the receiving thread would stumble from page fault to
/// page fault and lose packets. Zeros will not do, since malloc and memset(0) fold into calloc.
ArvBuffer* new_resident_buffer(size_t bytes) {
  auto* memory = new std::byte[bytes];
  std::memset(memory, 0xA5, bytes);
  return arv_buffer_new_full(bytes, memory, memory,
                             [](void* data) { delete[] static_cast<std::byte*>(data); });
}

/// Aravis enlarges its UDP socket's buffer only once the first packet of a frame is there, when the
/// rest of it is being lost already. So find the socket among the open files of this process and
/// enlarge it now: no frame has to be sacrificed for warming up.
void enlarge_socket_buffer(uint16_t port) {
  std::error_code ignored;
  for (const auto& entry : std::filesystem::directory_iterator("/proc/self/fd", ignored)) {
    const std::string name = entry.path().filename();
    int fd = -1;
    std::from_chars(name.data(), name.data() + name.size(), fd);
    sockaddr_in address{};
    socklen_t length = sizeof(address);
    int type = 0;
    socklen_t type_length = sizeof(type);
    if (getsockname(fd, reinterpret_cast<sockaddr*>(&address), &length) != 0) continue;
    if (address.sin_family != AF_INET || ntohs(address.sin_port) != port) continue;
    if (getsockopt(fd, SOL_SOCKET, SO_TYPE, &type, &type_length) != 0 || type != SOCK_DGRAM) continue;
    setsockopt(fd, SOL_SOCKET, SO_RCVBUF, &kSocketBufferBytes, sizeof(kSocketBufferBytes));
  }
}

}  // namespace

FrameStream::FrameStream(const Features& features, size_t payload_bytes, bool packet_socket) {
  bool clean = false;
  for (int attempt = 0; packet_socket && !clean && attempt < kPacketSocketAttempts; ++attempt) {
    open(features, ARV_GV_STREAM_OPTION_NONE);
    std::this_thread::sleep_for(kRingDelay);
    clean = !received_anything();
  }
  if (!clean) open(features, ARV_GV_STREAM_OPTION_PACKET_SOCKET_DISABLED);
  for (int i = 0; i < kBuffers; ++i)
    arv_stream_push_buffer(stream_.get(), new_resident_buffer(payload_bytes));
}

void FrameStream::open(const Features& features, ArvGvStreamOption option) {
  stream_.reset();
  arv_camera_gv_set_stream_options(features.camera(), option);
  GErrorSlot error;
  stream_.reset(arv_camera_create_stream(features.camera(), nullptr, nullptr, error.out()));
  features.check(error.get(), "open the stream channel");
  if (!stream_ || !ARV_IS_GV_STREAM(stream_.get())) {
    throw_fault(FaultKind::kProtocol, features.device(), "the stream channel could not be opened");
  }
  g_object_set(stream_.get(), "socket-buffer", ARV_GV_STREAM_SOCKET_BUFFER_FIXED, "socket-buffer-size",
               kSocketBufferBytes, "packet-resend", ARV_GV_STREAM_PACKET_RESEND_ALWAYS, "packet-timeout",
               kPacketTimeoutUs, "frame-retention", kFrameRetentionUs, "packet-request-ratio", kRequestRatio,
               nullptr);
  enlarge_socket_buffer(arv_gv_stream_get_port(ARV_GV_STREAM(stream_.get())));
}

bool FrameStream::received_anything() const {
  return arv_stream_get_info_uint64_by_name(stream_.get(), "n_received_packets") > 0;
}

FrameStream::Frame FrameStream::wait(double timeout_s) {
  const auto timeout_us = static_cast<guint64>(timeout_s > 0 ? timeout_s * 1e6 : 0);
  return Frame(arv_stream_timeout_pop_buffer(stream_.get(), timeout_us), GiveBack{stream_.get()});
}

void FrameStream::discard_received() {
  while (ArvBuffer* buffer = arv_stream_try_pop_buffer(stream_.get())) {
    arv_stream_push_buffer(stream_.get(), buffer);
  }
}

FrameStream::PacketCounts FrameStream::packets() const {
  PacketCounts counts;
  guint64 resent = 0;
  guint64 missing = 0;
  arv_gv_stream_get_statistics(ARV_GV_STREAM(stream_.get()), &resent, &missing);
  counts.resent = resent;
  counts.missing = missing;
  return counts;
}

}  // namespace gantry
