#pragma once

#include <pcl/PCLPointCloud2.h>

#include <Eigen/Geometry>
#include <filesystem>
#include <vector>

namespace gantry::internal {

/// A PLY or PCD file as PCL read it.
struct PclBlob {
  pcl::PCLPointCloud2 cloud;
  Eigen::Vector4f origin = Eigen::Vector4f::Zero();
  Eigen::Quaternionf orientation = Eigen::Quaternionf::Identity();
};

/// Throws InputError naming the file when PCL cannot read it or it holds no x, y, z.
PclBlob read_blob(const std::filesystem::path& path);

/// The named field of every point as float; throws InputError if it has another type.
std::vector<float> field_values(const PclBlob& blob, const std::string& field,
                                const std::filesystem::path& path);
bool has_field(const PclBlob& blob, const std::string& field);

/// An empty blob of `count` points with the given float fields, and access to one of its values.
pcl::PCLPointCloud2 make_blob(size_t width, size_t height, const std::vector<std::string>& fields);
void set_value(pcl::PCLPointCloud2& cloud, size_t point, size_t field, float value);

}  // namespace gantry::internal
