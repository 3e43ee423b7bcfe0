#include "free_space_check.h"

#include <gtest/gtest.h>

#include "fusion/scenes.h"

namespace gantry {
namespace {

/// Three views around the bracket at their true poses.
struct Views {
  std::vector<RangeSurface> scans;
  Registration registration;
};

Views views() {
  Views v;
  const RayScene scene(make_bracket());
  for (size_t i = 0; i < 3; ++i) {
    const Pose truth = bracket_view(0.4 + 0.6 * static_cast<double>(i), 0.9);
    v.scans.push_back(
        make_range_surface(scan_of(scene, small_sensor(960), truth, i, "view" + std::to_string(i)), {}));
    v.registration.part_from_sensor.emplace_back().mean = truth;
  }
  return v;
}

TEST(FreeSpaceCheck, RightPosesViolateNothing) {
  Views v = views();
  internal::check_free_space(v.scans, v.registration);
  EXPECT_EQ(v.registration.reason, "");
  ASSERT_EQ(v.registration.scans.size(), 3u);
  for (const ScanReport& scan : v.registration.scans) {
    EXPECT_LT(scan.free_space_violation, 0.002);
    EXPECT_LT(scan.opposite_contact, 0.002);
    EXPECT_GT(scan.matches, 500u);
    EXPECT_TRUE(scan.connected);
  }
}

TEST(FreeSpaceCheck, NamesAScanThatLiesWhereAnotherLookedThrough) {
  Views v = views();
  v.registration.part_from_sensor[2].mean.pretranslate(Eigen::Vector3d(0, 0, 6));
  internal::check_free_space(v.scans, v.registration);
  EXPECT_NE(v.registration.reason.find("view2"), std::string::npos) << v.registration.reason;
  EXPECT_GT(v.registration.scans[2].free_space_violation, 0.1);
}

TEST(FreeSpaceCheck, AReasonThatIsKnownAlreadyIsKept) {
  Views v = views();
  v.registration.part_from_sensor[2].mean.pretranslate(Eigen::Vector3d(0, 0, 6));
  v.registration.reason = "did not converge";
  internal::check_free_space(v.scans, v.registration);
  EXPECT_EQ(v.registration.reason, "did not converge");
}

TEST(FreeSpaceCheck, AScanAloneHasNothingToViolate) {
  Views v = views();
  v.scans.resize(1);
  v.registration.part_from_sensor.resize(1);
  internal::check_free_space(v.scans, v.registration);
  EXPECT_EQ(v.registration.reason, "");
  EXPECT_TRUE(v.registration.scans.empty());
}

}  // namespace
}  // namespace gantry
