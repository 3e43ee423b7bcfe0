#include "gantry/hal/genicam_scanner.h"

#include <gtest/gtest.h>

#include <atomic>
#include <chrono>
#include <cmath>
#include <filesystem>
#include <thread>

#include "../../hal/genicam/frame_order.h"
#include "gantry/sim/twin/gige_vision_camera.h"
#include "gvcp_relay.h"
#include "scanner_conformance.h"

namespace gantry {
namespace {

using std::chrono::steady_clock;

double seconds_since(steady_clock::time_point start) {
  return std::chrono::duration<double>(steady_clock::now() - start).count();
}

/// A bowl 300 to 500 mm away whose every pixel depends on the scene number; about a fifth is empty.
Scan make_scene(int width, int height, int scene) {
  Scan scan;
  scan.width = width;
  scan.height = height;
  scan.points.reserve(static_cast<size_t>(width) * height);
  for (int row = 0; row < height; ++row) {
    for (int column = 0; column < width; ++column) {
      const float u = (column - 0.5f * width) / width;
      const float v = (row - 0.5f * height) / width;
      const float z = 300.0f + 10.0f * scene + 150.0f * (u * u + v * v);
      const bool empty = (column * 7 + row * 3 + scene) % 5 == 0;
      // Left of the middle, x passes through the invalid value -100 on purpose: it is an ordinary x.
      scan.points.push_back(empty ? invalid_point() : Eigen::Vector3f(u * z, v * z, z));
    }
  }
  return scan;
}

/// One of the addresses 127.0.0.41 to 49 for this test alone, even while its camera is switched off:
/// tests may run at the same time. The claim is a socket on a port that nobody else uses.
class ClaimedAddress {
 public:
  ClaimedAddress() : fd_(socket(AF_INET, SOCK_DGRAM, 0)) {
    for (int last = 41; last <= 49; ++last) {
      text_ = "127.0.0." + std::to_string(last);
      sockaddr_in address = GvcpPeer::address_of(text_);
      address.sin_port = htons(GvcpPeer::kPort + 1);
      if (bind(fd_, reinterpret_cast<sockaddr*>(&address), sizeof(address)) == 0) return;
    }
    close(fd_);
    throw std::runtime_error("no free address from 127.0.0.41 to 127.0.0.49");
  }
  ~ClaimedAddress() { close(fd_); }
  ClaimedAddress(const ClaimedAddress&) = delete;
  ClaimedAddress& operator=(const ClaimedAddress&) = delete;

  const std::string& text() const { return text_; }

 private:
  int fd_;
  std::string text_;
};

/// The twin's camera and what it shows, alive together.
class CameraOnTheWire {
 public:
  explicit CameraOnTheWire(GigeVisionOptions options) : options_(std::move(options)) {
    options_.address = claim_.text();
    switch_on();
  }

  static GigeVisionOptions small() {
    GigeVisionOptions options;
    options.width = 64;
    options.height = 48;
    return options;
  }

  void switch_on() {
    camera_ = std::make_unique<GigeVisionCamera>(options_,
                                                 [this](double exposure_s) { return expose(exposure_s); });
  }
  void switch_off() { camera_.reset(); }

  Scan show(int scene) {
    scene_ = scene;
    return make_scene(options_.width, options_.height, scene);
  }
  void set_extra_delay_s(double delay_s) { delay_s_ = delay_s; }

  GigeVisionCamera& camera() { return *camera_; }
  const std::string& address() const { return options_.address; }

 private:
  TriggeredFrame expose(double exposure_s) {
    const Scan scan = make_scene(options_.width, options_.height, scene_);
    std::this_thread::sleep_for(std::chrono::duration<double>(exposure_s + delay_s_));
    TriggeredFrame frame;
    frame.xyz.reserve(scan.points.size() * 3);
    for (const Eigen::Vector3f& point : scan.points)
      frame.xyz.insert(frame.xyz.end(), point.data(), point.data() + 3);
    return frame;
  }

