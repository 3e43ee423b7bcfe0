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

}  // namespace gantry
