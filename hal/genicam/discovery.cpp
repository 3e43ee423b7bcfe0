#include "discovery.h"

#include <arpa/inet.h>
#include <netinet/in.h>
#include <poll.h>
#include <sys/socket.h>
#include <unistd.h>

#include <array>
#include <cstdint>

namespace gantry {

namespace {

constexpr uint16_t kGvcpPort = 3956;
constexpr int kAttempts = 4;
constexpr int kAnswerMs = 300;
/// GVCP header (GigE Vision, "Discovery"): key 0x42, flag "acknowledge required", DISCOVERY_CMD 0x0002,
/// length 0, request id 1.
constexpr std::array<uint8_t, 8> kDiscoveryCommand = {0x42, 0x01, 0x00, 0x02, 0x00, 0x00, 0x00, 0x01};
constexpr uint8_t kDiscoveryAck = 0x03;

}  // namespace

bool answers_discovery(const std::string& address) {
  sockaddr_in device{};
  device.sin_family = AF_INET;
  device.sin_port = htons(kGvcpPort);
  if (inet_pton(AF_INET, address.c_str(), &device.sin_addr) != 1) return true;
  const int fd = socket(AF_INET, SOCK_DGRAM | SOCK_CLOEXEC, 0);
  if (fd < 0) return true;  // Out of sockets: Aravis will say so better.
  bool answered = false;
  // Connected, so that only the device's answers come in, and a closed port shows as an error.
  if (connect(fd, reinterpret_cast<const sockaddr*>(&device), sizeof(device)) == 0) {
    for (int attempt = 0; attempt < kAttempts && !answered; ++attempt) {
      [[maybe_unused]] const ssize_t sent = send(fd, kDiscoveryCommand.data(), kDiscoveryCommand.size(), 0);
      pollfd readable{fd, POLLIN, 0};
      if (poll(&readable, 1, kAnswerMs) <= 0) continue;
      std::array<uint8_t, 1024> reply;
      const ssize_t size = recv(fd, reply.data(), reply.size(), 0);
      answered = size >= 8 && reply[2] == 0 && reply[3] == kDiscoveryAck;
    }
  }
  close(fd);
  return answered;
}

}  // namespace gantry
