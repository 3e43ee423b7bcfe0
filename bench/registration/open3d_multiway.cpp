#include "open3d_multiway.h"

#include <omp.h>
#include <open3d/geometry/KDTreeSearchParam.h>
#include <open3d/geometry/PointCloud.h>
#include <open3d/pipelines/registration/GeneralizedICP.h>
#include <open3d/pipelines/registration/GlobalOptimization.h>
#include <open3d/pipelines/registration/GlobalOptimizationConvergenceCriteria.h>
#include <open3d/pipelines/registration/GlobalOptimizationMethod.h>
#include <open3d/pipelines/registration/PoseGraph.h>
#include <open3d/pipelines/registration/Registration.h>
#include <open3d/utility/Logging.h>

namespace gantry::bench {
namespace {

namespace o3d = open3d::pipelines::registration;
using Cloud = open3d::geometry::PointCloud;

class Open3dMultiway : public Method {
 public:
  explicit Open3dMultiway(const Open3dSettings& settings) : settings_(settings) {
    open3d::utility::SetVerbosityLevel(open3d::utility::VerbosityLevel::Error);
  }

  Spent add(const TaggedScan& tagged) override {
    const Stopwatch watch;
    Cloud cloud;
    for (size_t i = 0; i < tagged.scan.points.size(); ++i)
      if (tagged.scan.valid(i)) cloud.points_.push_back(tagged.scan.points[i].cast<double>());
    clouds_.push_back(cloud.VoxelDownSample(settings_.voxel_mm));
    clouds_.back()->EstimateNormals(open3d::geometry::KDTreeSearchParamKNN());
    return watch.spent();
  }

  MethodResult run(std::span<const UncertainPose> initial) override {
    const Stopwatch watch;
    std::vector<Cloud> placed;
    for (size_t i = 0; i < clouds_.size(); ++i) {
      placed.push_back(*clouds_[i]);
      placed.back().Transform(initial[i].mean.matrix());
    }
    o3d::PoseGraph graph;
    Eigen::Matrix4d odometry = Eigen::Matrix4d::Identity();
    graph.nodes_.emplace_back(odometry);
    for (size_t source = 0; source < placed.size(); ++source) {
      for (size_t target = source + 1; target < placed.size(); ++target) {
        const Eigen::Matrix4d motion = align(placed[source], placed[target]);
        const Eigen::Matrix6d information = o3d::GetInformationMatrixFromPointClouds(
            placed[source], placed[target], settings_.fine_mm, motion);
        const bool neighbours = target == source + 1;
        if (neighbours) {
          odometry = motion * odometry;
          graph.nodes_.emplace_back(odometry.inverse());
        }
        graph.edges_.emplace_back(static_cast<int>(source), static_cast<int>(target), motion, information,
                                  !neighbours);
      }
    }
    o3d::GlobalOptimization(graph, o3d::GlobalOptimizationLevenbergMarquardt(),
                            o3d::GlobalOptimizationConvergenceCriteria(),
                            o3d::GlobalOptimizationOption(settings_.fine_mm, 0.25, 1.0, 0));
    MethodResult result;
    for (size_t i = 0; i < placed.size(); ++i) {
      UncertainPose pose;
      pose.mean = Pose(graph.nodes_[i].pose_) * initial[i].mean;
      result.part_from_sensor.push_back(pose);
    }
    result.registration = watch.spent();
    return result;
  }

 private:
  Eigen::Matrix4d align(const Cloud& source, const Cloud& target) const {
    const auto stage = [&](double distance, const Eigen::Matrix4d& start) {
      return settings_.generalized_icp
                 ? o3d::RegistrationGeneralizedICP(source, target, distance, start).transformation_
                 : o3d::RegistrationICP(source, target, distance, start,
                                        o3d::TransformationEstimationPointToPlane())
                       .transformation_;
    };
    return stage(settings_.fine_mm, stage(settings_.coarse_mm, Eigen::Matrix4d::Identity()));
  }

  Open3dSettings settings_;
  std::vector<std::shared_ptr<Cloud>> clouds_;
};

}  // namespace

std::unique_ptr<Method> make_open3d_multiway(const Open3dSettings& settings) {
  return std::make_unique<Open3dMultiway>(settings);
}

void set_open3d_threads(int threads) {
  omp_set_num_threads(threads > 0 ? threads : omp_get_num_procs());
}

}  // namespace gantry::bench
