#include "gantry/geometry/cloud_sources.h"

#include <gtest/gtest.h>

#include <fstream>
#include <random>

#include "foundation/expect_input_error.h"
#include "foundation/temporary_folder.h"
#include "gantry/geometry/point_cloud_file.h"

namespace gantry {
namespace {

constexpr size_t kPoints = 40;

/// Points seen by one to three of three scans, poses with a full covariance.
PointCloud sample_cloud() {
  std::mt19937 random(3);
  std::normal_distribution<double> normal;
  PointCloud cloud;
  auto sources = std::make_shared<CloudSources>();
  sources->scans = {"front", "left side", "top"};
  sources->doubt = "top contradicts the others";
  sources->first.push_back(0);
  for (size_t i = 0; i < kPoints; ++i) {
    cloud.points.emplace_back(normal(random), normal(random), normal(random));
    cloud.sigma_mm.push_back(0.01f);
    const size_t scans = 1 + i % 3;
    for (uint16_t k = 0; k < scans; ++k)
      sources->shares.push_back({k, static_cast<uint16_t>(CloudSources::Share::kWhole / scans)});
    sources->first.push_back(static_cast<uint32_t>(sources->shares.size()));
  }
  Eigen::MatrixXd root(18, 20);
  for (auto& value : root.reshaped()) value = normal(random);
  const Eigen::MatrixXd square = root * root.transpose();
  sources->pose_covariance = 0.5 * (square + square.transpose());
  cloud.sources = sources;
  return cloud;
}

void expect_same(const CloudSources& a, const CloudSources& b) {
  EXPECT_EQ(a.scans, b.scans);
  EXPECT_EQ(a.doubt, b.doubt);
  EXPECT_EQ(a.first, b.first);
  ASSERT_EQ(a.shares.size(), b.shares.size());
  for (size_t i = 0; i < a.shares.size(); ++i) {
    EXPECT_EQ(a.shares[i].scan, b.shares[i].scan);
    EXPECT_EQ(a.shares[i].parts, b.shares[i].parts);
  }
}

std::string bytes_of(const std::filesystem::path& path) {
  std::ifstream file(path, std::ios::binary);
  return {std::istreambuf_iterator<char>(file), {}};
}

/// The file of sample_cloud() as text, to be edited.
std::string as_text(const PointCloud& cloud) {
  std::string text = "ply\nformat ascii 1.0\n";
  const CloudSources& s = *cloud.sources;
  for (const auto& name : s.scans) text += "comment gantry scan " + name + "\n";
  text += "comment gantry doubt " + s.doubt + "\n";
  text += "element vertex " + std::to_string(cloud.size()) +
          "\nproperty float x\nproperty float y\nproperty float z\nproperty ushort scans\n" +
          "element scan_share " + std::to_string(s.shares.size()) +
          "\nproperty ushort scan\nproperty ushort parts\nelement pose_covariance " +
          std::to_string(s.pose_covariance.size()) + "\nproperty double number\nend_header\n";
  for (size_t i = 0; i < cloud.size(); ++i)
    text += "1 2 " + std::to_string(i) + " " + std::to_string(s.of(i).size()) + "\n";
  for (const auto& share : s.shares)
    text += std::to_string(share.scan) + " " + std::to_string(share.parts) + "\n";
  for (const double value : s.pose_covariance.reshaped()) text += std::to_string(value) + "\n";
  return text;
}

std::string edited(std::string text, const std::string& from, const std::string& to) {
  const size_t at = text.find(from);
  EXPECT_NE(at, std::string::npos) << from;
  return at == std::string::npos ? text : text.replace(at, from.size(), to);
}

class CloudSourcesFile : public ::testing::Test {
 protected:
  std::filesystem::path file_with(const std::string& text) {
    std::ofstream(folder_ / "edited.ply") << text;
    return folder_ / "edited.ply";
  }
  TemporaryFolder folder_;
  PointCloud cloud_ = sample_cloud();
};

TEST_F(CloudSourcesFile, ComeBackAsTheyWere) {
  write_point_cloud(folder_ / "merged.ply", cloud_, {{"sigma", cloud_.sigma_mm}});
  const PointCloud read = read_point_cloud(folder_ / "merged.ply");
  EXPECT_EQ(read.points, cloud_.points);
  EXPECT_EQ(read.sigma_mm, cloud_.sigma_mm);
  ASSERT_TRUE(read.sources);
  expect_same(*read.sources, *cloud_.sources);
  EXPECT_EQ(read.sources->pose_covariance, cloud_.sources->pose_covariance);
}

TEST_F(CloudSourcesFile, AreAbsentWhereNothingIsSaidOfThem) {
  cloud_.sources = nullptr;
  write_point_cloud(folder_ / "plain.ply", cloud_);
  EXPECT_EQ(read_point_cloud(folder_ / "plain.ply").sources, nullptr);
  EXPECT_EQ(bytes_of(folder_ / "plain.ply").find("scan"), std::string::npos);
}

TEST_F(CloudSourcesFile, ReadAsTextAndInMetres) {
  const auto path = file_with(as_text(cloud_));
  const PointCloud read = read_point_cloud(path), in_metres = read_point_cloud(path, 1000);
  ASSERT_TRUE(read.sources && in_metres.sources);
  expect_same(*read.sources, *cloud_.sources);
  EXPECT_TRUE(read.sources->pose_covariance.isApprox(cloud_.sources->pose_covariance, 1e-5));
  Eigen::VectorXd unit(18);
  for (Eigen::Index i = 0; i < 18; ++i) unit[i] = i % 6 < 3 ? 1 : 1000;
  EXPECT_TRUE(in_metres.sources->pose_covariance.isApprox(unit.asDiagonal() * read.sources->pose_covariance *
                                                          unit.asDiagonal()));
}

TEST_F(CloudSourcesFile, DroppedPointsTakeTheirSharesAlong) {
  size_t dropped = 0;
  const PointCloud read =
      read_point_cloud(file_with(edited(as_text(cloud_), "\n1 2 4 2\n", "\n1 nan 4 2\n")), 1, &dropped);
  EXPECT_EQ(dropped, 1u);
  std::vector<uint32_t> others;
  for (uint32_t i = 0; i < kPoints; ++i)
    if (i != 4) others.push_back(i);
  ASSERT_TRUE(read.sources);
  expect_same(*read.sources, *select(cloud_, others).sources);
}

TEST_F(CloudSourcesFile, WhatDoesNotFitIsNamed) {
  const std::string good = as_text(cloud_);
  const struct {
    const char *from, *to, *message;
  } cases[] = {
      {"comment gantry scan top\n", "", "pose_covariance has 324 numbers; expected 144 for 2 scans"},
      {"\n2 21845\n", "\n3 21845\n", "refers to scan 3, of which there is no"},
      {"\n1 2 4 2\n", "\n1 2 4 3\n", "the shares of vertex 4 sum up to"},
      {"\n1 2 4 2\n", "\n1 2 4 0\n", "vertex 4 claims"},
      {"\n1 2 39 1\n", "\n1 2 39 2\n", "vertex 39 claims"},
      {"0 65535\n", "0 60000\n", "the shares of vertex 0 sum up to 0.91"},
      {"0 65535\n", "0 65536\n", "whole numbers from 0 to 65535"},
      {"0 65535\n", "0 -1\n", "whole numbers from 0 to 65535"},
      {"property ushort parts", "property ushort part", "with the properties scan and parts"},
      {"element pose_covariance 324", "element pose_covariance 323", "pose_covariance has 323 numbers"},
      {"property ushort scans", "property ushort scanned", "vertex 0 claims"},
  };
  for (const auto& c : cases)
    expect_input_error([&] { read_point_cloud(file_with(edited(good, c.from, c.to))); },
                       {"edited.ply", c.message});
  // Negative variance, asymmetry, no number.
  const std::string first = std::to_string(cloud_.sources->pose_covariance(0, 0)) + "\n";
  expect_input_error([&] { read_point_cloud(file_with(edited(good, first, "-1\n"))); },
                     {"no covariance: row 0, column 0"});
  expect_input_error([&] { read_point_cloud(file_with(edited(good, first, "nan\n"))); },
                     {"a number that is not finite"});
  const std::string second = "\n" + std::to_string(cloud_.sources->pose_covariance(1, 0)) + "\n";
  expect_input_error([&] { read_point_cloud(file_with(edited(good, second, "\n0.5\n"))); },
                     {"no covariance: row 0, column 1"});
}

TEST(CloudSources, ASelectionKeepsWhatIsKnownOfItsPoints) {
  const PointCloud cloud = sample_cloud();
  const std::vector<uint32_t> which = {7, 2, 2, 31};
  const PointCloud some = select(cloud, which);
  ASSERT_EQ(some.size(), 4u);
  ASSERT_TRUE(some.sources);
  ASSERT_EQ(some.sources->points(), 4u);
  EXPECT_EQ(some.sources->pose_covariance, cloud.sources->pose_covariance);
  for (size_t i = 0; i < which.size(); ++i) {
    EXPECT_EQ(some.points[i], cloud.points[which[i]]);
    EXPECT_EQ(some.sigma_mm[i], cloud.sigma_mm[which[i]]);
    const auto given = cloud.sources->of(which[i]), kept = some.sources->of(i);
    ASSERT_EQ(given.size(), kept.size());
    for (size_t k = 0; k < given.size(); ++k) EXPECT_EQ(given[k].scan, kept[k].scan);
  }
  EXPECT_TRUE(select(cloud, {}).points.empty());
}

}  // namespace
}  // namespace gantry
