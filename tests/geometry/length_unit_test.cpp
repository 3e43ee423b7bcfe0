#include "gantry/geometry/length_unit.h"

#include <gtest/gtest.h>

#include <random>

#include "foundation/expect_input_error.h"

namespace gantry {
namespace {

SizedFile part(const Eigen::Vector3f& size_mm, const std::string& unit = "mm",
               const std::string& option = "--reference-unit") {
  return {"part.stl", size_mm, unit, option};
}

void expect_words(const std::string& words, const std::vector<std::string>& parts) {
  for (const std::string& expected : parts)
    EXPECT_NE(words.find(expected), std::string::npos) << "'" << expected << "' is not in: " << words;
}

TEST(LengthUnit, MillimetresInEach) {
  EXPECT_EQ(millimetres_in("mm"), 1);
  EXPECT_EQ(millimetres_in("cm"), 10);
  EXPECT_EQ(millimetres_in("m"), 1000);
  EXPECT_EQ(millimetres_in("inch"), 25.4);
  for (const std::string& unit : length_units()) EXPECT_GT(millimetres_in(unit), 0);
  expect_input_error([] { millimetres_in("furlong"); }, {"furlong", "inch"});
}

TEST(LengthUnit, ABracketOfATenthOfAMillimetreIsQuestioned) {
  expect_words(questioned_size(part({0.12f, 0.08f, 0.06f})),
               {"part.stl is 0.12 x 0.08 x 0.06 mm", "is part.stl in metres?", "--reference-unit m"});
  // What is already read in metres may have been in millimetres all along.
  expect_words(questioned_size(part({120'000, 80'000, 60'000}, "m")), {"1.2e+05", "--reference-unit mm"});
  // Without an option there is but one way out.
  expect_words(questioned_size(part({0.12f, 0.08f, 0.06f}, "mm", "")), {"in metres?", "export it anew"});
  expect_words(questioned_size(part({1e-9f, 0, 0})), {"true size"});
}

TEST(LengthUnit, PlausibleSizesAreNotQuestioned) {
  for (const float across : {2.1f, 120.f, 19'000.f}) EXPECT_EQ(questioned_size(part({across, 0, 0})), "");
  for (const float across : {1.9f, 21'000.f}) EXPECT_NE(questioned_size(part({across, 0, 0})), "");
}

TEST(LengthUnit, SizesThatDifferAreQuestionedWithTheUnitThatExplainsThem) {
  const SizedFile cloud{"scan.ply", {0.12f, 0.08f, 0.06f}, "mm", "--unit"};
  expect_words(questioned_sizes(cloud, part({120, 80, 60}), 5),
               {"part.stl (120 x 80 x 60 mm) is about 1e+03 times as large as scan.ply", "--unit m"});
  const SizedFile whole{"scan.ply", {120, 80, 60}, "mm", "--unit"};
  expect_words(questioned_sizes(whole, part({0.12f, 0.08f, 0.06f}), 5), {"--reference-unit m"});
  expect_words(questioned_sizes(whole, part({4.724f, 3.15f, 2.362f}), 5),
               {"25.4 times", "--reference-unit inch"});
  expect_words(questioned_sizes(whole, part({12, 8, 6}), 5), {"10 times", "--reference-unit cm"});
  // A mistake in the option: the file was in mm.
  expect_words(questioned_sizes(whole, part({120'000, 80'000, 60'000}, "m"), 5), {"--reference-unit mm"});
  // No unit explains a factor of 5.5: still questioned.
  expect_words(questioned_sizes(whole, part({660, 440, 330}), 5), {"5.5 times", "the same part"});
  // Where nothing can be stated, nothing is advised.
  const SizedFile merged{"the merged cloud", {0.12f, 0.08f, 0.06f}, "mm", ""};
  EXPECT_EQ(questioned_sizes(merged, part({120, 80, 60}), 5).find("the merged cloud in"), std::string::npos);
  EXPECT_EQ(questioned_sizes(whole, part({60, 40, 30}), 5), "");
  EXPECT_EQ(questioned_sizes(part({60, 40, 30}), whole, 5), "");
}

TEST(LengthUnit, StraysDoNotMakeACloudLarge) {
  std::mt19937 random(3);
  std::uniform_real_distribution<float> anywhere(0, 1);
  std::vector<Eigen::Vector3f> points;
  for (int i = 0; i < 10'000; ++i)
    points.emplace_back(100 * anywhere(random), 50 * anywhere(random), 20 * anywhere(random));
  for (int i = 0; i < 20; ++i) points.emplace_back(1e5f, -1e5f, 1e5f);
  EXPECT_LT((bulk_size(points) - Eigen::Vector3f(100, 50, 20)).cwiseAbs().maxCoeff(), 3);
  EXPECT_EQ(bulk_size({}), Eigen::Vector3f(0, 0, 0));
  EXPECT_EQ(bulk_size({{1, 2, 3}}), Eigen::Vector3f(0, 0, 0));
}

}  // namespace
}  // namespace gantry
