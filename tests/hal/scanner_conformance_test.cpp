// The rules of Scanner; every implementation instantiates them (see scanner_conformance.h).

#include "hal/scanner_conformance.h"

namespace gantry {

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
