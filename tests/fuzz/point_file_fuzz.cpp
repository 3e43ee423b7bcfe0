// Scans and point clouds, PLY and PCD. The first byte of an input chooses which; the rest is the file.

#include "fuzz.h"
#include "gantry/geometry/point_cloud_file.h"
#include "gantry/geometry/scan_file.h"

namespace gantry::fuzz {
namespace {

constexpr char kPcd = 'C', kPly = 'L';

Scan small_scan() {
  Scan scan{.width = 5, .height = 4, .points = {}};
  for (int i = 0; i < 20; ++i)
    scan.points.push_back(i == 7 ? invalid_point()
                                 : Eigen::Vector3f(0.5f * (i % 5), 0.5f * (i / 5), 400.25f + i));
  return scan;
}

std::string written_cloud() {
  PointCloud cloud;
  for (const Eigen::Vector3f& point : small_scan().points) {
    if (!point.allFinite()) continue;
    cloud.points.push_back(point);
    cloud.normals.emplace_back(0, 0.6f, -0.8f);
    cloud.sigma_mm.push_back(0.05f);
  }
  const TemporaryFolder folder;
  write_point_cloud(folder / "cloud.ply", cloud, {{"sigma", cloud.sigma_mm}});
  return TemporaryFolder::read(folder / "cloud.ply");
}

std::string written_scan() {
  Pose pose = pose_from_position_rpy({100, -20, 300}, {0.1, 2, -3});
  const TemporaryFolder folder;
  write_scan(folder / "scan.pcd", small_scan(), pose);
  return TemporaryFolder::read(folder / "scan.pcd");
}

/// A merged cloud of two points that says which of two scans they come from.
std::string merged_ply() {
  std::string file =
      "ply\nformat ascii 1.0\ncomment gantry scan a\ncomment gantry scan b b\n"
      "comment gantry doubt of b\nelement vertex 2\nproperty float x\nproperty float y\nproperty float z\nproperty ushort scans\n"
      "element scan_share 3\nproperty ushort scan\nproperty ushort parts\nelement pose_covariance 144\n"
      "property double number\nend_header\n1 2 3 2\n4 5 6 1\n0 30000\n1 35535\n1 65535\n";
  for (int i = 0; i < 144; ++i) file += i % 13 == 0 ? "1e-6\n" : "0\n";
  return file;
}

/// A value of the first two kinds of PLY that this program reads but does not write.
const std::string kAsciiPly =
    "ply\nformat ascii 1.0\ncomment by hand\nelement vertex 4\nproperty double x\nproperty double y\n"
    "property double z\nproperty uchar red\nelement face 1\nproperty list uchar int "
    "vertex_indices\nend_header\n"
    "1 2 300 255\n4.5 5 600 0\n-7 8e1 900 1\n10 11 nan 2\n3 0 1 2\n";
const std::string kGridPly =
    "ply\nformat ascii 1.0\nobj_info num_cols 3\nobj_info num_rows 2\nelement vertex 4\nproperty float x\n"
    "property float y\nproperty float z\nelement range_grid 6\nproperty list uchar int "
    "vertex_indices\nend_header\n"
    "1 2 300\n4 5 600\n7 8 900\n10 11 1200\n1 0\n0\n1 1\n1 3\n1 2\n0\n";
const std::string kAsciiPcd =
    "# .PCD v0.7\nVERSION 0.7\nFIELDS x y z normal_x normal_y normal_z rgb\nSIZE 4 4 4 4 4 4 4\nTYPE F F F F "
    "F F U\n"
    "COUNT 1 1 1 1 1 1 1\nWIDTH 2\nHEIGHT 2\nVIEWPOINT 1 2 3 1 0 0 0\nPOINTS 4\nDATA ascii\n"
    "1 2 300 0 0 1 7\nnan nan nan 0 0 1 7\n4 5 600 0 0 1 7\n4 6 600 0 1 0 8\n";

std::string big_endian_ply() {
  std::string file =
      "ply\nformat binary_big_endian 1.0\nelement vertex 2\nproperty float x\nproperty float y\nproperty "
      "float z\n"
      "element face 1\nproperty list uchar int vertex_indices\nend_header\n";
  for (int i = 0; i < 6; ++i) file += std::string("\x3f\x80\0\0", 4);
  return file + std::string("\3\0\0\0\0\0\0\0\1\0\0\0\1", 13);
}

/// One literal run of the LZF format: fields apart, as PCL writes them.
std::string compressed_pcd() {
  std::string packed,
      header =
          "VERSION 0.7\nFIELDS x y z\nSIZE 4 4 4\nTYPE F F F\nCOUNT 1 1 1\nWIDTH 2\nHEIGHT 1\n"
          "VIEWPOINT 0 0 0 1 0 0 0\nPOINTS 2\nDATA binary_compressed\n";
  packed += '\x17';  // 24 literal bytes
  for (int i = 0; i < 6; ++i) packed += std::string("\0\0\x80\x3f", 4);
  return header + std::string("\x19\0\0\0\x18\0\0\0", 8) + packed;
}

}  // namespace

std::vector<std::string> seeds() {
  return {kPcd + written_scan(),   kPly + written_cloud(), kPly + kAsciiPly,        kPly + kGridPly,
          kPly + big_endian_ply(), kPcd + kAsciiPcd,       kPcd + compressed_pcd(), kPly + merged_ply()};
}

}  // namespace gantry::fuzz

int LLVMFuzzerTestOneInput(const uint8_t* data, size_t size) {
  using namespace gantry;
  static const fuzz::InputFile ply("input.ply"), pcd("input.pcd");
  if (size == 0) return 0;
  const auto& path = (data[0] == fuzz::kPcd ? pcd : ply).write(fuzz::text_of(data + 1, size - 1));
  fuzz::value_or_input_error([&] {
    const ScanFile file = read_scan(path);
    if (file.scan.points.size() != static_cast<size_t>(file.scan.width) * file.scan.height)
      throw std::logic_error("a scan whose size is not width * height");
  });
  fuzz::value_or_input_error([&] {
    size_t dropped = 0;
    const PointCloud cloud = read_point_cloud(path, 1000.0, &dropped);
    for (const Eigen::Vector3f& point : cloud.points)
      if (!point.allFinite()) throw std::logic_error("a point that is not finite");
    if (!cloud.sources) return;
    const CloudSources& sources = *cloud.sources;
    if (sources.points() != cloud.size() || sources.first.back() != sources.shares.size())
      throw std::logic_error("shares that do not fit the points");
    for (const CloudSources::Share& share : sources.shares)
      if (share.scan >= sources.scans.size()) throw std::logic_error("a share of no scan");
    const auto numbers = sources.pose_covariance.size();
    if (numbers != 0 &&
        numbers != static_cast<Eigen::Index>(36 * sources.scans.size() * sources.scans.size()))
      throw std::logic_error("a covariance that does not fit the scans");
  });
  return 0;
}
