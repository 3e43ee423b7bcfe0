#include "gantry/foundation/error.h"

#include <gtest/gtest.h>

#include <set>

namespace gantry {
namespace {

TEST(Error, FaultTextNamesDeviceMessageAndKind) {
  const Fault fault{FaultKind::kNotSettled, "axis tilt (unit 3)", "still moving after 2 s"};
  EXPECT_EQ(fault.text(), "axis tilt (unit 3): still moving after 2 s [not settled]");
  EXPECT_STREQ(DeviceError(fault).what(), fault.text().c_str());
}

TEST(Error, EveryKindHasItsOwnName) {
  std::set<std::string_view> names;
  for (const auto kind :
       {FaultKind::kUnreachable, FaultKind::kTimeout, FaultKind::kProtocol, FaultKind::kRefused,
        FaultKind::kAlarm, FaultKind::kLimit, FaultKind::kNotSettled, FaultKind::kDataLoss})
    names.insert(to_string(kind));
  EXPECT_EQ(names.size(), 8u);
  EXPECT_FALSE(names.contains("unknown"));
}

TEST(Error, ResultCarriesEitherValueOrFault) {
  const Result<int> good = 3;
  const Result<int> bad = fault(FaultKind::kLimit, "axis x", "target beyond 400 mm");
  ASSERT_TRUE(good.has_value());
  EXPECT_EQ(*good, 3);
  ASSERT_FALSE(bad.has_value());
  EXPECT_EQ(bad.error().kind, FaultKind::kLimit);
  EXPECT_EQ(bad.error().text(), "axis x: target beyond 400 mm [limit]");
}

TEST(Error, ExitCodesAreTheOnesThatScriptsRelyOn) {
  EXPECT_EQ(static_cast<int>(ExitCode::kPass), 0);
  EXPECT_EQ(static_cast<int>(ExitCode::kFail), 1);
  EXPECT_EQ(static_cast<int>(ExitCode::kInputError), 2);
  EXPECT_EQ(static_cast<int>(ExitCode::kDeviceFault), 3);
  EXPECT_EQ(static_cast<int>(ExitCode::kUndecided), 4);
}

}  // namespace
}  // namespace gantry
