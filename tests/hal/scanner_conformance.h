#pragma once

#include <gtest/gtest.h>

#include <algorithm>
#include <cctype>
#include <cmath>
#include <cstdlib>
#include <functional>
#include <limits>
#include <memory>
#include <ostream>
#include <string>
#include <vector>

#include "gantry/hal/scanner.h"

namespace gantry {

/// One scanner in front of scenes that are known, whatever stands behind it: a camera on the wire, a
/// simulation in this process, a real device before a calibrated target.
struct ScannerUnderTest {
  std::shared_ptr<void> device;      ///< Whatever must outlive the scanner.
  std::unique_ptr<Scanner> scanner;  ///< Not connected yet.
  int width = 0;
  int height = 0;
  /// Puts scene number `scene` before the scanner and returns the scan that an ideal one would take:
  /// mm, sensor frame, NaN where nothing is to be seen. Scenes differ in every measured point, and
  /// each holds measured and empty pixels.
  std::function<Scan(int scene)> show;
  float tolerance_mm = 0;  ///< Of each coordinate.
  double min_exposure_s = 0;
  double max_exposure_s = 0;
  double exposure_step_s = 0;  ///< What the device rounds exposures to.
  double timeout_s = 10;
};

struct ScannerFactory {
  std::string name;
  std::function<ScannerUnderTest()> make;
};

inline void PrintTo(const ScannerFactory& factory, std::ostream* out) {
  *out << factory.name;
}

inline std::string scanner_factory_name(const testing::TestParamInfo<ScannerFactory>& info) {
  return info.param.name;
}

/// The rules of the Scanner interface. Use it for an implementation by
///
///   INSTANTIATE_TEST_SUITE_P(Simulated, ScannerConformance,
///                            testing::Values(ScannerFactory{"InProcess", make_it}), scanner_factory_name);
class ScannerConformance : public testing::TestWithParam<ScannerFactory> {
 protected:
  void SetUp() override { under_test_ = GetParam().make(); }

  Scanner& scanner() { return *under_test_.scanner; }
  CaptureSettings settings() const {
    return {.exposure_s = std::sqrt(under_test_.min_exposure_s * std::min(0.01, under_test_.max_exposure_s)),
            .timeout_s = under_test_.timeout_s};
  }

  void connect() {
    const Result<void> connected = scanner().connect();
    ASSERT_TRUE(connected) << connected.error().text();
  }

  Capture capture() { return capture(settings()); }
  Capture capture(const CaptureSettings& settings) {
    Result<Capture> result = scanner().capture(settings);
    if (!result) {
      ADD_FAILURE() << result.error().text();
      return {};
    }
    return std::move(*result);
  }

  static std::vector<double> numbers_in(const std::string& text) {
    std::vector<double> numbers;
    for (const char* at = text.c_str(); *at != 0;) {
      char* end = nullptr;
      const double value = std::isdigit(static_cast<unsigned char>(*at)) ? std::strtod(at, &end) : 0;
      if (end != nullptr) numbers.push_back(value);
      at = end != nullptr ? end : at + 1;
    }
    return numbers;
  }

  void expect_equal(const Scan& scan, const Scan& truth) {
    ASSERT_EQ(scan.width, truth.width);
    ASSERT_EQ(scan.height, truth.height);
    ASSERT_EQ(scan.points.size(), truth.points.size());
    size_t wrong = 0;
    size_t measured = 0;
    for (size_t i = 0; i < truth.points.size(); ++i) {
      const Eigen::Vector3f& point = scan.points[i];
      if (truth.valid(i)) {
        ++measured;
        // Written so that a NaN counts as wrong.
        const bool equal = (point - truth.points[i]).cwiseAbs().maxCoeff() <= under_test_.tolerance_mm;
        wrong += point.allFinite() && equal ? 0 : 1;
      } else {
        const bool empty = std::isnan(point.x()) && std::isnan(point.y()) && std::isnan(point.z());
        wrong += empty ? 0 : 1;
      }
    }
    EXPECT_EQ(wrong, 0u) << "of " << truth.points.size() << " pixels";
    EXPECT_GT(measured, 0u) << "the scene shows nothing";
    EXPECT_LT(measured, truth.points.size()) << "the scene has no empty pixel";
  }

