#include "stream_sender.h"

#include <netinet/in.h>
#include <sys/socket.h>
#include <sys/uio.h>

#include <algorithm>
#include <cerrno>
#include <cstring>

#include "gantry/foundation/error.h"

namespace gantry::gige {
namespace {

using namespace std::chrono_literals;

/// Sleeping after every packet would cost more than the packet: up to this much goes out at once.
constexpr size_t kBurstBytes = 64 * 1024;
constexpr size_t kBurstPackets = 96;
/// With an inter-packet delay, a burst spans no more time than this.
constexpr uint64_t kBurstDelayNs = 500'000;
/// After sleeping too long the sender may catch up, but only so far: receivers' buffers are finite.
constexpr auto kMaxCatchUp = 2ms;
constexpr size_t kMaxResendRequests = 4096;
/// A request may name 16 million packets that do not exist; it is answered for the first few.
constexpr uint32_t kMaxUnavailableAnswers = 16;
constexpr int kUdpOverhead = 28;

}  // namespace

StreamSender::StreamSender(uint32_t address, double pacing_mb_per_s, int resend_frames)
    : bytes_per_s_(pacing_mb_per_s * 1e6), resend_frames_(static_cast<size_t>(resend_frames)) {
  if (const int error = socket_.bind({address, 0}); error != 0) {
    throw InputError(std::string("GigE Vision camera: no socket for the stream channel: ") +
                     std::strerror(error));
  }
  const int buffer_size = 4 << 20;
  ::setsockopt(socket_.fd(), SOL_SOCKET, SO_SNDBUF, &buffer_size, sizeof buffer_size);
  thread_ = std::thread([this] { run(); });
}

StreamSender::~StreamSender() {
  stop();
  thread_.join();
}

void StreamSender::stop() {
  const std::lock_guard lock(mutex_);
  stopping_ = true;
  wake_sender_.notify_all();
  wake_submitter_.notify_all();
}

uint64_t StreamSender::generation() const {
  const std::lock_guard lock(mutex_);
  return generation_;
}

bool StreamSender::submit(Block block, uint64_t generation) {
  std::unique_lock lock(mutex_);
  wake_submitter_.wait(lock, [&] { return stopping_ || generation != generation_ || !waiting_; });
  if (stopping_ || generation != generation_) return false;
  waiting_ = std::make_shared<Block>(std::move(block));
  wake_sender_.notify_all();
  return true;
}

std::vector<uint8_t> StreamSender::take_buffer() {
  const std::lock_guard lock(mutex_);
  if (spare_buffers_.empty()) return {};
  std::vector<uint8_t> buffer = std::move(spare_buffers_.back());
  spare_buffers_.pop_back();
  return buffer;
}

void StreamSender::request_resend(const ResendRequest& request, const StreamFormat& format) {
  const std::lock_guard lock(mutex_);
  if (faults_.drop_resends || resends_.size() >= kMaxResendRequests) return;
  resends_.emplace_back(request, format);
  wake_sender_.notify_all();
}

void StreamSender::send_test_packet(const StreamFormat& format) {
  const std::lock_guard lock(mutex_);
  if (test_packets_.size() >= kMaxResendRequests) return;
  test_packets_.push_back(format);
  wake_sender_.notify_all();
}

void StreamSender::clear() {
  const std::lock_guard lock(mutex_);
  ++generation_;
  counts_.frames_lost += (waiting_ != nullptr) + (sending_ != nullptr);
  waiting_.reset();
  sending_.reset();
  for (auto& block : sent_) retire(std::move(block));
  sent_.clear();
  resends_.clear();
  test_packets_.clear();
  // An inter-packet delay of the old channel, which may be seconds, must not hold up the new one.
  ready_at_ = Clock::now();
  wake_sender_.notify_all();
  wake_submitter_.notify_all();
}

void StreamSender::set_faults(const GigeVisionFaults& faults) {
  const std::lock_guard lock(mutex_);
  faults_ = faults;
}

void StreamSender::add_to(GigeVisionStatistics& statistics) const {
  const std::lock_guard lock(mutex_);
  statistics.frames_sent += counts_.frames_sent;
  statistics.frames_lost += counts_.frames_lost;
  statistics.packets_sent += counts_.packets_sent;
  statistics.packets_dropped += counts_.packets_dropped;
  statistics.packets_resent += counts_.packets_resent;
  statistics.packets_unavailable += counts_.packets_unavailable;
  statistics.send_errors += counts_.send_errors;
}

void StreamSender::run() {
  std::unique_lock lock(mutex_);
  while (true) {
    wake_sender_.wait(lock, [this] {
      return stopping_ || waiting_ || sending_ || !resends_.empty() || !test_packets_.empty();
    });
    if (stopping_) return;
    const std::vector<Datagram> burst = next_burst();
    if (faults_.silent) {
      counts_.packets_dropped += burst.size();
    } else {
      lock.unlock();
      transmit(burst);
      lock.lock();
    }
    pace(burst, lock);
  }
}

std::vector<StreamSender::Datagram> StreamSender::next_burst() {
  std::vector<Datagram> burst;
  if (!test_packets_.empty()) {
    burst.push_back({.header = test_packet(test_packets_.front()), .format = test_packets_.front()});
    burst.back().format.do_not_fragment = true;
    test_packets_.pop_front();
    return burst;
  }
  if (!resends_.empty()) {
    append_resends(burst);
    return burst;
  }
  if (!sending_ && waiting_) {
    sending_ = std::move(waiting_);
    next_packet_ = 0;
    wake_submitter_.notify_all();
  }
  if (sending_) append_block(burst);
  return burst;
}

void StreamSender::append_resends(std::vector<Datagram>& burst) {
  auto& [request, format] = resends_.front();
  std::shared_ptr<Block> block;
  uint32_t available = 0;  // Packets that have been sent once; the others are still to come by themselves.
  for (const auto& candidate : sent_) {
    if (candidate->id == request.block_id) block = candidate;
  }
  if (block) {
    available = block->packet_count();
  } else if (sending_ && sending_->id == request.block_id) {
    block = sending_;
    available = next_packet_;
  }
  if (!block) {
    const bool coming = waiting_ && waiting_->id == request.block_id;
    const uint64_t end = std::min<uint64_t>(uint64_t{request.last_packet} + 1,
                                            uint64_t{request.first_packet} + kMaxUnavailableAnswers);
    for (uint64_t id = request.first_packet; !coming && id < end; ++id) {
      burst.push_back({.header = unavailable_packet(format, request.block_id, static_cast<uint32_t>(id)),
                       .format = format});
      ++counts_.packets_unavailable;
    }
    resends_.pop_front();
    return;
  }
  size_t bytes = 0;
  while (request.first_packet <= request.last_packet && request.first_packet < available &&
         burst.size() < kBurstPackets && bytes < kBurstBytes) {
    const uint32_t id = request.first_packet++;
    burst.push_back({block, gvsp_header(*block, id, true), block->content(id), block->format});
    bytes += burst.back().content.size();
    ++counts_.packets_resent;
  }
  if (request.first_packet > request.last_packet || request.first_packet >= available) resends_.pop_front();
}

void StreamSender::append_block(std::vector<Datagram>& burst) {
  const uint64_t delay_ns = sending_->format.packet_delay_ns;
  const size_t max_packets =
      delay_ns == 0 ? kBurstPackets : std::clamp<size_t>(kBurstDelayNs / delay_ns, 1, kBurstPackets);
  const uint32_t count = sending_->packet_count();
  size_t bytes = 0;
  while (next_packet_ < count && burst.size() < max_packets && bytes < kBurstBytes) {
    const uint32_t id = next_packet_++;
    ++first_transmissions_;
    const auto nth = static_cast<uint64_t>(std::max(0, faults_.drop_every_nth_packet));
    if (nth != 0 && first_transmissions_ % nth == 0) {
      ++counts_.packets_dropped;
      continue;
    }
    burst.push_back({sending_, gvsp_header(*sending_, id, false), sending_->content(id), sending_->format});
    bytes += burst.back().content.size();
    ++counts_.packets_sent;
  }
  if (next_packet_ < count) return;
  ++counts_.frames_sent;
  sent_.push_back(std::move(sending_));
  sending_.reset();
  while (sent_.size() > resend_frames_) {
    retire(std::move(sent_.front()));
    sent_.pop_front();
  }
}

void StreamSender::transmit(const std::vector<Datagram>& burst) {
  if (burst.empty()) return;
  std::vector<sockaddr_in> addresses;
  std::vector<std::array<iovec, 2>> parts;
  std::vector<mmsghdr> messages;
  addresses.reserve(burst.size());
  parts.reserve(burst.size());
  for (const Datagram& datagram : burst) {
    addresses.push_back(to_sockaddr(datagram.format.destination));
    parts.push_back({iovec{const_cast<uint8_t*>(datagram.header.data()), datagram.header.size()},
                     iovec{const_cast<uint8_t*>(datagram.content.data()), datagram.content.size()}});
    mmsghdr message{};
    message.msg_hdr.msg_name = &addresses.back();
    message.msg_hdr.msg_namelen = sizeof(sockaddr_in);
    message.msg_hdr.msg_iov = parts.back().data();
    message.msg_hdr.msg_iovlen = parts.back().size();
    messages.push_back(message);
  }
  const int discovery = burst.front().format.do_not_fragment ? IP_PMTUDISC_DO : IP_PMTUDISC_DONT;
  ::setsockopt(socket_.fd(), IPPROTO_IP, IP_MTU_DISCOVER, &discovery, sizeof discovery);
  size_t done = 0;
  uint64_t errors = 0;
  while (done < messages.size()) {
    const int count = ::sendmmsg(socket_.fd(), &messages[done], messages.size() - done, 0);
    if (count > 0) {
      done += static_cast<size_t>(count);
    } else if (errno != EINTR) {
      // A datagram that the system refuses is a lost packet; PACKETRESEND repairs it.
      ++errors;
      ++done;
    }
  }
  if (errors != 0) {
    const std::lock_guard lock(mutex_);
    counts_.send_errors += errors;
  }
}

void StreamSender::pace(const std::vector<Datagram>& burst, std::unique_lock<std::mutex>& lock) {
  const uint64_t generation = generation_;
  double duration_s = 0;
  for (const Datagram& datagram : burst) {
    duration_s +=
        static_cast<double>(datagram.header.size() + datagram.content.size() + kUdpOverhead) / bytes_per_s_ +
        static_cast<double>(datagram.format.packet_delay_ns) * 1e-9;
  }
  ready_at_ = std::max(ready_at_, Clock::now() - kMaxCatchUp) +
              std::chrono::duration_cast<Clock::duration>(std::chrono::duration<double>(duration_s));
  wake_sender_.wait_until(lock, ready_at_, [&] { return stopping_ || generation_ != generation; });
}

void StreamSender::retire(std::shared_ptr<Block> block) {
  if (block.use_count() == 1 && spare_buffers_.size() < 2) {
    spare_buffers_.push_back(std::move(block->payload));
  }
}

}  // namespace gantry::gige
