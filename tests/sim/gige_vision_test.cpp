// The GigE Vision twin, seen through a client that is written here by hand from the standard: raw
// datagrams, no library, and none of the twin's own headers but the public one. Where a feature lives is
// looked up in the GenICam description that the camera serves, as a real client does.

#include "gantry/sim/twin/gige_vision_camera.h"

#include <arpa/inet.h>
#include <gtest/gtest.h>
#include <poll.h>
#include <sys/socket.h>
#include <unistd.h>

#include <atomic>
#include <chrono>
#include <cmath>
#include <condition_variable>
#include <cstring>
#include <map>
#include <memory>
#include <mutex>
#include <optional>
#include <random>
#include <thread>

#include "gantry/foundation/error.h"

namespace gantry {
namespace {

using namespace std::chrono_literals;
using Bytes = std::vector<uint8_t>;
using Clock = std::chrono::steady_clock;

constexpr auto kPatience = 10s;

constexpr uint16_t kSuccess = 0x0000;
constexpr uint16_t kNotImplemented = 0x8001;
constexpr uint16_t kInvalidParameter = 0x8002;
constexpr uint16_t kInvalidAddress = 0x8003;
constexpr uint16_t kWriteProtect = 0x8004;
constexpr uint16_t kBadAlignment = 0x8005;
constexpr uint16_t kAccessDenied = 0x8006;
constexpr uint16_t kBusy = 0x8007;
constexpr uint16_t kInvalidHeader = 0x800E;

constexpr uint32_t kHeartbeat = 0x0938;
constexpr uint32_t kGvcpConfiguration = 0x0954;
constexpr uint32_t kGvspConfiguration = 0x0960;
constexpr uint32_t kCcp = 0x0A00;
constexpr uint32_t kScp = 0x0D00;
constexpr uint32_t kScps = 0x0D04;
constexpr uint32_t kScpd = 0x0D08;
constexpr uint32_t kScda = 0x0D18;
constexpr uint32_t kLoopback = 0x7F000001;

uint64_t number(const Bytes& bytes, size_t at, size_t size) {
  uint64_t value = 0;
  for (size_t i = 0; i < size; ++i) value = value << 8 | bytes.at(at + i);
  return value;
}

void append(Bytes& bytes, uint64_t value, size_t size) {
  for (size_t i = size; i-- > 0;) bytes.push_back(static_cast<uint8_t>(value >> (8 * i)));
}

float to_float(uint32_t word) {
  float value;
  std::memcpy(&value, &word, sizeof value);
  return value;
}

uint32_t to_word(float value) {
  uint32_t word;
  std::memcpy(&word, &value, sizeof word);
  return word;
}

class Udp {
 public:
  Udp() {
    fd_ = ::socket(AF_INET, SOCK_DGRAM, 0);
    sockaddr_in local = address("127.0.0.1", 0);
    EXPECT_EQ(::bind(fd_, reinterpret_cast<sockaddr*>(&local), sizeof local), 0);
    const int size = 4 << 20;
    ::setsockopt(fd_, SOL_SOCKET, SO_RCVBUF, &size, sizeof size);
  }
  ~Udp() { ::close(fd_); }
  Udp(const Udp&) = delete;
  Udp& operator=(const Udp&) = delete;

  static sockaddr_in address(const std::string& ip, uint16_t port) {
    sockaddr_in result{};
    result.sin_family = AF_INET;
    result.sin_port = htons(port);
    ::inet_pton(AF_INET, ip.c_str(), &result.sin_addr);
    return result;
  }

  uint16_t port() const {
    sockaddr_in local{};
    socklen_t size = sizeof local;
    ::getsockname(fd_, reinterpret_cast<sockaddr*>(&local), &size);
    return ntohs(local.sin_port);
  }

  bool send(const std::string& ip, const Bytes& bytes) {
    sockaddr_in to = address(ip, 3956);
    return ::sendto(fd_, bytes.data(), bytes.size(), 0, reinterpret_cast<sockaddr*>(&to), sizeof to) >= 0;
  }

  std::optional<Bytes> receive(std::chrono::milliseconds patience) {
    pollfd polled{fd_, POLLIN, 0};
    if (::poll(&polled, 1, static_cast<int>(patience.count())) <= 0) return std::nullopt;
    Bytes bytes(65536);
    sockaddr_in sender{};
    socklen_t size = sizeof sender;
    const ssize_t count =
        ::recvfrom(fd_, bytes.data(), bytes.size(), 0, reinterpret_cast<sockaddr*>(&sender), &size);
    if (count < 0) return std::nullopt;
    bytes.resize(static_cast<size_t>(count));
    char text[INET_ADDRSTRLEN];
    last_sender_ = ::inet_ntop(AF_INET, &sender.sin_addr, text, sizeof text);
    return bytes;
  }

  void allow_broadcast() {
    const int on = 1;
    ::setsockopt(fd_, SOL_SOCKET, SO_BROADCAST, &on, sizeof on);
  }
  const std::string& last_sender() const { return last_sender_; }

 private:
  int fd_ = -1;
  std::string last_sender_;
};

/// One application talking to a camera.
class Client {
 public:
  explicit Client(std::string camera) : camera_(std::move(camera)) {}

  Bytes command(uint16_t code, const Bytes& payload, uint8_t flags = 1) {
    if (++request_ == 0) ++request_;
    Bytes bytes = {0x42, flags};
    append(bytes, code, 2);
    append(bytes, payload.size(), 2);
    append(bytes, request_, 2);
    bytes.insert(bytes.end(), payload.begin(), payload.end());
    return bytes;
  }

  /// The acknowledge, checked for its header; empty if none came. UDP may lose a datagram, so a command is
  /// repeated after a second, as a real client does; acknowledges of other commands are passed over.
  Bytes exchange(const Bytes& bytes, std::chrono::milliseconds patience = kPatience) {
    const auto deadline = Clock::now() + patience;
    while (Clock::now() < deadline) {
      udp_.send(camera_, bytes);
      while (const auto ack = udp_.receive(std::min<std::chrono::milliseconds>(1s, patience))) {
        EXPECT_GE(ack->size(), 8u);
        EXPECT_EQ(number(*ack, 4, 2), ack->size() - 8) << "length";
        if (number(*ack, 6, 2) != number(bytes, 6, 2)) continue;
        EXPECT_EQ(number(*ack, 2, 2), number(bytes, 2, 2) + 1) << "acknowledge code";
        return *ack;
      }
    }
    return {};
  }

