#include "gantry/geometry/point_cloud_file.h"

#include <gtest/gtest.h>

#include <cstring>
#include <random>

#include "foundation/expect_input_error.h"
#include "foundation/temporary_folder.h"

namespace gantry {
namespace {

class PointCloudFile : public ::testing::Test {
 protected:
  PointCloudFile() {
    std::normal_distribution<float> normal;
    const auto vector = [&] {
      const float x = normal(random_), y = normal(random_), z = normal(random_);
      return Eigen::Vector3f(x, y, z);
    };
    for (int i = 0; i < 500; ++i) {
      cloud_.points.push_back(100 * vector());
      cloud_.normals.push_back(vector().normalized());
      deviation_.push_back(normal(random_));
      defect_.push_back(static_cast<float>(i % 3));
    }
  }
  void write(const std::filesystem::path& path) {
    write_point_cloud(path, cloud_, {{"deviation", deviation_}, {"defect", defect_}});
  }

  std::mt19937 random_{6};
  TemporaryFolder folder_;
  PointCloud cloud_;
  std::vector<float> deviation_, defect_;
};

TEST_F(PointCloudFile, RoundTripKeepsPointsAndNormalsInOrder) {
  write(folder_ / "a.ply");
  const PointCloud read = read_point_cloud(folder_ / "a.ply");
  EXPECT_EQ(read.points, cloud_.points);
  ASSERT_TRUE(read.has_normals());
  for (size_t i = 0; i < read.size(); ++i) ASSERT_TRUE(read.normals[i].isApprox(cloud_.normals[i], 1e-6f));
  EXPECT_FALSE(std::filesystem::exists(folder_ / "a.ply.partial"));
}

TEST_F(PointCloudFile, WithoutNormalsNoneAreRead) {
  cloud_.normals.clear();
  write(folder_ / "a.ply");
  const PointCloud read = read_point_cloud(folder_ / "a.ply");
  EXPECT_EQ(read.points, cloud_.points);
  EXPECT_FALSE(read.has_normals());
}

TEST_F(PointCloudFile, FieldsLieInTheFileAsTheHeaderSays) {
  write(folder_ / "a.ply");
  const std::string bytes = TemporaryFolder::read(folder_ / "a.ply");
  std::istringstream header(bytes);
  std::vector<std::string> names;
  bool binary = false, in_vertex = false;
  size_t count = 0;
  for (std::string line; std::getline(header, line) && line != "end_header";) {
    std::istringstream words(line);
    std::string word, type, name;
    words >> word;
    if (word == "format") binary = line.starts_with("format binary_little_endian");
    if (word == "element") {
      words >> name;
      in_vertex = name == "vertex";
      if (in_vertex) words >> count;
    }
    if (word == "property" && in_vertex) {
      words >> type >> name;
      EXPECT_TRUE(type == "float" || type == "float32") << line;
      names.push_back(name);
    }
  }
  EXPECT_TRUE(binary);
  EXPECT_EQ(count, cloud_.size());
  ASSERT_EQ(names, (std::vector<std::string>{"x", "y", "z", "nx", "ny", "nz", "deviation", "defect"}));
  const char* data = bytes.data() + header.tellg();
  for (size_t i = 0; i < count; ++i) {
    std::array<float, 8> row;
    std::memcpy(row.data(), data + i * sizeof(row), sizeof(row));
    ASSERT_EQ(Eigen::Vector3f(row[0], row[1], row[2]), cloud_.points[i]);
    ASSERT_EQ(Eigen::Vector3f(row[3], row[4], row[5]), cloud_.normals[i]);
    ASSERT_EQ(row[6], deviation_[i]);
    ASSERT_EQ(row[7], defect_[i]);
  }
}

TEST_F(PointCloudFile, PointsThatAreNotFiniteAreCountedOrRefused) {
  cloud_.points[3].x() = std::numeric_limits<float>::quiet_NaN();
  cloud_.points[100].z() = std::numeric_limits<float>::infinity();
  write(folder_ / "a.ply");
  expect_input_error([&] { read_point_cloud(folder_ / "a.ply"); },
                     {(folder_ / "a.ply").string(), "2 of 500"});
  size_t dropped = 0;
  const PointCloud read = read_point_cloud(folder_ / "a.ply", 1.0, &dropped);
  EXPECT_EQ(dropped, 2u);
  ASSERT_EQ(read.size(), 498u);
  EXPECT_EQ(read.points[3], cloud_.points[4]);
  EXPECT_TRUE(read.normals[3].isApprox(cloud_.normals[4], 1e-6f)) << "normals must stay with their points";
}

TEST_F(PointCloudFile, UncertaintyMustBeANumberFromZeroUp) {
  for (const char* sigma : {"-0.1", "nan", "inf"}) {
    const auto path =
        folder_.write("s.ply",
                      "ply\nformat ascii 1.0\nelement vertex 1\nproperty float x\nproperty float y\n"
                      "property float z\nproperty float sigma\nend_header\n1 2 3 " +
                          std::string(sigma) + "\n");
    expect_input_error([&] { read_point_cloud(path); }, {path.string(), "point 0", "sigma"});
  }
}

TEST_F(PointCloudFile, UnitScalesPointsButNotNormals) {
  const auto path =
      folder_.write("m.ply",
                    "ply\nformat ascii 1.0\nelement vertex 1\nproperty double x\nproperty double y\n"
                    "property double z\nproperty float normal_x\nproperty float normal_y\n"
                    "property float normal_z\nend_header\n0.001 0.002 0.25 0 0 1\n");
  const PointCloud read = read_point_cloud(path, 1000);
  ASSERT_EQ(read.size(), 1u);
  EXPECT_TRUE(read.points[0].isApprox(Eigen::Vector3f(1, 2, 250), 1e-6f));
  ASSERT_TRUE(read.has_normals());
  EXPECT_EQ(read.normals[0], Eigen::Vector3f::UnitZ());
}

TEST_F(PointCloudFile, NormalsUnderTheirShortNamesAreReadToo) {
  const auto path =
      folder_.write("n.ply",
                    "ply\nformat ascii 1.0\nelement vertex 1\nproperty float x\nproperty float y\n"
                    "property float z\nproperty float nx\nproperty float ny\nproperty float nz\n"
                    "end_header\n1 2 3 0 1 0\n");
  const PointCloud read = read_point_cloud(path);
  ASSERT_TRUE(read.has_normals());
  EXPECT_EQ(read.normals[0], Eigen::Vector3f::UnitY());
}

TEST_F(PointCloudFile, ReadsPcd) {
  const auto path =
      folder_.write("a.pcd",
                    "VERSION 0.7\nFIELDS x y z\nSIZE 4 4 4\nTYPE F F F\nCOUNT 1 1 1\nWIDTH 2\nHEIGHT 1\n"
                    "VIEWPOINT 0 0 0 1 0 0 0\nPOINTS 2\nDATA ascii\n1 2 3\n4 5 6\n");
  const PointCloud read = read_point_cloud(path);
  EXPECT_EQ(read.points, (std::vector<Eigen::Vector3f>{{1, 2, 3}, {4, 5, 6}}));
}

TEST_F(PointCloudFile, TruncatedFilesNeverCrash) {
  write(folder_ / "whole.ply");
  const std::string bytes = TemporaryFolder::read(folder_ / "whole.ply");
  for (int part = 0; part < 20; ++part) {
    SCOPED_TRACE("cut to " + std::to_string(part) + "/20");
    const auto path = folder_.write("cut.ply", bytes.substr(0, bytes.size() * part / 20));
    expect_input_error([&] { read_point_cloud(path); }, {path.string()});
  }
}

TEST_F(PointCloudFile, BrokenFilesAreNamed) {
  const auto refused = [&](const std::filesystem::path& path) {
    expect_input_error([&] { read_point_cloud(path); }, {path.string()});
  };
  refused(folder_ / "absent.ply");
  std::filesystem::create_directory(folder_ / "directory.ply");
  refused(folder_ / "directory.ply");
  refused(folder_.write("empty.ply", ""));
  refused(folder_.write("text.ply", "Dear reader, this is no cloud.\n"));
  refused(folder_.write("cloud.csv", "1,2,3\n"));
  expect_input_error([&] { write(folder_ / "no/such/a.ply"); }, {"no/such/a.ply"});
  expect_input_error([&] { write(folder_ / "directory.ply"); }, {"directory.ply"});
}

}  // namespace
}  // namespace gantry
