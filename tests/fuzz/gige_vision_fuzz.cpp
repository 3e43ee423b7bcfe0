// What a client may send to the twin's camera: GVCP datagrams, each after its length (two bytes).

#include <arpa/inet.h>
#include <poll.h>
#include <sys/socket.h>
#include <unistd.h>

#include "fuzz.h"
#include "gantry/sim/twin/gige_vision_camera.h"

namespace gantry::fuzz {
namespace {

const char* const kAddress = "127.0.0.79";

/// A datagram with its length: key, flags (acknowledge), command, length, request id, payload.
std::string datagram(uint8_t command, const std::string& payload, uint8_t id = 1) {
  std::string bytes{'\x42', '\1',
                    '\0',   static_cast<char>(command),
                    '\0',   static_cast<char>(payload.size()),
                    '\0',   static_cast<char>(id)};
  bytes += payload;
  return std::string{'\0', static_cast<char>(bytes.size())} + bytes;
}

class Client {
 public:
  Client() : socket_(::socket(AF_INET, SOCK_DGRAM, 0)) {
    sockaddr_in camera{};
    camera.sin_family = AF_INET;
    camera.sin_port = htons(3956);
    ::inet_pton(AF_INET, kAddress, &camera.sin_addr);
    ::connect(socket_, reinterpret_cast<sockaddr*>(&camera), sizeof camera);
  }
  ~Client() { ::close(socket_); }

  void send(const std::string& bytes) const { ::send(socket_, bytes.data(), bytes.size(), 0); }

  /// Whether the camera still answers: datagrams stay in order, so all before have been dealt with.
  bool alive() const {
    const std::string discovery = datagram(2, "", 0xAB).substr(2);
    send(discovery);
    uint8_t answer[1500];
    for (pollfd events{socket_, POLLIN, 0}; ::poll(&events, 1, 5000) == 1;)
      if (::recv(socket_, answer, sizeof answer, 0) > 8 && answer[7] == 0xAB && answer[3] == 3) return true;
    return false;
  }

 private:
  int socket_;
};

}  // namespace

std::vector<std::string> seeds() {
  using namespace std::string_literals;
  const std::string control = datagram(0x82, "\0\0\x0a\0\0\0\0\2"s), silence = datagram(0x80, "\0\0\x0d\0"s);
  return {
      datagram(2, "") + datagram(0x80, "\0\0\0\0\0\0\x0a\0\0\0\x0d\x04"s),
      control + datagram(0x82, "\0\0\x0d\x18\x7f\0\0\1\0\0\x0d\0\0\0\xc0\0\0\0\x0d\4\x40\0\5\xdc"s) +
          datagram(0x40, "\0\0\0\1\0\0\0\0\0\xff\xff\xff"s) + datagram(0x82, "\0\0\x0a\0\0\0\0\0"s),
      control + datagram(0x82, "\0\0\x0d\x18\x7f\0\0\1\0\0\x0d\0\0\0\xc0\1\0\0\xa0\x34\0\0\0\1"s) +
          datagram(0x82, "\0\0\xa0\xe0\0\0\0\1\0\0\xa0\x0c\0\0\0\x08\0\0\xa0\x14\0\0\0\4"s) +
          datagram(0x82, "\0\0\xa0\x24\0\0\0\1\0\0\xa0\x3c\0\0\0\1"s) +
          datagram(0x40, "\0\0\0\1\0\0\0\0\0\xff\xff\xff"s),
      datagram(0x84, "\0\0\2\0\0\0\2\0"s) + datagram(0x84, "\0\0\0\x48\0\0\0\x20"s) + silence,
      control + datagram(0x86, "\0\0\x0d\4\0\0\2\x40"s) + datagram(0x82, "\0\0\x09\x38\0\0\x0b\xb8"s),
  };
}

}  // namespace gantry::fuzz

int LLVMFuzzerTestOneInput(const uint8_t* data, size_t size) {
  using namespace gantry;
  GigeVisionOptions options;
  options.address = fuzz::kAddress;
  options.width = 16;
  options.height = 16;
  GigeVisionCamera camera(
      options, [](double) { return TriggeredFrame{.xyz = std::vector<float>(16 * 16 * 3, 1.0f)}; });
  const fuzz::Client client;
  const std::string bytes = fuzz::text_of(data, size);
  for (size_t at = 0; at + 2 <= size;) {
    const size_t length = static_cast<size_t>(data[at]) << 8 | data[at + 1];
    client.send(bytes.substr(at + 2, length));
    at += 2 + length;
  }
  if (!client.alive()) throw std::logic_error("the camera answers no more");
  return 0;
}
