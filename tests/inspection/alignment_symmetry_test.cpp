#include <gtest/gtest.h>

#include <set>

#include "gantry/sim/bracket.h"
#include "gantry/sim/parts.h"
#include "inspection/alignment_samples.h"

namespace gantry {
namespace {

std::multiset<std::string> words_of(const TriangleMesh& mesh) {
  std::multiset<std::string> words;
  for (const EquivalentPose& each : find_symmetries(SignedDistance(mesh), 0.05)) {
    words.insert(each.words);
    std::printf("  %s\n", each.words.c_str());
  }
  return words;
}

TEST(AlignmentSymmetry, ABoxHasFourPoses) {
  EXPECT_EQ(words_of(box_mesh({0, 0, 0}, {80, 60, 40})),
            (std::multiset<std::string>{"turned by 180 degrees about x", "turned by 180 degrees about y",
                                        "turned by 180 degrees about z"}));
}

TEST(AlignmentSymmetry, ASquareColumnHasEight) {
  EXPECT_EQ(words_of(box_mesh({-20, -20, 0}, {20, 20, 70})).size(), 7u);
}

TEST(AlignmentSymmetry, ACubeHasTwentyFour) {
  EXPECT_EQ(words_of(box_mesh({0, 0, 0}, {50, 50, 50})).size(), 23u);
}

TEST(AlignmentSymmetry, TheBracketHasNone) {
  EXPECT_TRUE(words_of(make_bracket()).empty());
}

TEST(AlignmentSymmetry, ASmallFeatureBreaksIt) {
  // A rib of 0.3 mm over a seventieth of the top: more than the tolerance, and everywhere else a box.
  const TriangleMesh box = box_mesh({0, 0, 0}, {80, 60, 40});
  EXPECT_EQ(words_of(merged(box, box_mesh({10, 10, 40}, {18, 18, 40.3f}))).size(), 0u);
}

TEST(AlignmentSymmetry, ATurnedPartIsFreeNotListed) {
  const TriangleMesh part = make_revolved_part(RevolvedFeature::kNone);
  EXPECT_TRUE(words_of(part).empty());
  const AlignmentResult result = align_to_model(mesh_points(part, 20000, 0.02f), SignedDistance(part), {});
  ASSERT_EQ(result.free_motions.size(), 1u);
  EXPECT_EQ(result.free_text().rfind("turning about the axis along z through (", 0), 0u)
      << result.free_text();
  EXPECT_GT(result.covariance.norm(), 100 * result.held_covariance.norm());
}

TEST(AlignmentSymmetry, ARodMayBeTurnedEndForEnd) {
  TriangleMesh rod;  // 30 mm in diameter, 80 mm long
  constexpr int kSegments = 180;
  for (const float z : {0.0f, 80.0f})
    for (int s = 0; s < kSegments; ++s) {
      const float a = 2 * std::numbers::pi_v<float> * static_cast<float>(s) / kSegments;
      rod.vertices.emplace_back(15 * std::cos(a), 15 * std::sin(a), z);
    }
  rod.vertices.emplace_back(0, 0, 0);
  rod.vertices.emplace_back(0, 0, 80);
  for (int s = 0; s < kSegments; ++s) {
    const int next = (s + 1) % kSegments;
    rod.triangles.emplace_back(s, next, kSegments + next);
    rod.triangles.emplace_back(s, kSegments + next, kSegments + s);
    rod.triangles.emplace_back(2 * kSegments, next, s);
    rod.triangles.emplace_back(2 * kSegments + 1, kSegments + s, kSegments + next);
  }
  EXPECT_EQ(words_of(rod),
            (std::multiset<std::string>{"turned end for end (by 180 degrees about any axis across z)"}));
}

TEST(AlignmentSymmetry, AFlatHoldsTheTurnedPart) {
  const TriangleMesh part = make_revolved_part(RevolvedFeature::kFlat);
  const AlignmentResult result = align_to_model(mesh_points(part, 20000, 0.02f), SignedDistance(part), {});
  EXPECT_TRUE(result.free_motions.empty()) << result.free_text();
}

}  // namespace
}  // namespace gantry