  ClaimedAddress claim_;
  GigeVisionOptions options_;
  std::atomic<int> scene_ = 0;
  std::atomic<double> delay_s_ = 0;
  std::unique_ptr<GigeVisionCamera> camera_;
};

SteadyClock steady;

ScannerUnderTest under_test(GigeVisionOptions options, bool packet_socket) {
  auto wire = std::make_shared<CameraOnTheWire>(options);
  GenicamScannerConfig config;
  config.address = wire->address();
  config.packet_socket = packet_socket;
  ScannerUnderTest out;
  out.scanner = make_genicam_scanner(config, steady);
  out.width = options.width;
  out.height = options.height;
  out.show = [wire](int scene) { return wire->show(scene); };
  out.tolerance_mm = 1e-3f;
  out.min_exposure_s = options.min_exposure_us * 1e-6;
  out.max_exposure_s = options.max_exposure_us * 1e-6;
  out.exposure_step_s = 1e-6;
  out.device = wire;
  return out;
}

GigeVisionOptions scaled() {
  GigeVisionOptions options = CameraOnTheWire::small();
  options.coordinates = {Scan3dCoordinate{0.5f, -100.0f, -100.0f}, Scan3dCoordinate{0.25f, 20.0f, 0.0f},
                         Scan3dCoordinate{2.0f, 250.0f, -1.0f}};
  return options;
}

INSTANTIATE_TEST_SUITE_P(
    Genicam, ScannerConformance,
    testing::Values(ScannerFactory{"BestSocket", [] { return under_test(CameraOnTheWire::small(), true); }},
                    ScannerFactory{"UdpSocket", [] { return under_test(CameraOnTheWire::small(), false); }},
                    ScannerFactory{"ScaledAndOffset", [] { return under_test(scaled(), true); }}),
    scanner_factory_name);

class GenicamScanner : public testing::Test {
 protected:
  void SetUp() override { make({}); }

  void make(GenicamScannerConfig config, GigeVisionOptions options = CameraOnTheWire::small()) {
    scanner_.reset();
    wire_.reset();
    wire_ = std::make_unique<CameraOnTheWire>(options);
    config.address = wire_->address();
    scanner_ = make_genicam_scanner(config, steady);
  }

  void connect() {
    const Result<void> connected = scanner_->connect();
    ASSERT_TRUE(connected) << connected.error().text();
  }

  void expect_scene(const Result<Capture>& capture, const Scan& truth) {
    ASSERT_TRUE(capture) << capture.error().text();
    ASSERT_EQ(capture->scan.points.size(), truth.points.size());
    size_t wrong = 0;
    for (size_t i = 0; i < truth.points.size(); ++i) {
      const bool equal = truth.valid(i) ? (capture->scan.points[i] - truth.points[i]).norm() < 1e-3f
                                        : capture->scan.points[i].array().isNaN().all();
      wrong += equal ? 0 : 1;
    }
    EXPECT_EQ(wrong, 0u);
  }

  static constexpr CaptureSettings kQuick{.exposure_s = 0.002, .timeout_s = 2.0};

