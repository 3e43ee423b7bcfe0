#include "tcp_endpoint.h"

#include <arpa/inet.h>
#include <netinet/tcp.h>
#include <sys/socket.h>

#include <algorithm>
#include <array>
#include <cerrno>
#include <cstring>

namespace gantry {
namespace {

constexpr size_t kMaxClients = 32;
constexpr size_t kUnitOffset = 6, kPduOffset = 7;

double real_time_s() {
  return SteadyClock().now_s();
}

}  // namespace

TcpEndpoint::TcpEndpoint(std::string address, int port, DriveBank& bank)
    : address_(std::move(address)), port_(port), bank_(bank) {
  if (::inet_pton(AF_INET, address_.c_str(), &ip_) != 1 || ntohl(ip_.s_addr) >> 24 != IN_LOOPBACKNET)
    throw InputError("Modbus twin: address '" + address_ + "' is not a loopback address like 127.0.0.1");
  if (port < 0 || port > 65535)
    throw InputError("Modbus twin: port " + std::to_string(port) + " is not within 0 to 65535");
}

Descriptor TcpEndpoint::listen() const {
  Descriptor listener(::socket(AF_INET, SOCK_STREAM | SOCK_NONBLOCK | SOCK_CLOEXEC, 0));
  const int yes = 1;
  ::setsockopt(listener.get(), SOL_SOCKET, SO_REUSEADDR, &yes, sizeof yes);
  sockaddr_in endpoint{};
  endpoint.sin_family = AF_INET;
  endpoint.sin_addr = ip_;
  endpoint.sin_port = htons(static_cast<uint16_t>(port_));
  if (::bind(listener.get(), reinterpret_cast<sockaddr*>(&endpoint), sizeof endpoint) != 0 ||
      ::listen(listener.get(), SOMAXCONN) != 0)
    return Descriptor();
  return listener;
}

void TcpEndpoint::start() {
  listener_ = listen();
  if (listener_.get() < 0)
    throw InputError("Modbus twin: cannot listen at " + name() + ": " + std::strerror(errno));
  sockaddr_in endpoint{};
  socklen_t size = sizeof endpoint;
  ::getsockname(listener_.get(), reinterpret_cast<sockaddr*>(&endpoint), &size);
  port_ = ntohs(endpoint.sin_port);
  prepare();
  run();
}

void TcpEndpoint::serve() {
  for (;;) {
    // At the limit, newcomers wait in the backlog until somebody leaves; poll() skips a negative
    // descriptor.
    const int accepting = clients_.size() < kMaxClients ? listener_.get() : -1;
    std::vector<pollfd> polled{{wake_descriptor(), POLLIN, 0}, {accepting, POLLIN, 0}};
    for (const Client& client : clients_) polled.push_back({client.socket.get(), POLLIN, 0});
    if (replies_.poll(polled, real_time_s()) < 0 && errno != EINTR) return;
    if (polled[0].revents) {
      const Wish wanted = wish();
      if (wanted.stop) return;
      if (!wanted.plugged) {
        clients_.clear();
        replies_.clear();
        listener_ = Descriptor();
      } else if (listener_.get() < 0) {
        listener_ = listen();
      }
      done(wanted.plugged);
      continue;
    }
    send_due();
    std::vector<int> gone;
    for (size_t i = 0; i < clients_.size(); ++i)
      if (polled[i + 2].revents && !serve_client(clients_[i])) gone.push_back(clients_[i].number);
    std::erase_if(clients_, [&](const Client& client) {
      return std::find(gone.begin(), gone.end(), client.number) != gone.end();
    });
    if (polled[1].revents) accept_clients();
  }
}

void TcpEndpoint::accept_clients() {
  while (clients_.size() < kMaxClients) {
    Descriptor socket(::accept4(listener_.get(), nullptr, nullptr, SOCK_NONBLOCK | SOCK_CLOEXEC));
    if (socket.get() < 0) return;
    const int yes = 1;
    ::setsockopt(socket.get(), IPPROTO_TCP, TCP_NODELAY, &yes, sizeof yes);
    clients_.push_back({++last_client_, std::move(socket), {}});
  }
}

/// False when the connection has ended, or is to be closed because it talks nonsense.
bool TcpEndpoint::serve_client(Client& client) {
  std::array<uint8_t, 4096> chunk;
  const ssize_t count = ::recv(client.socket.get(), chunk.data(), chunk.size(), 0);
  if (count == 0) return false;
  if (count < 0) return errno == EAGAIN || errno == EINTR;
  client.received.insert(client.received.end(), chunk.begin(), chunk.begin() + count);

  std::span<const uint8_t> rest(client.received);
  ModbusFrame frame = first_tcp_request(rest);
  while (frame.state == ModbusFrame::State::kComplete) {
    const auto request = rest.first(frame.length);
    const int unit = request[kUnitOffset];
    if (const auto reply = bank_.answer(unit, request.subspan(kPduOffset), true))
      replies_.push(bank_, *reply, unit, client.number, tcp_reply(request, reply->pdu), kPduOffset,
                    real_time_s());
    rest = rest.subspan(frame.length);
    frame = first_tcp_request(rest);
  }
  client.received.assign(rest.begin(), rest.end());
  send_due();
  return frame.state != ModbusFrame::State::kNotModbus;
}

void TcpEndpoint::send_due() {
  while (const auto reply = replies_.pop(real_time_s())) {
    const auto client = std::find_if(clients_.begin(), clients_.end(),
                                     [&](const Client& c) { return c.number == reply->client; });
    // A client that does not read loses its connection; its socket's buffer is full.
    if (client != clients_.end() && ::send(client->socket.get(), reply->frame.data(), reply->frame.size(),
                                           MSG_NOSIGNAL) != static_cast<ssize_t>(reply->frame.size()))
      ::shutdown(client->socket.get(), SHUT_RDWR);
  }
}

}  // namespace gantry
