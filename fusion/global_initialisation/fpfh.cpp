#include "global_initialisation/fpfh.h"

#include <pcl/features/fpfh.h>

namespace gantry {

Eigen::MatrixXf compute_fpfh(const PointCloud& cloud, double radius_mm) {
  const auto points = pcl::make_shared<pcl::PointCloud<pcl::PointXYZ>>();
  const auto normals = pcl::make_shared<pcl::PointCloud<pcl::Normal>>();
  for (const auto& p : cloud.points) points->push_back({p.x(), p.y(), p.z()});
  for (const auto& n : cloud.normals) normals->push_back({n.x(), n.y(), n.z()});
  pcl::FPFHEstimation<pcl::PointXYZ, pcl::Normal, pcl::FPFHSignature33> estimation;
  estimation.setInputCloud(points);
  estimation.setInputNormals(normals);
  estimation.setRadiusSearch(radius_mm);
  pcl::PointCloud<pcl::FPFHSignature33> histograms;
  estimation.compute(histograms);
  Eigen::MatrixXf features(33, static_cast<Eigen::Index>(cloud.size()));
  for (size_t i = 0; i < cloud.size(); ++i) {
    const auto column = static_cast<Eigen::Index>(i);
    features.col(column) = Eigen::Map<const Eigen::Matrix<float, 33, 1>>(histograms[i].histogram) / 100;
    if (!features.col(column).allFinite()) features.col(column).setZero();
  }
  return features;
}

}  // namespace gantry