  std::unique_ptr<CameraOnTheWire> wire_;
  std::unique_ptr<Scanner> scanner_;
};

TEST_F(GenicamScanner, NobodyAtTheAddressIsUnreachable) {
  wire_->switch_off();
  const auto start = steady_clock::now();
  const Result<void> connected = scanner_->connect();
  ASSERT_FALSE(connected);
  EXPECT_EQ(connected.error().kind, FaultKind::kUnreachable) << connected.error().text();
  EXPECT_LT(seconds_since(start), 5.0);
}

TEST_F(GenicamScanner, InfoNamesTheCamera) {
  connect();
  EXPECT_EQ(scanner_->info().vendor, "Gantry");
  EXPECT_EQ(scanner_->info().model, "Twin3D");
  EXPECT_EQ(scanner_->info().serial, "1");
  EXPECT_EQ(scanner_->info().firmware, "1.0");
  EXPECT_EQ(scanner_->info().address, wire_->address());
}

TEST_F(GenicamScanner, FullSizeScansArriveUnharmedThroughBothSockets) {
  for (bool packet_socket : {true, false}) {
    GigeVisionOptions options;
    make({.packet_socket = packet_socket}, options);
    connect();
    double total_s = 0;
    constexpr int kScans = 5;
    for (int i = 0; i < kScans; ++i) {
      const Scan truth = wire_->show(i);
      const auto start = steady_clock::now();
      const Result<Capture> capture = scanner_->capture({.exposure_s = 0.001, .timeout_s = 10.0});
      total_s += seconds_since(start);
      expect_scene(capture, truth);
    }
    RecordProperty(packet_socket ? "best_socket_ms" : "udp_socket_ms",
                   static_cast<int>(1000 * total_s / kScans));
    std::printf("1920x1200 %s: %.0f ms from call to scan, the twin's rendering included\n",
                packet_socket ? "best socket" : "UDP socket", 1000 * total_s / kScans);
  }
}

TEST_F(GenicamScanner, LostPacketsAreAskedForAgainAndCounted) {
  make({.packet_size = 1500});
  connect();
  wire_->camera().set_faults({.drop_every_nth_packet = 7});
  const Scan truth = wire_->show(1);
  const Result<Capture> capture = scanner_->capture(kQuick);
  expect_scene(capture, truth);
  EXPECT_GT(capture->resent_packets, 0);
}

TEST_F(GenicamScanner, PacketsLostForGoodAreADataLossAndTheNextScanIsGood) {
  make({.packet_size = 1500});
  connect();
  wire_->show(1);
  ASSERT_TRUE(scanner_->capture(kQuick));
  wire_->camera().set_faults({.drop_every_nth_packet = 7, .drop_resends = true});
  const Result<Capture> lost = scanner_->capture(kQuick);
  ASSERT_FALSE(lost);
  EXPECT_EQ(lost.error().kind, FaultKind::kDataLoss) << lost.error().text();
  wire_->camera().set_faults({});
  const Scan truth = wire_->show(2);
  expect_scene(scanner_->capture(kQuick), truth);
}

TEST_F(GenicamScanner, AHangingCameraIsAFaultInTimeAndComesBack) {
  make({.connect_timeout_s = 8.0});
  connect();
  wire_->show(1);
  ASSERT_TRUE(scanner_->capture(kQuick));
  wire_->camera().set_faults({.silent = true});
  auto start = steady_clock::now();
  const Result<Capture> hanging = scanner_->capture(kQuick);
  EXPECT_LT(seconds_since(start), kQuick.timeout_s + 1.0);
  ASSERT_FALSE(hanging);
  EXPECT_TRUE(hanging.error().kind == FaultKind::kTimeout || hanging.error().kind == FaultKind::kUnreachable)
      << hanging.error().text();

  start = steady_clock::now();
  const Result<Capture> unconnected = scanner_->capture(kQuick);
  ASSERT_FALSE(unconnected);
  EXPECT_EQ(unconnected.error().kind, FaultKind::kUnreachable) << unconnected.error().text();
  EXPECT_LT(seconds_since(start), 0.5);

  start = steady_clock::now();
  EXPECT_FALSE(scanner_->connect());
  EXPECT_LT(seconds_since(start), 8.5);

  wire_->camera().set_faults({});
  const auto deadline = steady_clock::now() + std::chrono::seconds(20);
  Result<void> connected = scanner_->connect();
  while (!connected && steady_clock::now() < deadline) connected = scanner_->connect();
  ASSERT_TRUE(connected) << connected.error().text();
  const Scan truth = wire_->show(2);
  expect_scene(scanner_->capture(kQuick), truth);
}

TEST_F(GenicamScanner, ACameraThatIsSwitchedOffAndOnAgainIsReconnected) {
  connect();
  wire_->switch_off();
  const auto start = steady_clock::now();
  const Result<Capture> gone = scanner_->capture(kQuick);
  EXPECT_LT(seconds_since(start), kQuick.timeout_s + 1.0);
  ASSERT_FALSE(gone);
  wire_->switch_on();
  connect();
  const Scan truth = wire_->show(4);
  expect_scene(scanner_->capture(kQuick), truth);
}

TEST_F(GenicamScanner, ACameraThatDiesWhileExposingIsAFaultInTime) {
  connect();
  wire_->set_extra_delay_s(1.0);
  std::jthread killer([this] {
    const auto deadline = steady_clock::now() + std::chrono::seconds(2);
    while (wire_->camera().statistics().triggers_accepted == 0 && steady_clock::now() < deadline) {
      std::this_thread::sleep_for(std::chrono::milliseconds(5));
    }
    wire_->camera().set_faults({.silent = true});
  });
  const auto start = steady_clock::now();
  const Result<Capture> gone = scanner_->capture(kQuick);
  EXPECT_LT(seconds_since(start), kQuick.timeout_s + 1.0);
  ASSERT_FALSE(gone);
  EXPECT_EQ(gone.error().kind, FaultKind::kTimeout) << gone.error().text();
}

TEST_F(GenicamScanner, TheDestructorDoesNotWaitForADeadCamera) {
  connect();
  wire_->camera().set_faults({.silent = true});
  auto start = steady_clock::now();
  scanner_.reset();
  EXPECT_LT(seconds_since(start), 2.0);
}

TEST_F(GenicamScanner, ALateFrameIsNeverTakenForTheNextScan) {
  connect();
  wire_->show(1);
  wire_->set_extra_delay_s(0.7);
  const Result<Capture> late = scanner_->capture({.exposure_s = 0.002, .timeout_s = 0.3});
  ASSERT_FALSE(late);
  EXPECT_EQ(late.error().kind, FaultKind::kTimeout) << late.error().text();
  wire_->set_extra_delay_s(0);
  connect();
  const Scan truth = wire_->show(2);
  Result<Capture> next = scanner_->capture(kQuick);
  // The camera may still be busy with the late exposure, and says so.
  const auto deadline = steady_clock::now() + std::chrono::seconds(5);
  while (!next && next.error().kind == FaultKind::kRefused && steady_clock::now() < deadline) {
    next = scanner_->capture(kQuick);
  }
  expect_scene(next, truth);
}

TEST_F(GenicamScanner, WaitsForAnotherClientToFinishAndSaysSoWhenItDoesNot) {
  make({.connect_timeout_s = 1.5});
  // Takes control as a program that then dies: no heartbeat follows (CCP is register 0x0A00).
  GvcpPeer bystander(wire_->address());
  ASSERT_FALSE(bystander.exchange(GvcpPeer::command(GvcpPeer::kWriteRegister, {0x0A00, 2})).empty());
  const Result<void> connected = scanner_->connect();
  ASSERT_FALSE(connected);
  EXPECT_EQ(connected.error().kind, FaultKind::kRefused) << connected.error().text();
  EXPECT_NE(connected.error().message.find("controls the camera"), std::string::npos)
      << connected.error().text();

  GenicamScannerConfig patient;
  patient.address = wire_->address();
  scanner_ = make_genicam_scanner(patient, steady);
  connect();
}

TEST_F(GenicamScanner, RepeatedConnectsLeaveNoFilesAndNoThreadsBehind) {
  const auto count = [](const char* folder) {
    const auto begin = std::filesystem::directory_iterator(folder);
    return static_cast<size_t>(std::distance(begin, std::filesystem::directory_iterator()));
  };
  connect();
  ASSERT_TRUE(scanner_->capture(kQuick));
  // A leak loses one at every connection. One or two may come once: on a busy machine the backend may
  // receive through the other kind of socket.
  const auto files = count("/proc/self/fd") + 2;
  // TBB starts its workers when it likes; every connection has two threads at least.
  const auto threads = count("/proc/self/task") + std::thread::hardware_concurrency();
  const unsigned connections = 4 + std::thread::hardware_concurrency();
  for (unsigned i = 0; i < connections; ++i) connect();
  ASSERT_TRUE(scanner_->capture(kQuick));
  // A thread that has been joined may stay listed for a moment.
  const auto deadline = steady_clock::now() + std::chrono::seconds(5);
  const auto left_behind = [&] {
    return count("/proc/self/fd") > files || count("/proc/self/task") > threads;
  };
  while (left_behind() && steady_clock::now() < deadline)
    std::this_thread::sleep_for(std::chrono::milliseconds(5));
  EXPECT_LE(count("/proc/self/fd"), files);
  EXPECT_LE(count("/proc/self/task"), threads);
}

/// The relay's own address; the camera's are 41 to 49.
std::unique_ptr<GvcpRelay> relay_to(const std::string& camera, std::string& address,
                                    const std::vector<std::pair<std::string, std::string>>& edits) {
  for (int last = 51; last <= 59; ++last) {
    address = "127.0.0." + std::to_string(last);
    try {
      return std::make_unique<GvcpRelay>(address, camera, edits);
    } catch (const std::runtime_error& error) {
      if (std::string(error.what()).find("taken") == std::string::npos) throw;
    }
  }
  throw std::runtime_error("no free address for the relay");
}

class GenicamScannerLacking : public GenicamScanner, public testing::WithParamInterface<const char*> {};

TEST_P(GenicamScannerLacking, IsRefusedByName) {
  const std::string feature = GetParam();
  std::string misnamed = feature;
  misnamed.front() = 'X';
  std::string address;
  const auto relay = relay_to(
      wire_->address(), address,
      {{"\"" + feature + "\"", "\"" + misnamed + "\""}, {">" + feature + "<", ">" + misnamed + "<"}});
  GenicamScannerConfig config;
  config.address = address;
  const auto scanner = make_genicam_scanner(config, steady);
  const Result<void> connected = scanner->connect();
  ASSERT_FALSE(connected);
  EXPECT_EQ(connected.error().kind, FaultKind::kRefused) << connected.error().text();
  EXPECT_NE(connected.error().message.find(feature), std::string::npos) << connected.error().text();
}

INSTANTIATE_TEST_SUITE_P(Features, GenicamScannerLacking,
                         testing::Values("Scan3dCoordinateScale", "Scan3dCoordinateOffset",
                                         "Scan3dInvalidDataFlag", "Scan3dInvalidDataValue",
                                         "Scan3dDistanceUnit", "Scan3dCoordinateSystem", "TriggerSoftware",
                                         "ExposureTime"),
                         [](const auto& lacking) { return std::string(lacking.param); });

TEST_F(GenicamScanner, ACameraWithoutRangeImagesIsRefused) {
  std::string address;
  const auto relay = relay_to(wire_->address(), address, {{"\"Coord3D_ABC32f\"", "\"Mono8\""}});
  const auto scanner = make_genicam_scanner({.address = address}, steady);
  const Result<void> connected = scanner->connect();
  ASSERT_FALSE(connected);
  EXPECT_NE(connected.error().message.find("Coord3D_ABC32f"), std::string::npos) << connected.error().text();
}

TEST_F(GenicamScanner, OtherUnitsOfLengthAreConverted) {
  std::string address;
  const auto relay = relay_to(wire_->address(), address, {{"\"Millimeter\"", "\"Inch\""}});
  const auto scanner = make_genicam_scanner({.address = address, .packet_socket = false}, steady);
  const Result<void> connected = scanner->connect();
  ASSERT_TRUE(connected) << connected.error().text();
  const Scan truth_inch = wire_->show(1);
  const Result<Capture> capture = scanner->capture(kQuick);
  ASSERT_TRUE(capture) << capture.error().text();
  for (size_t i = 0; i < truth_inch.points.size(); ++i) {
    ASSERT_EQ(capture->scan.valid(i), truth_inch.valid(i));
    if (truth_inch.valid(i)) {
      ASSERT_LT((capture->scan.points[i] - 25.4f * truth_inch.points[i]).norm(), 0.01f);
    }
  }
}

TEST_F(GenicamScanner, AFrameThatNobodyAskedForIsNoticed) {
  std::string address;
  auto relay = relay_to(wire_->address(), address, {});
  const auto scanner = make_genicam_scanner({.address = address, .packet_socket = false}, steady);
  const Result<void> connected = scanner->connect();
  ASSERT_TRUE(connected) << connected.error().text();
  wire_->show(1);
  ASSERT_TRUE(scanner->capture(kQuick));
  const auto deadline = steady_clock::now() + std::chrono::seconds(5);
  while (wire_->camera().statistics().triggers_accepted < 2 && steady_clock::now() < deadline) {
    relay->repeat_last_write();  // Refused as long as the camera is busy with the frame before.
  }
  while (wire_->camera().statistics().frames_sent < 2 && steady_clock::now() < deadline) {
    std::this_thread::sleep_for(std::chrono::milliseconds(5));
  }
  ASSERT_EQ(wire_->camera().statistics().frames_sent, 2u);
  Result<Capture> jumped = scanner->capture(kQuick);
  // Sent is not yet received: a frame that comes in after the trigger is taken for the one asked for, and it
  // is the frame left over that tells.
  if (jumped) jumped = scanner->capture(kQuick);
  ASSERT_FALSE(jumped);
  EXPECT_EQ(jumped.error().kind, FaultKind::kDataLoss) << jumped.error().text();
  const Scan truth = wire_->show(2);
  expect_scene(scanner->capture(kQuick), truth);
}

TEST(FrameOrder, EachTriggerBringsTheNextId) {
  FrameOrder order;
  for (uint64_t id = 41; id < 50; ++id) {
    order.triggered();
    EXPECT_FALSE(order.accept(id, false, 1000 * id));
    EXPECT_EQ(order.last_id(), id);
  }
}

TEST(FrameOrder, ARepeatedFrameIsAProtocolFault) {
  FrameOrder order;
  order.triggered();
  ASSERT_FALSE(order.accept(7, false, 1000));
  for (uint64_t id : {7u, 6u}) {
    order.triggered();
    const auto wrong = order.accept(id, false, 2000);
    ASSERT_TRUE(wrong);
    EXPECT_EQ(wrong->kind, FaultKind::kProtocol);
  }
}

TEST(FrameOrder, TimeMustPass) {
  FrameOrder order;
  order.triggered();
  ASSERT_FALSE(order.accept(7, false, 1000));
  order.triggered();
  const auto wrong = order.accept(8, false, 1000);
  ASSERT_TRUE(wrong);
  EXPECT_EQ(wrong->kind, FaultKind::kProtocol);
}

TEST(FrameOrder, ASkippedIdIsALostFrameUnlessItsTriggerIsKnownToHaveFailed) {
  FrameOrder order;
  order.triggered();
  ASSERT_FALSE(order.accept(7, false, 1000));
  order.triggered();
  const auto lost = order.accept(9, false, 2000);
  ASSERT_TRUE(lost);
  EXPECT_EQ(lost->kind, FaultKind::kDataLoss);
  order.triggered();  // This frame came incomplete.
  order.triggered();
  EXPECT_FALSE(order.accept(11, false, 3000));
}

TEST(FrameOrder, ShortIdsRunAroundWithoutZero) {
  FrameOrder order;
  order.triggered();
  ASSERT_FALSE(order.accept(65534, true, 1));
  uint64_t expected = 65534;
  uint64_t time = 1;
  for (uint64_t id : {65535u, 1u, 2u, 3u}) {
    order.triggered();
    ASSERT_FALSE(order.accept(id, true, ++time)) << id;
    EXPECT_EQ(order.last_id(), ++expected);
  }
  for (uint64_t old : {3u, 2u, 65535u}) {
    order.triggered();
    const auto repeated = order.accept(old, true, ++time);
    ASSERT_TRUE(repeated) << old;
    EXPECT_EQ(repeated->kind, FaultKind::kProtocol);
  }
}

}  // namespace
}  // namespace gantry
