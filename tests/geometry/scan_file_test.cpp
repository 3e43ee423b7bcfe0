#include "gantry/geometry/scan_file.h"

#include <gtest/gtest.h>

#include <random>

#include "foundation/expect_input_error.h"
#include "foundation/temporary_folder.h"

namespace gantry {
namespace {

class ScanFileTest : public ::testing::Test {
 protected:
  ScanFileTest() {
    scan_.width = 13;
    scan_.height = 7;
    std::uniform_real_distribution<float> uniform(-200, 200);
    for (int i = 0; i < scan_.width * scan_.height; ++i) {
      const float x = uniform(random_), y = uniform(random_), z = 500 + uniform(random_);
      scan_.points.push_back(i % 4 == 1 ? invalid_point() : Eigen::Vector3f(x, y, z));
    }
  }
  /// Reads a file cut at every twentieth: either InputError that names it, or a scan whose size is sound.
  void expect_sound_when_cut(const std::string& bytes, const std::string& extension) {
    for (int part = 0; part < 20; ++part) {
      SCOPED_TRACE(extension + " cut to " + std::to_string(part) + "/20");
      const auto path = folder_.write("cut" + extension, bytes.substr(0, bytes.size() * part / 20));
      try {
        const Scan scan = read_scan(path).scan;
        EXPECT_EQ(scan.points.size(), static_cast<size_t>(scan.width) * scan.height);
        EXPECT_GT(scan.valid_count(), 0u);
      } catch (const InputError& error) {
        EXPECT_NE(std::string(error.what()).find(path.string()), std::string::npos) << error.what();
      }
    }
  }