  uint16_t status(uint16_t code, const Bytes& payload) {
    const Bytes ack = exchange(command(code, payload));
    return ack.empty() ? 0xFFFF : static_cast<uint16_t>(number(ack, 0, 2));
  }

  uint16_t write(uint32_t address, uint32_t value) {
    Bytes payload;
    append(payload, address, 4);
    append(payload, value, 4);
    return status(0x0082, payload);
  }

  uint32_t read(uint32_t address) {
    Bytes payload;
    append(payload, address, 4);
    const Bytes ack = exchange(command(0x0080, payload));
    EXPECT_EQ(number(ack, 0, 2), kSuccess) << std::hex << address;
    return static_cast<uint32_t>(number(ack, 8, 4));
  }

  uint16_t read_status(uint32_t address) {
    Bytes payload;
    append(payload, address, 4);
    return status(0x0080, payload);
  }

  Bytes read_memory(uint32_t address, size_t size) {
    Bytes memory;
    while (memory.size() < size) {
      Bytes payload;
      append(payload, address + memory.size(), 4);
      append(payload, std::min<size_t>(536, size - memory.size()), 4);
      const Bytes ack = exchange(command(0x0084, payload));
      if (ack.empty() || number(ack, 0, 2) != kSuccess) return {};
      memory.insert(memory.end(), ack.begin() + 12, ack.end());
    }
    return memory;
  }

  /// The GenICam description: First URL says where it is.
  const std::string& xml() {
    if (xml_.empty()) {
      const Bytes url = read_memory(0x0200, 512);
      unsigned address = 0, size = 0;
      EXPECT_EQ(
          std::sscanf(reinterpret_cast<const char*>(url.data()), "Local:camera.xml;%x;%x", &address, &size),
          2);
      const Bytes text = read_memory(address, size);
      EXPECT_EQ(text.size(), size);
      xml_.assign(text.begin(), text.end());
    }
    return xml_;
  }

  uint32_t feature(const std::string& name) {
    const size_t node = xml().find("Name=\"" + name + "Reg\"");
    if (node == std::string::npos) throw std::runtime_error("no feature " + name);
    return static_cast<uint32_t>(std::stoul(xml().substr(xml().find("<Address>", node) + 9), nullptr, 16));
  }

  uint16_t set(const std::string& name, uint32_t value) { return write(feature(name), value); }
  uint32_t get(const std::string& name) { return read(feature(name)); }

  Udp& udp() { return udp_; }
  const std::string& camera() const { return camera_; }

 private:
  std::string camera_;
  Udp udp_;
  uint16_t request_ = 0;
  std::string xml_;
};

/// A block as it arrived.
struct Received {
  Bytes leader;
  Bytes trailer;
  std::map<uint32_t, Bytes> payload;  ///< By packet id, from 1.
  uint64_t id = 0;

  Bytes joined() const {
    Bytes all;
    for (const auto& [packet, content] : payload) all.insert(all.end(), content.begin(), content.end());
    return all;
  }
};

struct Packet {
  uint16_t status = 0;
  uint64_t block = 0;
  uint8_t format = 0;
  uint32_t id = 0;
  bool marked_resent = false;  ///< In the extended header's flags.
  Bytes content;
};

Packet parse_gvsp(const Bytes& bytes) {
  Packet packet;
  packet.status = static_cast<uint16_t>(number(bytes, 0, 2));
  packet.format = bytes.at(4) & 0x0F;
  if (bytes.at(4) & 0x80) {
    packet.marked_resent = bytes.at(3) & 1;
    packet.block = number(bytes, 8, 8);
    packet.id = static_cast<uint32_t>(number(bytes, 16, 4));
    packet.content.assign(bytes.begin() + 20, bytes.end());
  } else {
    packet.block = number(bytes, 2, 2);
    packet.id = static_cast<uint32_t>(number(bytes, 5, 3));
    packet.content.assign(bytes.begin() + 8, bytes.end());
  }
  return packet;
}

class GigeVision : public testing::Test {
 protected:
  static constexpr int kWidth = 64;
  static constexpr int kHeight = 48;

  GigeVision() {
    options_.width = kWidth;
    options_.height = kHeight;
    std::mt19937 random(7);
    std::uniform_real_distribution<float> mm(-500, 500);
    xyz_.resize(size_t{3} * kWidth * kHeight);
    for (float& value : xyz_) value = mm(random);
    for (size_t pixel = 0; pixel < xyz_.size(); pixel += 3 * 7) xyz_[pixel + 2] = NAN;
  }

  /// Tests run in parallel processes: each takes the first free address of the range kept for them.
  void start() {
    const auto deadline = Clock::now() + 60s;
    for (int n = 31; !camera_; n = n == 39 ? 31 : n + 1) {
      options_.address = "127.0.0." + std::to_string(n);
      try {
        camera_ = std::make_unique<GigeVisionCamera>(
            options_, [this](double exposure_s) { return expose(exposure_s); });
      } catch (const InputError&) {
        if (Clock::now() > deadline) throw;
      }
    }
    client_ = std::make_unique<Client>(options_.address);
  }

  TriggeredFrame expose(double exposure_s) {
    std::unique_lock lock(mutex_);
    ++exposures_;
    exposure_s_ = exposure_s;
    changed_.notify_all();
    changed_.wait(lock, [this] { return !hold_; });
    if (fail_) throw std::runtime_error("projector lamp is broken");
    return {xyz_, 36.5};
  }

  void hold(bool on) {
    const std::lock_guard lock(mutex_);
    hold_ = on;
    changed_.notify_all();
  }

  void set_failing(bool on) {
    const std::lock_guard lock(mutex_);
    fail_ = on;
  }

  bool wait_for_exposures(int count) {
    std::unique_lock lock(mutex_);
    return changed_.wait_for(lock, kPatience, [&] { return exposures_ >= count; });
  }

