#pragma once

#include <chrono>
#include <condition_variable>
#include <cstdint>
#include <deque>
#include <memory>
#include <mutex>
#include <optional>
#include <thread>
#include <vector>

#include "gantry/sim/twin/gige_vision_camera.h"
#include "gvsp.h"
#include "udp_socket.h"

namespace gantry::gige {

struct ResendRequest {
  uint64_t block_id = 0;
  uint32_t first_packet = 0;
  uint32_t last_packet = 0;
};

/// The stream channel's transmitter: sends blocks in order, paced, on its own thread, and keeps the last
/// ones so that lost packets can be asked for again. Resends go before what still waits. Thread-safe.
class StreamSender {
 public:
  /// Sends from `address` (host byte order). Throws InputError if it cannot be bound.
  StreamSender(uint32_t address, double pacing_mb_per_s, int resend_frames);
  ~StreamSender();

  uint16_t source_port() const { return socket_.local().port; }

  /// Counts clear(): what was begun under an older generation must not be sent any more.
  uint64_t generation() const;
  /// Queues a block, waiting while an earlier one is still waiting. False if `generation` is over, or when
  /// shutting down.
  bool submit(Block block, uint64_t generation);
  /// Recycled memory for the next payload, perhaps empty.
  std::vector<uint8_t> take_buffer();
  void request_resend(const ResendRequest& request, const StreamFormat& format);
  void send_test_packet(const StreamFormat& format);
  /// Forgets every block: the channel was closed, or opened anew.
  void clear();
  /// Makes submit() return, for shutting down.
  void stop();

  void set_faults(const GigeVisionFaults& faults);
  /// Fills in what this part counts.
  void add_to(GigeVisionStatistics& statistics) const;

 private:
  struct Datagram {
    std::shared_ptr<const Block> block = {};  ///< Keeps `content` alive.
    std::vector<uint8_t> header = {};
    std::span<const uint8_t> content = {};
    StreamFormat format = {};
  };
  using Clock = std::chrono::steady_clock;

  void run();
  std::vector<Datagram> next_burst();
  void append_resends(std::vector<Datagram>& burst);
  void append_block(std::vector<Datagram>& burst);
  void transmit(const std::vector<Datagram>& burst);
  void pace(const std::vector<Datagram>& burst, std::unique_lock<std::mutex>& lock);
  void retire(std::shared_ptr<Block> block);

  UdpSocket socket_;
  const double bytes_per_s_;
  const size_t resend_frames_;

  mutable std::mutex mutex_;
  std::condition_variable wake_sender_;
  std::condition_variable wake_submitter_;
  bool stopping_ = false;
  uint64_t generation_ = 0;
  std::shared_ptr<Block> waiting_;
  std::shared_ptr<Block> sending_;
  uint32_t next_packet_ = 0;                 ///< Of sending_.
  std::deque<std::shared_ptr<Block>> sent_;  ///< Oldest first.
  std::vector<std::vector<uint8_t>> spare_buffers_;
  std::deque<std::pair<ResendRequest, StreamFormat>> resends_;
  std::deque<StreamFormat> test_packets_;
  GigeVisionFaults faults_;
  uint64_t first_transmissions_ = 0;
  GigeVisionStatistics counts_;
  Clock::time_point ready_at_;  ///< When all that was sent has left at the allowed rate.
  std::thread thread_;
};

}  // namespace gantry::gige