  std::mt19937 random_{5};
  TemporaryFolder folder_;
  Scan scan_;
};

const std::string kGridPly =
    "ply\nformat ascii 1.0\nobj_info num_cols 3\nobj_info num_rows 2\nelement vertex 4\n"
    "property float x\nproperty float y\nproperty float z\nelement range_grid 6\n"
    "property list uchar int vertex_indices\nend_header\n"
    "1 2 300\n4 5 600\n7 8 900\n10 11 1200\n"
    "1 0\n0\n1 1\n1 3\n1 2\n0\n";

TEST_F(ScanFileTest, PointsAndGapsComeBackExactly) {
  write_scan(folder_ / "a.pcd", scan_, Pose::Identity());
  const ScanFile read = read_scan(folder_ / "a.pcd");
  EXPECT_FALSE(read.has_pose);
  EXPECT_TRUE(read.scan.organised());
  ASSERT_EQ(read.scan.width, scan_.width);
  ASSERT_EQ(read.scan.height, scan_.height);
  EXPECT_EQ(read.scan.valid_count(), scan_.valid_count());
  for (size_t i = 0; i < scan_.points.size(); ++i) {
    ASSERT_EQ(read.scan.valid(i), scan_.valid(i));
    if (scan_.valid(i))
      ASSERT_EQ(read.scan.points[i], scan_.points[i]);
    else
      ASSERT_TRUE(read.scan.points[i].array().isNaN().all());
  }
  EXPECT_FALSE(std::filesystem::exists(folder_ / "a.pcd.partial"));
}

TEST_F(ScanFileTest, ViewpointKeepsThePose) {
  std::uniform_real_distribution<double> uniform(-1, 1);
  for (int i = 0; i < 50; ++i) {
    const auto vector = [&](double half_size) -> Eigen::Vector3d {
      const double x = uniform(random_), y = uniform(random_), z = uniform(random_);
      return half_size * Eigen::Vector3d(x, y, z);
    };
    const Pose pose = pose_from_position_rpy(vector(3000), vector(3));
    write_scan(folder_ / "a.pcd", scan_, pose);
    const ScanFile read = read_scan(folder_ / "a.pcd");
    ASSERT_TRUE(read.has_pose);
    ASSERT_FALSE(read.has_uncertainty);
    ASSERT_LT(translation_distance(read.part_from_sensor.mean, pose), 1e-12);
    ASSERT_LT((read.part_from_sensor.mean.linear() - pose.linear()).norm(), 1e-14);
  }
}

UncertainPose random_tag(std::mt19937& random, Eigen::Index parameters) {
  std::normal_distribution<double> gauss;
  UncertainPose tag;
  tag.mean = pose_from_position_rpy({100 * gauss(random), 2, 1e-17}, {0.1, gauss(random), 3});
  tag.independent = Matrix6d::NullaryExpr([&] { return 1e-9 * gauss(random); });
  tag.shared_factor = SharedFactor::NullaryExpr(6, parameters, [&] { return 1e-3 * gauss(random); });
  tag.calibration_id = "dial gauge, 2026-01";
  return tag;
}

TEST_F(ScanFileTest, TheUncertaintyOfThePoseComesBackExactly) {
  for (const Eigen::Index parameters : {0, 1, 16}) {
    const UncertainPose tag = random_tag(random_, parameters);
    write_scan(folder_ / "a.pcd", scan_, tag);
    const ScanFile read = read_scan(folder_ / "a.pcd");
    ASSERT_TRUE(read.has_uncertainty);
    EXPECT_TRUE(read.part_from_sensor.mean.isApprox(tag.mean, 1e-14));
    EXPECT_EQ(read.part_from_sensor.independent, tag.independent);
    EXPECT_EQ(read.part_from_sensor.shared_factor, tag.shared_factor);
    EXPECT_EQ(read.part_from_sensor.calibration_id, tag.calibration_id);
    EXPECT_EQ(read.scan.valid_count(), scan_.valid_count());

    // In metres everything is a thousand times larger, but rotations.
    const ScanFile metres = read_scan(folder_ / "a.pcd", 1000);
    EXPECT_TRUE(metres.part_from_sensor.mean.translation().isApprox(1000 * tag.mean.translation(), 1e-14));
    EXPECT_TRUE(
        metres.part_from_sensor.shared().topLeftCorner(3, 3).isApprox(tag.shared().topLeftCorner(3, 3)));
    EXPECT_TRUE(metres.part_from_sensor.shared().topRightCorner(3, 3).isApprox(
        1e3 * tag.shared().topRightCorner(3, 3)));
    EXPECT_TRUE(metres.part_from_sensor.independent.bottomRightCorner(3, 3).isApprox(
        1e6 * tag.independent.bottomRightCorner(3, 3)));
  }
  UncertainPose at_origin = random_tag(random_, 3);
  at_origin.mean = Pose::Identity();
  write_scan(folder_ / "a.pcd", scan_, at_origin);
  EXPECT_TRUE(read_scan(folder_ / "a.pcd").has_pose) << "a tagged pose may be the identity";
}

TEST_F(ScanFileTest, AMutilatedUncertaintyIsRefused) {
  write_scan(folder_ / "a.pcd", scan_, random_tag(random_, 2));
  const std::string whole = TemporaryFolder::read(folder_ / "a.pcd");
  const auto refused_without = [&](const std::string& line, const std::string& replacement,
                                   const std::string& complaint) {
    std::string bytes = whole;
    const size_t begin = bytes.find(line), end = bytes.find('\n', begin) + 1;
    ASSERT_NE(begin, std::string::npos);
    bytes.replace(begin, end - begin, replacement);
    const auto path = folder_.write("b.pcd", bytes);
    expect_input_error([&] { read_scan(path); }, {path.string(), complaint});
  };
  refused_without("# gantry independent", "", "expected the 6 rows of a covariance, found 5");
  refused_without("# gantry independent", "# gantry independent 1 2 3 4 5\n", "expected 6 numbers, found 5");
  refused_without("# gantry shared", "# gantry shared 1 2 3 4 5 6 7\n",
                  "'# gantry shared': expected 6 numbers, found 7");
  refused_without("# gantry shared", "# gantry shared 1 2 x 4 5 6\n", "expected a number, found 'x'");
  refused_without("# gantry shared", "# gantry shared 1 2 nan 4 5 6\n", "expected a number, found 'nan'");
  refused_without("VIEWPOINT", "VIEWPOINT 0 0 0 0 0 0 0\n", "not a rigid pose");
}

TEST_F(ScanFileTest, PlyWithARangeGridIsOrganised) {
  const ScanFile read = read_scan(folder_.write("grid.ply", kGridPly));
  EXPECT_FALSE(read.has_pose);
  ASSERT_EQ(read.scan.width, 3);
  ASSERT_EQ(read.scan.height, 2);
  ASSERT_EQ(read.scan.points.size(), 6u);
  EXPECT_EQ(read.scan.valid_count(), 4u);
  EXPECT_EQ(read.scan.points[read.scan.index(0, 0)], Eigen::Vector3f(1, 2, 300));
  EXPECT_FALSE(read.scan.valid(read.scan.index(1, 0)));
  EXPECT_EQ(read.scan.points[read.scan.index(2, 0)], Eigen::Vector3f(4, 5, 600));
  EXPECT_EQ(read.scan.points[read.scan.index(0, 1)], Eigen::Vector3f(10, 11, 1200));
  EXPECT_EQ(read.scan.points[read.scan.index(1, 1)], Eigen::Vector3f(7, 8, 900));
  EXPECT_FALSE(read.scan.valid(read.scan.index(2, 1)));
}

TEST_F(ScanFileTest, ARangeGridThatPointsOutsideIsRefused) {
  std::string bytes = kGridPly;
  bytes.replace(bytes.find("1 3\n"), 4, "1 9\n");
  const auto path = folder_.write("outside.ply", bytes);
  expect_input_error([&] { read_scan(path); }, {path.string()});
}

TEST_F(ScanFileTest, MetresAreScaledWithTheirPose) {
  const auto path =
      folder_.write("m.pcd",
                    "VERSION 0.7\nFIELDS x y z\nSIZE 4 4 4\nTYPE F F F\nCOUNT 1 1 1\nWIDTH 2\nHEIGHT 1\n"
                    "VIEWPOINT 1 0 0.5 0 1 0 0\nPOINTS 2\nDATA ascii\n0.1 0.2 0.3\nnan 0 1\n");
  const ScanFile read = read_scan(path, 1000);
  EXPECT_FALSE(read.scan.organised());
  EXPECT_TRUE(read.scan.points[0].isApprox(Eigen::Vector3f(100, 200, 300), 1e-6f));
  EXPECT_FALSE(read.scan.valid(1));
  EXPECT_TRUE(read.scan.points[1].array().isNaN().all()) << "a gap is NaN in all three coordinates";
  ASSERT_TRUE(read.has_pose);
  EXPECT_TRUE(read.part_from_sensor.mean.translation().isApprox(Eigen::Vector3d(1000, 0, 500)));
  EXPECT_TRUE(
      read.part_from_sensor.mean.linear().isApprox(Eigen::Vector3d(1, -1, -1).asDiagonal().toDenseMatrix()));
}

TEST_F(ScanFileTest, DoublesInMetresAreTheSamePointsAsFloatsInMillimetres) {
  std::string ascii, binary;
  for (const Eigen::Vector3f& point : scan_.points) {
    const Eigen::Vector3d metres = point.cast<double>() / 1000;
    binary.append(reinterpret_cast<const char*>(metres.data()), 3 * sizeof(double));
    char text[120];
    std::snprintf(text, sizeof text, "%.17g %.17g %.17g\n", metres.x(), metres.y(), metres.z());
    ascii += text;
  }
  const std::string size =
      "WIDTH " + std::to_string(scan_.width) + "\nHEIGHT " + std::to_string(scan_.height);
  const std::string pcd =
      "VERSION 0.7\nFIELDS x y z\nSIZE 8 8 8\nTYPE F F F\nCOUNT 1 1 1\n" + size + "\nDATA ";
  const std::string ply = " 1.0\nelement vertex " + std::to_string(scan_.points.size()) +
                          "\nproperty double x\nproperty double y\nproperty double z\nend_header\n";
  for (const auto& path :
       {folder_.write("a.pcd", pcd + "ascii\n" + ascii), folder_.write("b.pcd", pcd + "binary\n" + binary),
        folder_.write("a.ply", "ply\nformat ascii" + ply + ascii),
        folder_.write("b.ply", "ply\nformat binary_little_endian" + ply + binary)}) {
    const Scan read = read_scan(path, 1000).scan;
    ASSERT_EQ(read.points.size(), scan_.points.size());
    for (size_t i = 0; i < scan_.points.size(); ++i) {
      ASSERT_EQ(read.valid(i), scan_.valid(i)) << path;
      if (scan_.valid(i)) {
        ASSERT_EQ(read.points[i], scan_.points[i]) << path;
      }
    }
  }
}

TEST_F(ScanFileTest, BrokenFilesAreNamed) {
  const auto refused = [&](const std::filesystem::path& path) {
    expect_input_error([&] { read_scan(path); }, {path.string()});
  };
  refused(folder_ / "absent.pcd");
  for (const std::string extension : {".pcd", ".ply"}) {
    std::filesystem::create_directory(folder_ / ("directory" + extension));
    refused(folder_ / ("directory" + extension));
    refused(folder_.write("empty" + extension, ""));
    refused(folder_.write("text" + extension, "Dear reader, this is no scan.\n"));
  }
  refused(folder_.write("scan.txt", "0 0 0\n"));
  const std::string head =
      "VERSION 0.7\nFIELDS x y z\nSIZE 4 4 4\nTYPE F F F\nCOUNT 1 1 1\nWIDTH 1\nHEIGHT 1\n";
  refused(folder_.write("gaps.pcd", head + "VIEWPOINT 0 0 0 1 0 0 0\nPOINTS 1\nDATA ascii\nnan nan nan\n"));
  refused(folder_.write("pose.pcd", head + "VIEWPOINT 0 0 0 0 0 0 0\nPOINTS 1\nDATA ascii\n1 2 3\n"));
  refused(folder_.write("nan_pose.pcd", head + "VIEWPOINT nan 0 0 1 0 0 0\nPOINTS 1\nDATA ascii\n1 2 3\n"));
  refused(folder_.write("no_z.pcd",
                        "VERSION 0.7\nFIELDS x y\nSIZE 4 4\nTYPE F F\nCOUNT 1 1\nWIDTH 1\nHEIGHT 1\n"
                        "VIEWPOINT 0 0 0 1 0 0 0\nPOINTS 1\nDATA ascii\n1 2\n"));
}

/// A PCD of two points, with what is given in place of a line of its header.
std::string small_pcd(const std::string& line = "", const std::string& instead = "") {
  std::string text =
      "VERSION 0.7\nFIELDS x y z\nSIZE 4 4 4\nTYPE F F F\nCOUNT 1 1 1\nWIDTH 2\nHEIGHT 1\n"
      "VIEWPOINT 0 0 0 1 0 0 0\nPOINTS 2\nDATA ascii\n1 2 3\n4 5 6\n";
  if (!line.empty()) text.replace(text.find(line), line.size(), instead);
  return text;
}

TEST_F(ScanFileTest, HeadersThatCannotBeTrueAreRefused) {
  ASSERT_EQ(read_scan(folder_.write("good.pcd", small_pcd())).scan.points.size(), 2u);
  const auto refused = [&](const std::string& line, const std::string& instead, const std::string& message) {
    SCOPED_TRACE(instead);
    const auto path = folder_.write("bad.pcd", small_pcd(line, instead));
    expect_input_error([&] { read_scan(path); }, {path.string(), message});
  };
  refused("VERSION 0.7\n", "VERSION 0.7\n0.7 ", ":2: ");
  refused("FIELDS x y z\n", "", "FIELDS");
  refused("FIELDS x y z", "FIELDS x y x", "twice");
  refused("SIZE 4 4 4", "SIZE 4 4", "expected 3 entries");
  refused("SIZE 4 4 4", "SIZE 4 4 3", "SIZE 3");
  refused("TYPE F F F", "TYPE F F X", "'X'");
  refused("COUNT 1 1 1", "COUNT 1 1 0", "COUNT 0");
  refused("WIDTH 2", "WIDTH -2", "'-2'");
  refused("WIDTH 2", "WIDTH 0", "WIDTH times HEIGHT is 0");
  refused("WIDTH 2\nHEIGHT 1", "WIDTH 18446744073709551615\nHEIGHT 3", "too large");
  refused("POINTS 2", "POINTS 3", "POINTS is 3");
  refused("DATA ascii", "DATA morse", "'morse'");
  refused("1 2 3", "1 2 x", "'x'");
  refused("1 2 3\n4 5 6\n", "1 2 3\n4 5\n", "truncated");
  refused("VIEWPOINT 0 0 0 1 0 0 0", "VIEWPOINT 0 0 0", "VIEWPOINT");
}

TEST_F(ScanFileTest, WhatAHeaderClaimsIsNotSetAside) {
  // Four billion points in 200 bytes: refused at once, not tried.
  std::string four_billion = small_pcd("WIDTH 2", "WIDTH 4294967295");
  four_billion.replace(four_billion.find("POINTS 2"), 8, "POINTS 4294967295");
  for (const std::string data : {"ascii", "binary", "binary_compressed"}) {
    std::string bytes = four_billion;
    bytes.replace(bytes.find("ascii"), 5, data);
    const auto path = folder_.write("huge.pcd", bytes);
    expect_input_error([&] { read_scan(path); }, {path.string(), "4294967295"});
  }
  std::string ply = kGridPly;
  ply.replace(ply.find("vertex 4"), 8, "vertex 4294967295");
  const auto path = folder_.write("huge.ply", ply);
  expect_input_error([&] { read_scan(path); }, {path.string(), "4294967295"});
}

TEST_F(ScanFileTest, ReadsCompressedPcdAsPclWritesIt) {
  // Fields one after the other (x x x, y y y, z z z), packed by LZF: x and y as literal bytes, then the z
  // as a copy of the y, 12 bytes from 12 bytes before.
  std::string bytes = small_pcd("ascii\n1 2 3\n4 5 6\n", "binary_compressed\n");
  bytes.replace(bytes.find("WIDTH 2"), 7, "WIDTH 3");
  bytes.replace(bytes.find("POINTS 2"), 8, "POINTS 3");
  std::string packed(1, '\x17');
  for (const float value : {1.f, 2.f, 3.f, 7.f, 8.f, 9.f})
    packed.append(reinterpret_cast<const char*>(&value), sizeof value);
  packed += std::string("\xe0\x03\x0b", 3);
  const auto size = [](uint32_t n) { return std::string(reinterpret_cast<const char*>(&n), sizeof n); };
  const std::string head = bytes + size(static_cast<uint32_t>(packed.size())) + size(36);
  const Scan scan = read_scan(folder_.write("packed.pcd", head + packed)).scan;
  EXPECT_EQ(scan.points, (std::vector<Eigen::Vector3f>{{1, 7, 7}, {2, 8, 8}, {3, 9, 9}}));

  const auto broken = folder_.write("broken.pcd", head + packed.substr(0, packed.size() - 1) + "\x7f");
  expect_input_error([&] { read_scan(broken); }, {broken.string(), "compressed data is broken"});
  const auto cut = folder_.write("cut.pcd", head + packed.substr(0, 10));
  expect_input_error([&] { read_scan(cut); }, {cut.string(), "truncated"});
}

TEST_F(ScanFileTest, ReadsEveryEncodingOfPly) {
  const auto header = [](const std::string& format) {
    return "ply\r\nformat " + format +
           " 1.0\nelement vertex 1\nproperty uchar red\nproperty double x\nproperty short y\nproperty float "
           "z\n"
           "property list uchar int more\nend_header\n";
  };
  const std::string little("\x07\0\0\0\0\0\0\xf8\x3f\xfe\xff\0\0\x80\x43\1\1\0\0\0", 20);
  const std::string big("\x07\x3f\xf8\0\0\0\0\0\0\xff\xfe\x43\x80\0\0\1\0\0\0\1", 20);
  for (const std::string& file :
       {header("ascii") + "7 +1.5 -2 2.56e2 2 8 9", header("binary_little_endian") + little,
        header("binary_big_endian") + big}) {
    const Scan scan = read_scan(folder_.write("a.ply", file)).scan;
    ASSERT_EQ(scan.points.size(), 1u);
    EXPECT_EQ(scan.points[0], Eigen::Vector3f(1.5f, -2, 256));
  }
}

TEST_F(ScanFileTest, BrokenPlyHeadersAreToldByLine) {
  const auto refused = [&](const std::string& line, const std::string& instead, const std::string& message) {
    SCOPED_TRACE(instead);
    std::string bytes = kGridPly;
    bytes.replace(bytes.find(line), line.size(), instead);
    const auto path = folder_.write("bad.ply", bytes);
    expect_input_error([&] { read_scan(path); }, {path.string(), message});
  };
  refused("ply\n", "plya\n", ":1: ");
  refused("format ascii", "format utf8", ":2: ");
  refused("format ascii 1.0\n", "", "format");
  refused("obj_info num_rows 2", "obj_info num_rows 3", "num_rows 3");
  refused("obj_info num_cols 3", "obj_info num_cols 9223372036854775809", "num_cols 9223372036854775809");
  refused("element vertex 4", "element vertex -4", ":5: ");
  refused("float x", "float128 x", "'float128'");
  refused("property float x", "property x", ":6: ");
  refused("float y", "float x", "twice");
  refused("element vertex 4", "property float a\nelement vertex 4", "before the first element");
  refused("1 0\n0\n", "1.5 0\n0\n", "a list of 1.5");
  refused("1 3\n", "1 -1\n", "does not exist");
  refused("element vertex", "element points", "expected one element 'vertex'");
}

TEST_F(ScanFileTest, APlyMayTellTheGridAndThePoseOfItsCamera) {
  const std::string text =
      "ply\nformat ascii 1.0\nelement vertex 2\nproperty float x\nproperty float y\nproperty float z\n"
      "element camera 1\nproperty float view_px\nproperty float x_axisx\nproperty float y_axisx\n"
      "property float x_axisy\nproperty float y_axisy\nproperty int viewportx\nproperty int viewporty\n"
      "end_header\n1 2 3\n4 5 6\n100 0 1 -1 0 1 2\n";
  const ScanFile read = read_scan(folder_.write("camera.ply", text));
  EXPECT_EQ(read.scan.width, 1);
  EXPECT_EQ(read.scan.height, 2);
  EXPECT_TRUE(read.has_pose);
  EXPECT_EQ(read.part_from_sensor.mean.translation(), Eigen::Vector3d(100, 0, 0));
  EXPECT_TRUE(read.part_from_sensor.mean.linear().col(0).isApprox(Eigen::Vector3d::UnitY()));
}

TEST_F(ScanFileTest, TruncatedFilesNeverCrash) {
  write_scan(folder_ / "whole.pcd", scan_, Pose::Identity());
  expect_sound_when_cut(TemporaryFolder::read(folder_ / "whole.pcd"), ".pcd");
  expect_sound_when_cut(kGridPly, ".ply");
}

TEST_F(ScanFileTest, ABinaryScanThatLacksPointsIsRefused) {
  write_scan(folder_ / "whole.pcd", scan_, Pose::Identity());
  std::string bytes = TemporaryFolder::read(folder_ / "whole.pcd");
  bytes.resize(bytes.size() - 12);
  const auto path = folder_.write("cut.pcd", bytes);
  expect_input_error([&] { read_scan(path); }, {path.string()});
}

TEST_F(ScanFileTest, WhatCannotBeWrittenIsNamed) {
  expect_input_error([&] { write_scan(folder_ / "no/such/a.pcd", scan_, Pose::Identity()); },
                     {"no/such/a.pcd"});
  std::filesystem::create_directory(folder_ / "directory.pcd");
  expect_input_error([&] { write_scan(folder_ / "directory.pcd", scan_, Pose::Identity()); },
                     {"directory.pcd"});
}

}  // namespace
}  // namespace gantry