  template <typename Condition>
  static bool eventually(Condition condition) {
    const auto deadline = Clock::now() + kPatience;
    while (Clock::now() < deadline) {
      if (condition()) return true;
      std::this_thread::sleep_for(5ms);
    }
    return false;
  }

  /// Control, stream to stream_, software trigger, acquisition running.
  void start_streaming(uint32_t packet_size = 1500) {
    Client& c = *client_;
    ASSERT_EQ(c.write(kCcp, 2), kSuccess);
    ASSERT_EQ(c.write(kScps, packet_size), kSuccess);
    ASSERT_EQ(c.write(kScda, kLoopback), kSuccess);
    ASSERT_EQ(c.write(kScp, stream_.port()), kSuccess);
    ASSERT_EQ(c.set("TriggerMode", 1), kSuccess);
    ASSERT_EQ(c.set("AcquisitionStart", 1), kSuccess);
  }

  /// All packets until the trailer.
  Received receive_block() {
    Received block;
    while (block.trailer.empty()) {
      const auto bytes = stream_.receive(kPatience);
      if (!bytes) {
        ADD_FAILURE() << "the stream fell silent";
        break;
      }
      file(parse_gvsp(*bytes), block);
    }
    return block;
  }

  static void file(const Packet& packet, Received& block) {
    block.id = packet.block;
    if (packet.format == 1) block.leader = packet.content;
    if (packet.format == 2) block.trailer = packet.content;
    if (packet.format == 3) block.payload[packet.id] = packet.content;
  }

  /// Nothing if no trigger was accepted.
  Received trigger_and_receive() {
    EXPECT_TRUE(eventually([&] { return client_->set("TriggerSoftware", 1) == kSuccess; }));
    return receive_block();
  }

  /// Every pixel of `raw` against what was exposed.
  void expect_image(const Bytes& raw, int x, int y, int width, int height) {
    ASSERT_GE(raw.size(), size_t{12} * static_cast<size_t>(width * height));
    for (int row = 0; row < height; ++row) {
      for (int column = 0; column < width; ++column) {
        float got[3];
        std::memcpy(got, &raw[size_t{12} * static_cast<size_t>(row * width + column)], sizeof got);
        const float* expected = &xyz_[size_t{3} * static_cast<size_t>((row + y) * kWidth + column + x)];
        const bool valid = std::isfinite(expected[2]);
        for (size_t i = 0; i < 3; ++i) {
          const Scan3dCoordinate& c = options_.coordinates[i];
          if (valid) {
            ASSERT_NEAR(got[i] * c.scale + c.offset_mm, expected[i], 1e-3)
                << row << " " << column << " " << i;
          } else {
            ASSERT_EQ(got[i], c.invalid_value);
          }
        }
      }
    }
  }

  /// PACKETRESEND_CMD with 16-bit block ids; no acknowledge exists.
  void ask_again(uint64_t block, uint32_t first, uint32_t last) {
    Bytes payload;
    append(payload, 0, 2);
    append(payload, block, 2);
    append(payload, first, 4);
    append(payload, last, 4);
    client_->udp().send(options_.address, client_->command(0x0040, payload, 0));
  }

  GigeVisionOptions options_;
  std::vector<float> xyz_;
  std::unique_ptr<Client> client_;
  Udp stream_;