  ScannerUnderTest under_test_;
};

TEST_P(ScannerConformance, CaptureBeforeConnectIsRefused) {
  const Result<Capture> result = scanner().capture(settings());
  ASSERT_FALSE(result);
  EXPECT_EQ(result.error().kind, FaultKind::kRefused) << result.error().text();
  EXPECT_FALSE(result.error().device.empty());
}

TEST_P(ScannerConformance, InfoIsFilledAfterConnect) {
  ASSERT_NO_FATAL_FAILURE(connect());
  const ScannerInfo& info = scanner().info();
  EXPECT_EQ(info.width, under_test_.width);
  EXPECT_EQ(info.height, under_test_.height);
  EXPECT_FALSE(info.vendor.empty());
  EXPECT_FALSE(info.model.empty());
  EXPECT_FALSE(info.serial.empty());
  EXPECT_FALSE(info.firmware.empty());
}

TEST_P(ScannerConformance, PointsAreTheTruthInMillimetresAndEmptyPixelsAreNan) {
  ASSERT_NO_FATAL_FAILURE(connect());
  const Scan truth = under_test_.show(1);
  expect_equal(capture().scan, truth);
}

TEST_P(ScannerConformance, EachCaptureShowsTheSceneOfItsOwnTime) {
  ASSERT_NO_FATAL_FAILURE(connect());
  const Scan first_truth = under_test_.show(1);
  const Capture first = capture();
  const Scan second_truth = under_test_.show(2);
  const Capture second = capture();
  expect_equal(second.scan, second_truth);
  expect_equal(first.scan, first_truth);  // The second capture did not write into the first.
}

TEST_P(ScannerConformance, FrameIdsAndTimestampsIncrease) {
  ASSERT_NO_FATAL_FAILURE(connect());
  under_test_.show(1);
  Capture before = capture();
  for (int i = 0; i < 5; ++i) {
    const Capture next = capture();
    EXPECT_GT(next.frame_id, before.frame_id);
    EXPECT_GT(next.device_timestamp_ns, before.device_timestamp_ns);
    before.frame_id = next.frame_id;
    before.device_timestamp_ns = next.device_timestamp_ns;
  }
}

TEST_P(ScannerConformance, ExposureIsTheRequestedOne) {
  ASSERT_NO_FATAL_FAILURE(connect());
  under_test_.show(1);
  for (double factor : {1.0, 1.37, 2.0}) {
    CaptureSettings longer = settings();
    longer.exposure_s *= factor;
    EXPECT_NEAR(capture(longer).exposure_s, longer.exposure_s, under_test_.exposure_step_s + 1e-9);
  }
  CaptureSettings shortest = settings();
  shortest.exposure_s = under_test_.min_exposure_s;
  EXPECT_NEAR(capture(shortest).exposure_s, under_test_.min_exposure_s, under_test_.exposure_step_s + 1e-9);
}

TEST_P(ScannerConformance, ExposureOutsideTheRangeIsRefusedNamingTheLimits) {
  ASSERT_NO_FATAL_FAILURE(connect());
  const Scan truth = under_test_.show(1);
  for (double exposure_s : {0.5 * under_test_.min_exposure_s, 2 * under_test_.max_exposure_s, 0.0, -1.0,
                            std::numeric_limits<double>::quiet_NaN()}) {
    CaptureSettings wrong = settings();
    wrong.exposure_s = exposure_s;
    const Result<Capture> result = scanner().capture(wrong);
    ASSERT_FALSE(result) << exposure_s;
    EXPECT_EQ(result.error().kind, FaultKind::kRefused);
    const std::string& message = result.error().message;
    bool names_min = false;
    bool names_max = false;
    for (double value : numbers_in(message)) {
      names_min |= std::abs(value - under_test_.min_exposure_s) < 0.01 * under_test_.min_exposure_s;
      names_max |= std::abs(value - under_test_.max_exposure_s) < 0.01 * under_test_.max_exposure_s;
    }
    EXPECT_TRUE(names_min && names_max) << message;
  }
  expect_equal(capture().scan, truth);  // The refusal left the scanner as it was.
}

TEST_P(ScannerConformance, RepeatedConnectWorks) {
  const Scan truth = under_test_.show(3);
  for (int i = 0; i < 3; ++i) {
    ASSERT_NO_FATAL_FAILURE(connect());
    expect_equal(capture().scan, truth);
  }
  ASSERT_NO_FATAL_FAILURE(connect());
  ASSERT_NO_FATAL_FAILURE(connect());
  expect_equal(capture().scan, truth);
}

}  // namespace gantry
