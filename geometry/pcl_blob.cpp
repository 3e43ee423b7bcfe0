#include "pcl_blob.h"

#include <pcl/console/print.h>
#include <pcl/io/pcd_io.h>
#include <pcl/io/ply_io.h>

#include <algorithm>
#include <cstring>

#include "file_guard.h"
#include "gantry/foundation/error.h"

namespace gantry::internal {

PclBlob read_blob(const std::filesystem::path& path) {
  const std::string name = path.string();
  const std::string extension = path.extension().string();
  if (extension != ".ply" && extension != ".pcd")
    throw InputError(name + ": point clouds are read from .ply or .pcd, not '" + extension + "'");
  require_header(path, extension == ".ply" ? "end_header" : "DATA");
  // PCL reports to the console on its own; our message below says the same once.
  pcl::console::setVerbosityLevel(pcl::console::L_ALWAYS);
  PclBlob blob;
  int version = 0;
  int status = -1;
  try {
    if (extension == ".ply") {
      status = pcl::PLYReader().read(name, blob.cloud, blob.origin, blob.orientation, version);
    } else {
      status = pcl::PCDReader().read(name, blob.cloud, blob.origin, blob.orientation, version);
    }
  } catch (const std::exception& e) {
    throw InputError(name + ": not a readable " + extension.substr(1) + " file: " + e.what());
  }
  if (status < 0)
    throw InputError(name + ": not a readable " + extension.substr(1) + " file (broken or truncated)");
  const size_t count = static_cast<size_t>(blob.cloud.width) * blob.cloud.height;
  if (count == 0) throw InputError(name + ": holds no points");
  if (blob.cloud.data.size() < count * blob.cloud.point_step)
    throw InputError(name + ": is truncated: " + std::to_string(count) + " points announced");
  for (const char* axis : {"x", "y", "z"})
    if (!has_field(blob, axis)) throw InputError(name + ": points have no field '" + axis + "'");
  return blob;
}

bool has_field(const PclBlob& blob, const std::string& field) {
  return std::any_of(blob.cloud.fields.begin(), blob.cloud.fields.end(),
                     [&](const auto& each) { return each.name == field; });
}

std::vector<float> field_values(const PclBlob& blob, const std::string& field,
                                const std::filesystem::path& path) {
  const auto& fields = blob.cloud.fields;
  const auto found =
      std::find_if(fields.begin(), fields.end(), [&](const auto& each) { return each.name == field; });
  if (found == fields.end()) throw InputError(path.string() + ": points have no field '" + field + "'");
  const size_t count = static_cast<size_t>(blob.cloud.width) * blob.cloud.height;
  std::vector<float> values(count);
  for (size_t i = 0; i < count; ++i) {
    const uint8_t* at = blob.cloud.data.data() + i * blob.cloud.point_step + found->offset;
    if (found->datatype == pcl::PCLPointField::FLOAT32) {
      std::memcpy(&values[i], at, sizeof(float));
    } else if (found->datatype == pcl::PCLPointField::FLOAT64) {
      double value = 0;
      std::memcpy(&value, at, sizeof(double));
      values[i] = static_cast<float>(value);
    } else {
      throw InputError(path.string() + ": field '" + field + "' is not float or double");
    }
  }
  return values;
}

pcl::PCLPointCloud2 make_blob(size_t width, size_t height, const std::vector<std::string>& fields) {
  pcl::PCLPointCloud2 cloud;
  cloud.width = static_cast<uint32_t>(width);
  cloud.height = static_cast<uint32_t>(height);
  cloud.is_dense = false;
  cloud.point_step = static_cast<uint32_t>(fields.size() * sizeof(float));
  cloud.row_step = cloud.point_step * cloud.width;
  for (size_t i = 0; i < fields.size(); ++i) {
    pcl::PCLPointField field;
    field.name = fields[i];
    field.offset = static_cast<uint32_t>(i * sizeof(float));
    field.datatype = pcl::PCLPointField::FLOAT32;
    field.count = 1;
    cloud.fields.push_back(field);
  }
  cloud.data.resize(width * height * cloud.point_step);
  return cloud;
}

void set_value(pcl::PCLPointCloud2& cloud, size_t point, size_t field, float value) {
  std::memcpy(cloud.data.data() + point * cloud.point_step + field * sizeof(float), &value, sizeof(float));
}

}  // namespace gantry::internal