  std::mutex mutex_;
  std::condition_variable changed_;
  std::atomic<int> exposures_ = 0;
  std::atomic<double> exposure_s_ = 0;
  bool hold_ = false;
  bool fail_ = false;
  std::unique_ptr<GigeVisionCamera> camera_;  // Last: its threads call expose().
};

TEST_F(GigeVision, DiscoveryTellsWhoItIs) {
  options_.model = "Test3D";
  options_.serial = "SN-42";
  start();
  // A discovery command byte by byte: key, acknowledge required, DISCOVERY_CMD, no payload, request 0x1234.
  const Bytes ack = client_->exchange({0x42, 0x01, 0x00, 0x02, 0x00, 0x00, 0x12, 0x34});
  ASSERT_EQ(ack.size(), 8u + 248u);
  EXPECT_EQ(number(ack, 0, 8), 0x0000'0003'00F8'1234u);
  EXPECT_EQ(number(ack, 8, 4), 0x00020000u) << "GigE Vision 2.0";
  EXPECT_EQ(ack[12] & 0x80, 0x80) << "big-endian device";
  EXPECT_EQ(number(ack, 8 + 0x24, 4), ntohl(::inet_addr(options_.address.c_str())));
  EXPECT_STREQ(reinterpret_cast<const char*>(&ack[8 + 0x48]), "Gantry");
  EXPECT_STREQ(reinterpret_cast<const char*>(&ack[8 + 0x68]), "Test3D");
  EXPECT_STREQ(reinterpret_cast<const char*>(&ack[8 + 0xD8]), "SN-42");
}

TEST_F(GigeVision, AnswersBroadcastDiscovery) {
  options_.serial = "broadcast";
  start();
  Udp udp;
  udp.allow_broadcast();
  // From 127.0.0.1 the system may have no route for a broadcast; then it cannot be tried here.
  if (!camera_->statistics().discoverable_by_broadcast ||
      !udp.send("255.255.255.255", {0x42, 0x11, 0x00, 0x02, 0x00, 0x00, 0x00, 0x01})) {
    GTEST_SKIP() << "no broadcast on this machine";
  }
  bool found = false;
  while (const auto ack = udp.receive(2s)) {
    found = found || udp.last_sender() == options_.address;
    if (found) break;
  }
  EXPECT_TRUE(found);
}

TEST_F(GigeVision, ATakenAddressIsAnInputError) {
  start();
  try {
    const GigeVisionCamera second(options_, [](double) { return TriggeredFrame{}; });
    FAIL() << "two cameras at one address";
  } catch (const InputError& error) {
    EXPECT_NE(std::string(error.what()).find(options_.address + ":3956"), std::string::npos) << error.what();
  }
}

TEST_F(GigeVision, ImpossibleOptionsAreInputErrors) {
  const auto rejected = [](auto change) {
    GigeVisionOptions options;
    options.address = "127.0.0.39";
    change(options);
    try {
      const GigeVisionCamera camera(options, [](double) { return TriggeredFrame{}; });
      return false;
    } catch (const InputError&) {
      return true;
    }
  };
  EXPECT_TRUE(rejected([](auto& o) { o.address = "192.0.2.1"; })) << "not loopback";
  EXPECT_TRUE(rejected([](auto& o) { o.address = "localhost"; }));
  EXPECT_TRUE(rejected([](auto& o) { o.serial = "12345678901234567"; }));
  EXPECT_TRUE(rejected([](auto& o) { o.width = 0; }));
  EXPECT_TRUE(rejected([](auto& o) { o.coordinates[1].scale = 0; }));
  EXPECT_TRUE(rejected([](auto& o) { o.pacing_mb_per_s = NAN; }));
  EXPECT_TRUE(rejected([](auto& o) { o.max_exposure_us = 1; }));
  EXPECT_TRUE(rejected([](auto& o) { o.first_block_id = 0; }));
}

TEST_F(GigeVision, ErrorsCarryTheStandardsStatusCodes) {
  start();
  Client& c = *client_;
  EXPECT_EQ(c.write(kHeartbeat, 1000), kAccessDenied) << "not in control";
  ASSERT_EQ(c.write(kCcp, 2), kSuccess);
  EXPECT_EQ(c.write(kHeartbeat, 1000), kSuccess);
  EXPECT_EQ(c.read(kHeartbeat), 1000u);
  EXPECT_EQ(c.write(kHeartbeat, 1), kSuccess);
  EXPECT_EQ(c.read(kHeartbeat), 500u) << "the standard's minimum";

  EXPECT_EQ(c.read_status(0x0938 + 2), kBadAlignment);
  EXPECT_EQ(c.read_status(0x0000'0680), kInvalidAddress) << "a second network interface";
  EXPECT_EQ(c.read_status(0xFFFF'FFFC), kInvalidAddress);
  EXPECT_EQ(c.write(0x0000, 1), kWriteProtect);
  EXPECT_EQ(c.write(0x7000'0000, 1), kInvalidAddress);
  EXPECT_EQ(c.write(0x0D01, 1), kBadAlignment);
  EXPECT_EQ(c.set("PixelFormat", 0x01080001), kInvalidParameter);
  EXPECT_EQ(c.set("ExposureTime", to_word(NAN)), kInvalidParameter);
  EXPECT_EQ(c.set("ExposureTime", to_word(1e9f)), kInvalidParameter);
  EXPECT_EQ(c.set("AcquisitionStart", 7), kInvalidParameter);
  EXPECT_EQ(c.set("PayloadSize", 7), kWriteProtect);
  EXPECT_EQ(c.write(kScda, 0x08080808), kInvalidParameter) << "the twin streams on this machine only";
  EXPECT_EQ(c.status(0x7776, {}), kNotImplemented);
  EXPECT_EQ(c.status(0x0080, {}), kInvalidHeader) << "READREG of nothing";
  EXPECT_EQ(c.status(0x0080, {0, 0, 0}), kInvalidHeader) << "half an address";
  EXPECT_EQ(c.status(0x0086, {0, 0, 9, 0x38}), kInvalidHeader) << "WRITEMEM of nothing";
  EXPECT_EQ(c.status(0x0084, {0, 0, 0, 0, 0, 0, 0, 3}), kBadAlignment) << "READMEM of three bytes";
  EXPECT_EQ(c.status(0x0084, {0, 0, 0, 0, 0, 0, 0xFF, 0xFC}), kInvalidParameter) << "READMEM of 64 KB";
  Bytes wrong_length = c.command(0x0080, {0, 0, 0, 0});
  wrong_length[5] = 8;
  EXPECT_EQ(number(c.exchange(wrong_length), 0, 2), kInvalidHeader);
  EXPECT_EQ(number(c.exchange({0x42, 1, 0, 2, 0, 0, 0, 0}), 0, 2), kInvalidHeader) << "request id 0";
}

TEST_F(GigeVision, ConcatenatedCommandsStopAtTheFirstError) {
  start();
  Client& c = *client_;
  ASSERT_EQ(c.write(kCcp, 2), kSuccess);
  Bytes pairs;
  for (const uint32_t word : {kHeartbeat, 900u, 0x0000u, 5u, kHeartbeat, 800u}) append(pairs, word, 4);
  const Bytes ack = c.exchange(c.command(0x0082, pairs));
  EXPECT_EQ(number(ack, 0, 2), kWriteProtect);
  EXPECT_EQ(number(ack, 10, 2), 1u) << "index of the failing pair";
  EXPECT_EQ(c.read(kHeartbeat), 900u);
  Bytes addresses;
  for (const uint32_t address : {0x0000u, kHeartbeat}) append(addresses, address, 4);
  const Bytes values = c.exchange(c.command(0x0080, addresses));
  ASSERT_EQ(values.size(), 16u);
  EXPECT_EQ(number(values, 8, 4), 0x00020000u);
  EXPECT_EQ(number(values, 12, 4), 900u);
  Bytes memory;
  append(memory, kScps, 4);
  append(memory, 2000, 4);
  append(memory, 77, 4);
  EXPECT_EQ(c.status(0x0086, memory), kSuccess) << "WRITEMEM of two registers";
  EXPECT_EQ(c.read(kScps), 2000u);
  EXPECT_EQ(c.read(kScpd), 77u);
}

TEST_F(GigeVision, OnlyTheControllerMayWrite) {
  start();
  Client& first = *client_;
  Client second(options_.address);
  ASSERT_EQ(first.write(kCcp, 2), kSuccess);
  EXPECT_EQ(first.read(0x0A04), first.udp().port());
  EXPECT_EQ(second.write(kCcp, 2), kAccessDenied);
  EXPECT_EQ(second.write(kCcp, 0), kAccessDenied) << "nobody releases another's control";
  EXPECT_EQ(second.set("Width", 32), kAccessDenied);
  EXPECT_EQ(second.read_status(kCcp), kSuccess) << "control access lets others monitor";
  ASSERT_EQ(first.write(kCcp, 1), kSuccess);
  EXPECT_EQ(second.read_status(kCcp), kAccessDenied) << "exclusive access does not";
  ASSERT_EQ(first.write(kCcp, 0), kSuccess);
  EXPECT_EQ(second.write(kCcp, 2), kSuccess);
  EXPECT_EQ(first.write(kHeartbeat, 1000), kAccessDenied);
}

TEST_F(GigeVision, ALostHeartbeatReleasesControlAndStopsTheStream) {
  start();
  start_streaming();
  ASSERT_EQ(client_->write(kHeartbeat, 500), kSuccess);
  const auto silent_since = Clock::now();
  Client other(options_.address);
  EXPECT_EQ(other.read(kCcp), 2u);
  ASSERT_TRUE(eventually([&] { return other.read(kCcp) == 0; })) << "another's reads are no heartbeat";
  EXPECT_GE(Clock::now() - silent_since, 450ms);
  EXPECT_EQ(other.read(kScp), 0u);
  ASSERT_EQ(other.write(kCcp, 2), kSuccess);
  EXPECT_EQ(other.set("TriggerSoftware", 1), kAccessDenied) << "acquisition has stopped";
}

TEST_F(GigeVision, ReadsKeepControlAlive) {
  start();
  ASSERT_EQ(client_->write(kCcp, 2), kSuccess);
  ASSERT_EQ(client_->write(kHeartbeat, 500), kSuccess);
  const auto until = Clock::now() + 1200ms;
  bool kept = true;
  while (Clock::now() < until) kept = kept && client_->read(kCcp) == 2;
  EXPECT_TRUE(kept);
}

TEST_F(GigeVision, DescribesTheFeaturesOfA3dCamera) {
  options_.coordinates[2] = {0.25f, 400, -7};
  start();
  Client& c = *client_;
  ASSERT_EQ(c.write(kCcp, 2), kSuccess);
  for (const char* name : {"DeviceVendorName",
                           "DeviceTemperature",
                           "Width",
                           "PixelFormat",
                           "PayloadSize",
                           "TLParamsLocked",
                           "TriggerSoftware",
                           "ExposureTime",
                           "Scan3dDistanceUnit",
                           "Scan3dCoordinateSystem",
                           "Scan3dOutputMode",
                           "Scan3dCoordinateSelector",
                           "Scan3dCoordinateScale",
                           "Scan3dCoordinateOffset",
                           "Scan3dInvalidDataFlag",
                           "Scan3dInvalidDataValue",
                           "Scan3dFocalLength",
                           "Scan3dPrincipalPointU",
                           "ChunkModeActive",
                           "ChunkEnable",
                           "ChunkFrameID",
                           "ChunkTimestamp",
                           "ChunkExposureTime",
                           "GevSCPSPacketSize",
                           "GevCCP"}) {
    EXPECT_NE(c.xml().find(std::string(" Name=\"") + name + "\""), std::string::npos) << name;
    EXPECT_NE(c.xml().find(std::string("<pFeature>") + name + "</pFeature>"), std::string::npos) << name;
  }
  EXPECT_EQ(c.get("Width"), 64u);
  EXPECT_EQ(c.get("PixelFormat"), 0x026000C0u);
  EXPECT_EQ(c.get("PayloadSize"), 64u * 48u * 12u);
  // Selected features are consecutive words: the third one is CoordinateC.
  EXPECT_EQ(to_float(c.read(c.feature("Scan3dCoordinateScale") + 8)), 0.25f);
  EXPECT_EQ(to_float(c.read(c.feature("Scan3dCoordinateOffset") + 8)), 400.0f);
  EXPECT_EQ(to_float(c.read(c.feature("Scan3dInvalidDataValue") + 8)), -7.0f);
  EXPECT_EQ(to_float(c.get("Scan3dFocalLength")), 2400.0f);
}

/// Parameter: extended (64-bit) ids.
class GigeVisionStream : public GigeVision, public testing::WithParamInterface<bool> {
 protected:
  void start_streaming_in_mode(uint32_t packet_size) {
    ASSERT_EQ(client_->write(kCcp, 2), kSuccess);
    ASSERT_EQ(client_->write(kGvspConfiguration, GetParam() ? 0x40000000u : 0u), kSuccess);
    start_streaming(packet_size);
  }
};

INSTANTIATE_TEST_SUITE_P(Ids, GigeVisionStream, testing::Values(false, true),
                         [](const auto& ids) { return ids.param ? "Extended" : "Standard"; });

TEST_P(GigeVisionStream, AFrameArrivesAsItWasExposed) {
  options_.coordinates = {Scan3dCoordinate{0.5f, -20, -1e4f}, Scan3dCoordinate{2, 0, -2e4f},
                          Scan3dCoordinate{-1, 300, 0}};
  start();
  start_streaming_in_mode(1500);
  ASSERT_EQ(client_->set("ExposureTime", to_word(25000)), kSuccess);
  const size_t header = GetParam() ? 20 : 8;
  for (uint64_t frame = 1; frame <= 3; ++frame) {
    const Received block = trigger_and_receive();
    EXPECT_EQ(block.id, frame);
    ASSERT_EQ(block.leader.size(), 36u);
    EXPECT_EQ(number(block.leader, 2, 2), 0x0001u) << "image";
    EXPECT_GT(number(block.leader, 4, 8), 0u) << "timestamp";
    EXPECT_EQ(number(block.leader, 12, 4), 0x026000C0u);
    EXPECT_EQ(number(block.leader, 16, 4), 64u);
    EXPECT_EQ(number(block.leader, 20, 4), 48u);
    ASSERT_EQ(block.trailer.size(), 8u);
    EXPECT_EQ(number(block.trailer, 4, 4), 48u);
    // The packet size counts IP, UDP and GVSP headers; only the last packet may be smaller.
    const size_t per_packet = 1500 - 28 - header;
    ASSERT_EQ(block.payload.size(), (64 * 48 * 12 + per_packet - 1) / per_packet);
    EXPECT_EQ(block.payload.rbegin()->first, block.payload.size());
    for (const auto& [id, content] : block.payload) {
      if (id != block.payload.size()) {
        EXPECT_EQ(content.size(), per_packet);
      }
    }
    EXPECT_EQ(block.joined().size(), client_->get("PayloadSize"));
    expect_image(block.joined(), 0, 0, 64, 48);
  }
  EXPECT_DOUBLE_EQ(exposure_s_, 0.025);
  EXPECT_EQ(to_float(client_->get("DeviceTemperature")), 36.5f);
}

TEST_P(GigeVisionStream, LostPacketsCanBeAskedForAgain) {
  start();
  camera_->set_faults({.drop_every_nth_packet = 3});
  ASSERT_EQ(client_->write(kCcp, 2), kSuccess);
  ASSERT_EQ(client_->write(kGvcpConfiguration, 0x4), kSuccess) << "extended status codes";
  start_streaming_in_mode(576);
  ASSERT_EQ(client_->set("TriggerSoftware", 1), kSuccess);
  ASSERT_TRUE(eventually([&] { return camera_->statistics().frames_sent == 1; }));
  const uint64_t dropped = camera_->statistics().packets_dropped;
  ASSERT_GT(dropped, 10u);

  Received block;
  std::map<uint32_t, bool> seen;
  while (const auto bytes = stream_.receive(200ms)) {
    const Packet packet = parse_gvsp(*bytes);
    EXPECT_EQ(packet.status, kSuccess);
    seen[packet.id] = true;
    file(packet, block);
  }
  const size_t per_packet = 576 - 28 - (GetParam() ? 20 : 8);
  const auto last = static_cast<uint32_t>((64 * 48 * 12 + per_packet - 1) / per_packet + 1);
  EXPECT_EQ(seen.size(), last + 1 - dropped);
  for (uint32_t id = 0; id <= last; ++id) {
    if (seen.contains(id)) continue;
    Bytes payload;
    append(payload, 0, 2);
    append(payload, GetParam() ? 0 : 1, 2);
    append(payload, id, 4);
    append(payload, id, 4);
    if (GetParam()) append(payload, 1, 8);
    client_->udp().send(options_.address, client_->command(0x0040, payload, GetParam() ? 0x10 : 0));
    const auto bytes = stream_.receive(kPatience);
    ASSERT_TRUE(bytes) << "packet " << id;
    const Packet packet = parse_gvsp(*bytes);
    EXPECT_EQ(packet.id, id);
    EXPECT_EQ(packet.status, 0x0100) << "GEV_STATUS_PACKET_RESEND";
    EXPECT_EQ(packet.marked_resent, GetParam());
    file(packet, block);
  }
  ASSERT_EQ(block.trailer.size(), 8u);
  expect_image(block.joined(), 0, 0, 64, 48);
  EXPECT_EQ(camera_->statistics().packets_resent, dropped);
}

TEST_F(GigeVision, WhatIsNotInMemoryIsReportedUnavailable) {
  options_.resend_frames = 1;
  start();
  start_streaming();
  trigger_and_receive();
  trigger_and_receive();
  ask_again(1, 3, 3);
  const auto bytes = stream_.receive(kPatience);
  ASSERT_TRUE(bytes);
  const Packet packet = parse_gvsp(*bytes);
  EXPECT_EQ(packet.status, 0x800C);
  EXPECT_EQ(packet.block, 1u);
  EXPECT_EQ(packet.id, 3u);
  EXPECT_TRUE(packet.content.empty());
  // 0xFFFFFF means: to the end of the block. An end that does not exist is answered as far as it exists.
  ask_again(2, 20, 0xFFFFFF);
  Received tail;
  while (tail.trailer.empty()) {
    const auto again = stream_.receive(kPatience);
    ASSERT_TRUE(again);
    EXPECT_EQ(parse_gvsp(*again).status, kSuccess) << "extended status codes were not asked for";
    file(parse_gvsp(*again), tail);
  }
  EXPECT_EQ(tail.payload.begin()->first, 20u);
  EXPECT_FALSE(stream_.receive(100ms)) << "nothing beyond the trailer";
}

TEST_F(GigeVision, ChunksFollowTheImage) {
  start();
  ASSERT_EQ(client_->write(kCcp, 2), kSuccess);
  ASSERT_EQ(client_->set("ChunkModeActive", 1), kSuccess);
  for (uint32_t i = 0; i < 3; ++i)
    ASSERT_EQ(client_->write(client_->feature("ChunkEnable") + 4 * i, 1), kSuccess);
  start_streaming();
  ASSERT_EQ(client_->set("ExposureTime", to_word(12500)), kSuccess);
  trigger_and_receive();
  const Received block = trigger_and_receive();
  EXPECT_EQ(number(block.leader, 2, 2), 0x4001u) << "image with extended chunk";
  const Bytes payload = block.joined();
  EXPECT_EQ(payload.size(), client_->get("PayloadSize"));
  ASSERT_EQ(block.trailer.size(), 16u);
  EXPECT_EQ(number(block.trailer, 8, 4), payload.size());
  EXPECT_NE(number(block.trailer, 12, 4), 0u) << "chunk layout id";

  // Chunks are walked from the end: data, id, length.
  std::map<uint64_t, Bytes> chunks;
  size_t end = payload.size();
  while (end > 0) {
    ASSERT_GE(end, 8u);
    const size_t length = number(payload, end - 4, 4);
    ASSERT_LE(length, end - 8);
    chunks[number(payload, end - 8, 4)] =
        Bytes(payload.end() - static_cast<std::ptrdiff_t>(payload.size() - (end - 8 - length)),
              payload.end() - static_cast<std::ptrdiff_t>(payload.size() - (end - 8)));
    end -= 8 + length;
  }
  const auto chunk = [&](const std::string& port) {
    const size_t node = client_->xml().find("<Port Name=\"" + port + "\">");
    return chunks.at(
        std::stoul(client_->xml().substr(client_->xml().find("<ChunkID>", node) + 9), nullptr, 16));
  };
  EXPECT_EQ(chunks.size(), 4u);
  EXPECT_EQ(number(chunk("FrameIdPort"), 0, 8), 2u);
  EXPECT_EQ(number(chunk("TimestampPort"), 0, 8), number(block.leader, 4, 8));
  const uint64_t bits = number(chunk("ExposureTimePort"), 0, 8);
  double exposure_us;
  std::memcpy(&exposure_us, &bits, sizeof exposure_us);
  EXPECT_DOUBLE_EQ(exposure_us, 12500);
  expect_image(payload, 0, 0, 64, 48);
}

TEST_F(GigeVision, ARegionIsCutOutAndStaysFixedDuringAcquisition) {
  start();
  Client& c = *client_;
  ASSERT_EQ(c.write(kCcp, 2), kSuccess);
  EXPECT_EQ(c.set("OffsetX", 8), kInvalidParameter) << "the whole sensor leaves no room";
  ASSERT_EQ(c.set("Width", 40), kSuccess);
  ASSERT_EQ(c.set("Height", 30), kSuccess);
  ASSERT_EQ(c.set("OffsetX", 24), kSuccess);
  ASSERT_EQ(c.set("OffsetY", 5), kSuccess);
  EXPECT_EQ(c.set("Width", 41), kInvalidParameter);
  start_streaming();
  const Received block = trigger_and_receive();
  EXPECT_EQ(number(block.leader, 16, 4), 40u);
  EXPECT_EQ(number(block.leader, 24, 4), 24u);
  EXPECT_EQ(number(block.leader, 28, 4), 5u);
  EXPECT_EQ(block.joined().size(), 40u * 30u * 12u);
  expect_image(block.joined(), 24, 5, 40, 30);
  for (const char* name : {"Width", "OffsetY", "ChunkModeActive", "AcquisitionMode"}) {
    EXPECT_EQ(c.set(name, 1), kAccessDenied) << name;
  }
  EXPECT_EQ(c.write(kScps, 8000), kAccessDenied);
  ASSERT_EQ(c.set("AcquisitionStop", 1), kSuccess);
  EXPECT_EQ(c.set("Width", 32), kSuccess);
}

TEST_F(GigeVision, ATriggerIsNeverQueued) {
  start();
  ASSERT_EQ(client_->write(kCcp, 2), kSuccess);
  EXPECT_EQ(client_->set("TriggerSoftware", 1), kAccessDenied) << "no acquisition";
  start_streaming();
  hold(true);
  ASSERT_EQ(client_->set("TriggerSoftware", 1), kSuccess);
  ASSERT_TRUE(wait_for_exposures(1));
  EXPECT_EQ(client_->set("TriggerSoftware", 1), kBusy);
  hold(false);
  EXPECT_EQ(receive_block().id, 1u);
  EXPECT_EQ(trigger_and_receive().id, 2u);
  EXPECT_FALSE(stream_.receive(100ms)) << "the refused trigger exposed nothing";
  EXPECT_EQ(exposures_, 2);
}

TEST_F(GigeVision, ARepeatedRequestIsAnsweredButNotExecutedTwice) {
  start();
  start_streaming();
  Bytes payload;
  append(payload, client_->feature("TriggerSoftware"), 4);
  append(payload, 1, 4);
  const Bytes trigger = client_->command(0x0082, payload);
  EXPECT_EQ(number(client_->exchange(trigger), 0, 2), kSuccess);
  receive_block();
  EXPECT_EQ(number(client_->exchange(trigger), 0, 2), kSuccess);
  EXPECT_FALSE(stream_.receive(200ms));
  EXPECT_EQ(exposures_, 1);
}

TEST_F(GigeVision, BlockIdsSkipZero) {
  options_.first_block_id = 0xFFFE;
  start();
  start_streaming();
  std::vector<uint64_t> ids;
  for (int i = 0; i < 4; ++i) ids.push_back(trigger_and_receive().id);
  EXPECT_EQ(ids, (std::vector<uint64_t>{0xFFFE, 0xFFFF, 1, 2}));
}

TEST_F(GigeVision, SingleFrameStopsByItself) {
  start();
  ASSERT_EQ(client_->write(kCcp, 2), kSuccess);
  ASSERT_EQ(client_->set("AcquisitionMode", 1), kSuccess);
  start_streaming();
  trigger_and_receive();
  EXPECT_TRUE(eventually([&] { return client_->set("TriggerSoftware", 1) == kAccessDenied; }));
  EXPECT_EQ(exposures_, 1);
}

TEST_F(GigeVision, RunsFreelyWithoutTrigger) {
  start();
  ASSERT_EQ(client_->write(kCcp, 2), kSuccess);
  ASSERT_EQ(client_->set("AcquisitionFrameRate", to_word(20)), kSuccess);
  start_streaming();
  ASSERT_EQ(client_->set("TriggerMode", 0), kSuccess);
  EXPECT_EQ(receive_block().id, 1u);
  EXPECT_EQ(receive_block().id, 2u);
  EXPECT_EQ(receive_block().id, 3u);
}

TEST_F(GigeVision, StoppingLetsTheCurrentFrameFinishButClosingDiscardsIt) {
  start();
  start_streaming();
  hold(true);
  ASSERT_EQ(client_->set("TriggerSoftware", 1), kSuccess);
  ASSERT_TRUE(wait_for_exposures(1));
  ASSERT_EQ(client_->set("AcquisitionStop", 1), kSuccess);
  hold(false);
  EXPECT_EQ(receive_block().id, 1u);

  hold(true);
  ASSERT_EQ(client_->set("AcquisitionStart", 1), kSuccess);
  ASSERT_TRUE(eventually([&] { return client_->set("TriggerSoftware", 1) == kSuccess; }));
  ASSERT_TRUE(wait_for_exposures(2));
  ASSERT_EQ(client_->write(kScp, 0), kSuccess);
  ASSERT_EQ(client_->write(kScp, stream_.port()), kSuccess);
  hold(false);
  EXPECT_TRUE(eventually([&] { return camera_->statistics().frames_lost == 1; }));
  EXPECT_EQ(trigger_and_receive().id, 1u) << "ids begin anew, and the old frame does not show up";
}

TEST_F(GigeVision, TestPacketHasExactlyTheAskedSize) {
  start();
  ASSERT_EQ(client_->write(kCcp, 2), kSuccess);
  ASSERT_EQ(client_->write(kScda, kLoopback), kSuccess);
  ASSERT_EQ(client_->write(kScp, stream_.port()), kSuccess);
  for (const uint32_t size : {576u, 1500u, 9000u, 65500u}) {
    ASSERT_EQ(client_->write(kScps, 0x80000000u | size), kSuccess);
    const auto packet = stream_.receive(kPatience);
    ASSERT_TRUE(packet);
    EXPECT_EQ(packet->size(), size - 28);
    EXPECT_EQ(client_->read(kScps), size) << "the fire bit clears itself";
  }
  ASSERT_EQ(client_->write(kScps, 0x80000000u | 100u), kSuccess);
  EXPECT_FALSE(stream_.receive(100ms)) << "no test packet of an unsupported size";
  EXPECT_EQ(client_->read(kScps), 576u) << "rounded";
}

TEST_F(GigeVision, NeverSendsFasterThanPaced) {
  options_.width = 512;
  options_.height = 256;
  options_.pacing_mb_per_s = 10;
  xyz_.assign(size_t{3} * 512 * 256, 1.0f);
  start();
  start_streaming(8000);
  ASSERT_EQ(client_->set("TriggerSoftware", 1), kSuccess);
  const auto first = stream_.receive(kPatience);
  const auto begin = Clock::now();
  ASSERT_TRUE(first);
  const Received block = receive_block();
  const std::chrono::duration<double> duration = Clock::now() - begin;
  EXPECT_EQ(block.joined().size(), size_t{12} * 512 * 256);
  // The first and last bursts of at most 64 KiB are not waited for.
  EXPECT_GE(duration.count(), (12.0 * 512 * 256 - 2 * 72e3) / 10e6 - 0.005);
}

TEST_F(GigeVision, AFailedExposureLosesTheFrameAndSaysWhy) {
  start();
  start_streaming();
  set_failing(true);
  ASSERT_EQ(client_->set("TriggerSoftware", 1), kSuccess);
  ASSERT_TRUE(eventually([&] { return camera_->statistics().frames_lost == 1; }));
  EXPECT_EQ(camera_->statistics().last_error, "projector lamp is broken");
  set_failing(false);
  expect_image(trigger_and_receive().joined(), 0, 0, 64, 48);
}

TEST_F(GigeVision, ASilentCameraComesBack) {
  start();
  camera_->set_faults({.silent = true});
  const Bytes read = client_->command(0x0080, {0, 0, 0, 0});
  EXPECT_TRUE(client_->exchange(read, 200ms).empty());
  camera_->set_faults({});
  EXPECT_EQ(client_->read(0x0000), 0x00020000u);
}

TEST_F(GigeVision, HostileDatagramsDoNoHarm) {
  start();
  start_streaming();
  Client other(options_.address);
  std::mt19937 random(11);
  const auto send = [&](const Bytes& bytes) { client_->udp().send(options_.address, bytes); };
  const auto drain = [&] {
    while (client_->udp().receive(0ms)) {
    }
    while (stream_.receive(0ms)) {
    }
  };
  for (int i = 0; i < 20000; ++i) {
    Bytes bytes(std::uniform_int_distribution<size_t>(0, i % 50 == 0 ? 60000 : 600)(random));
    for (uint8_t& byte : bytes) byte = static_cast<uint8_t>(random());
    // Mostly well-formed headers around nonsense.
    if (bytes.size() >= 8 && i % 4 != 0) {
      const uint16_t codes[] = {0x0002, 0x0040, 0x0080, 0x0082, 0x0084, 0x0086, 0x0004, 0x0100};
      const uint16_t code = codes[random() % 8];
      bytes[0] = 0x42;
      bytes[2] = static_cast<uint8_t>(code >> 8);
      bytes[3] = static_cast<uint8_t>(code);
      if (i % 3 != 0) {
        bytes[4] = static_cast<uint8_t>((bytes.size() - 8) >> 8);
        bytes[5] = static_cast<uint8_t>(bytes.size() - 8);
      }
      // Aim at memory that exists.
      if (bytes.size() >= 12 && i % 2 == 0) {
        const uint32_t address = (random() % 2 != 0 ? 0xA000u : 0x0900u) + random() % 0x500;
        for (size_t b = 0; b < 4; ++b) bytes[8 + b] = static_cast<uint8_t>((address & ~3u) >> (24 - 8 * b));
      }
    }
    send(bytes);
    if (i % 50 != 0) continue;
    // Lets the camera catch up, so that little is lost in between.
    ASSERT_EQ(other.status(0x0002, {}), kSuccess) << "after datagram " << i;
    drain();
  }
  // Every truncation of every command, and resend requests at the edges of their ranges.
  for (const uint16_t code : {0x0002, 0x0040, 0x0080, 0x0082, 0x0084, 0x0086}) {
    const Bytes whole = client_->command(code, Bytes(24, 0xFF));
    for (size_t size = 0; size <= whole.size(); ++size) {
      send(Bytes(whole.begin(), whole.begin() + static_cast<std::ptrdiff_t>(size)));
    }
  }
  for (const uint32_t first : {0u, 1u, 0xFFFFFEu, 0xFFFFFFu}) {
    for (const uint32_t last : {0u, 1u, 0xFFFFFFu}) ask_again(0xFFFF, first, last);
  }
  EXPECT_EQ(other.status(0x0002, {}), kSuccess) << "discovery is answered whoever has control";
  EXPECT_GT(camera_->statistics().discarded_datagrams, 1000u);
  EXPECT_GT(camera_->statistics().commands, 5000u);

  // It still takes pictures, once all that nonsense may have set is put right.
  drain();
  ASSERT_EQ(client_->write(kCcp, 2), kSuccess);
  ASSERT_EQ(client_->set("AcquisitionStop", 1), kSuccess);
  ASSERT_EQ(client_->write(kScp, 0), kSuccess);
  drain();
  for (const char* name : {"OffsetX", "OffsetY", "ChunkModeActive", "AcquisitionMode"}) {
    ASSERT_EQ(client_->set(name, 0), kSuccess) << name;
  }
  ASSERT_EQ(client_->write(kGvspConfiguration, 0), kSuccess);
  ASSERT_EQ(client_->write(kScpd, 0), kSuccess);
  ASSERT_EQ(client_->set("Width", 64), kSuccess);
  ASSERT_EQ(client_->set("Height", 48), kSuccess);
  start_streaming();
  expect_image(trigger_and_receive().joined(), 0, 0, 64, 48);
}

}  // namespace
}  // namespace gantry
