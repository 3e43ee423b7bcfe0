#include "control_channel.h"

#include <poll.h>
#include <sys/eventfd.h>
#include <sys/socket.h>
#include <unistd.h>

#include <algorithm>
#include <array>
#include <cerrno>

#include "device_registers.h"
#include "wire.h"

namespace gantry::gige {
namespace {

constexpr uint32_t kExclusiveAccess = 1;
constexpr uint32_t kControlAccess = 2;
/// One byte more than a GVCP message may have, so that an oversized one shows.
constexpr size_t kReceiveSize = kGvcpHeaderSize + kGvcpMaxPayload + 1;

/// WRITEREG_ACK and WRITEMEM_ACK: how far it went.
std::vector<uint8_t> index_payload(size_t index) {
  std::vector<uint8_t> payload;
  append_u16(payload, 0);
  append_u16(payload, static_cast<uint16_t>(index));
  return payload;
}

}  // namespace

ControlChannel::ControlChannel(UdpSocket& socket, UdpSocket& broadcast, CameraFeatures& features,
                               StreamSender& sender)
    : socket_(socket),
      broadcast_(broadcast),
      features_(features),
      sender_(sender),
      wake_fd_(::eventfd(0, EFD_CLOEXEC)) {
  thread_ = std::thread([this] { run(); });
}

ControlChannel::~ControlChannel() {
  stopping_ = true;
  const uint64_t one = 1;
  [[maybe_unused]] const auto written = ::write(wake_fd_, &one, sizeof one);
  thread_.join();
  ::close(wake_fd_);
}

void ControlChannel::add_to(GigeVisionStatistics& statistics) const {
  statistics.commands += commands_;
  statistics.discarded_datagrams += discarded_;
}

void ControlChannel::run() {
  while (!stopping_) {
    std::array<pollfd, 3> polled = {pollfd{wake_fd_, POLLIN, 0}, pollfd{socket_.fd(), POLLIN, 0},
                                    pollfd{broadcast_.fd(), POLLIN, 0}};
    ::poll(polled.data(), polled.size(), poll_timeout_ms());
    if (stopping_) return;
    if (polled[1].revents) receive(socket_, false);
    if (polled[2].revents) receive(broadcast_, true);
    const auto timeout = std::chrono::milliseconds(features_.heartbeat_timeout_ms());
    if (primary_ && Clock::now() - last_heard_ > timeout) release_control();
  }
}

int ControlChannel::poll_timeout_ms() const {
  if (!primary_) return -1;
  const auto deadline = last_heard_ + std::chrono::milliseconds(features_.heartbeat_timeout_ms());
  const auto left = std::chrono::duration_cast<std::chrono::milliseconds>(deadline - Clock::now()).count();
  return static_cast<int>(std::clamp<int64_t>(left + 1, 0, 60'000));
}

void ControlChannel::receive(const UdpSocket& socket, bool discovery_only) {
  std::array<uint8_t, kReceiveSize> buffer;
  sockaddr_in sender_address{};
  socklen_t address_size = sizeof sender_address;
  const ssize_t size = ::recvfrom(socket.fd(), buffer.data(), buffer.size(), MSG_DONTWAIT,
                                  reinterpret_cast<sockaddr*>(&sender_address), &address_size);
  if (size < 0 || silent_) return;
  const std::span datagram(buffer.data(), static_cast<size_t>(size));
  const auto command = parse_gvcp(datagram);
  if (!command || (discovery_only && command->command != kDiscoveryCmd)) {
    ++discarded_;
    return;
  }
  ++commands_;
  const Endpoint from = to_endpoint(sender_address);
  if (primary_ == from) last_heard_ = Clock::now();
  const bool repeated = from == written_from_ && std::ranges::equal(datagram, written_command_);
  const Bytes ack = repeated ? written_ack_ : answer(*command, from);
  if (command->command == kWriteRegCmd || command->command == kWriteMemCmd) {
    written_from_ = from;
    written_command_.assign(datagram.begin(), datagram.end());
    written_ack_ = ack;
  }
  if (!command->ack_required() || ack.empty()) return;
  ::sendto(socket_.fd(), ack.data(), ack.size(), MSG_DONTWAIT,
           reinterpret_cast<const sockaddr*>(&sender_address), address_size);
}

ControlChannel::Bytes ControlChannel::answer(const GvcpCommand& command, Endpoint from) {
  if (!command.header_consistent()) return make_ack(command, GvcpStatus::kInvalidHeader);
  switch (command.command) {
    case kDiscoveryCmd:
      return make_ack(command, GvcpStatus::kSuccess, features_.discovery());
    case kPacketResendCmd:
      resend(command, from);
      return {};
    case kReadRegCmd:
      return may_read(from) ? read_registers(command) : make_ack(command, GvcpStatus::kAccessDenied);
    case kReadMemCmd:
      return may_read(from) ? read_memory(command) : make_ack(command, GvcpStatus::kAccessDenied);
    case kWriteRegCmd:
      return write_registers(command, from);
    case kWriteMemCmd:
      return write_memory(command, from);
    default:
      return make_ack(command, GvcpStatus::kNotImplemented);
  }
}

ControlChannel::Bytes ControlChannel::read_registers(const GvcpCommand& command) {
  const auto addresses = command.payload;
  if (addresses.empty() || addresses.size() % 4 != 0) return make_ack(command, GvcpStatus::kInvalidHeader);
  // What was read before an error is returned with it.
  Bytes values;
  for (size_t at = 0; at < addresses.size(); at += 4) {
    std::array<uint8_t, 4> word{};
    const GvcpStatus status = features_.read(get_u32(addresses, at), word);
    if (status != GvcpStatus::kSuccess) return make_ack(command, status, values);
    values.insert(values.end(), word.begin(), word.end());
  }
  return make_ack(command, GvcpStatus::kSuccess, values);
}

ControlChannel::Bytes ControlChannel::write_registers(const GvcpCommand& command, Endpoint from) {
  const auto pairs = command.payload;
  if (pairs.empty() || pairs.size() % 8 != 0) return make_ack(command, GvcpStatus::kInvalidHeader);
  for (size_t at = 0; at < pairs.size(); at += 8) {
    const GvcpStatus status = write_word(get_u32(pairs, at), get_u32(pairs, at + 4), from);
    if (status != GvcpStatus::kSuccess) return make_ack(command, status, index_payload(at / 8));
  }
  return make_ack(command, GvcpStatus::kSuccess, index_payload(pairs.size() / 8));
}

ControlChannel::Bytes ControlChannel::read_memory(const GvcpCommand& command) {
  constexpr size_t kMaxCount = 536;
  if (command.payload.size() != 8) return make_ack(command, GvcpStatus::kInvalidHeader);
  const uint16_t count = get_u16(command.payload, 6);
  if (count == 0 || count > kMaxCount) return make_ack(command, GvcpStatus::kInvalidParameter);
  Bytes payload(4 + size_t{count});
  std::copy_n(command.payload.begin(), 4, payload.begin());
  const GvcpStatus status = features_.read(get_u32(command.payload, 0), std::span(payload).subspan(4));
  if (status != GvcpStatus::kSuccess) return make_ack(command, status);
  return make_ack(command, GvcpStatus::kSuccess, payload);
}

ControlChannel::Bytes ControlChannel::write_memory(const GvcpCommand& command, Endpoint from) {
  if (command.payload.size() <= 4) return make_ack(command, GvcpStatus::kInvalidHeader);
  const uint32_t address = get_u32(command.payload, 0);
  const auto data = command.payload.subspan(4);
  if (data.size() % 4 != 0) return make_ack(command, GvcpStatus::kBadAlignment, index_payload(0));
  for (size_t at = 0; at < data.size(); at += 4) {
    const GvcpStatus status = write_word(address + static_cast<uint32_t>(at), get_u32(data, at), from);
    if (status != GvcpStatus::kSuccess) return make_ack(command, status, index_payload(at));
  }
  return make_ack(command, GvcpStatus::kSuccess, index_payload(data.size()));
}

void ControlChannel::resend(const GvcpCommand& command, Endpoint from) {
  const bool extended = command.extended_ids();
  const StreamFormat format = features_.stream_format();
  const auto payload = command.payload;
  // The stream receiver asks from a port of its own, so only its address tells that it belongs to the
  // primary application. There is one stream channel, number 0.
  if (!primary_ || primary_->ip != from.ip || !format.open() || extended != format.extended_ids ||
      payload.size() != (extended ? 20 : 12) || get_u16(payload, 0) != 0) {
    return;
  }
  ResendRequest request;
  if (extended) {
    request = {get_u64(payload, 12), get_u32(payload, 4), get_u32(payload, 8)};
  } else {
    request = {get_u16(payload, 2), get_u32(payload, 4) & 0xFFFFFF, get_u32(payload, 8) & 0xFFFFFF};
  }
  if (request.first_packet <= request.last_packet) sender_.request_resend(request, format);
}

GvcpStatus ControlChannel::write_word(uint32_t address, uint32_t value, Endpoint from) {
  if (address == address::kControlPrivilege) return write_privilege(value, from);
  if (primary_ != from) return GvcpStatus::kAccessDenied;
  return features_.write(address, value);
}

GvcpStatus ControlChannel::write_privilege(uint32_t value, Endpoint from) {
  if (primary_ && primary_ != from) return GvcpStatus::kAccessDenied;
  const uint32_t privilege = value & (kExclusiveAccess | kControlAccess);
  if (privilege == 0) {
    if (primary_) release_control();
    return GvcpStatus::kSuccess;
  }
  primary_ = from;
  exclusive_ = (privilege & kExclusiveAccess) != 0;
  last_heard_ = Clock::now();
  features_.show_privilege(privilege, from);
  return GvcpStatus::kSuccess;
}

bool ControlChannel::may_read(Endpoint from) const {
  return !primary_ || !exclusive_ || primary_ == from;
}

void ControlChannel::release_control() {
  primary_.reset();
  exclusive_ = false;
  features_.show_privilege(0, {});
  features_.close_stream();
}

}  // namespace gantry::gige
