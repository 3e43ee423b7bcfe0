#pragma once

#include <cstdint>
#include <filesystem>
#include <string>
#include <vector>

#include "gantry/geometry/ray_scene.h"
#include "gantry/geometry/scan.h"
#include "gantry/geometry/triangle_mesh.h"
#include "gantry/sim/sensor.h"

namespace gantry::bench {

/// Names that make_part() knows. "bunny" needs the mesh of the Stanford bunny, which does not come along.
const std::vector<std::string>& part_names();

/// The part as it is scanned, in mm. The bunny is scaled to a height of 150 mm and centred, as in the paper.
/// Throws InputError for an unknown name, or for the bunny without a mesh.
TriangleMesh make_part(const std::string& name, const std::filesystem::path& bunny);

/// How a set of scans is made.
struct ScanSettings {
  size_t views = 8;
  uint64_t view_seed = 1;
  uint64_t noise_seed = 1;
  SensorModel sensor = {};
  double dark_fraction = 0;   ///< Of the measured pixels, dropped in round patches.
  bool without_grid = false;  ///< The points alone, as an unorganised cloud.
};

/// Scans of a part with the poses they were taken from.
struct ScanSet {
  std::vector<TaggedScan> scans;  ///< Tags are the identity: the truth stays out of the methods' sight.
  std::vector<Pose> truth;        ///< part_from_sensor
  Eigen::Vector3d centre;         ///< Of the part; initial poses are wrong about it.
  /// Of each scan some thousand measured points (sensor frame), on which displacement is judged.
  std::vector<std::vector<Eigen::Vector3d>> probes;
  size_t valid_points = 0;  ///< Mean over the scans.
};

/// A part in front of the simulated sensor; made once, scanned many times.
class ScannedPart {
 public:
  /// With `holder` the demo holder stands under the part.
  ScannedPart(const std::string& name, const std::filesystem::path& bunny, bool holder = false);

  ScanSet scan(const ScanSettings& settings) const;
  const std::string& name() const { return name_; }
  const RayScene& scene() const { return scene_; }

 private:
  std::string name_;
  TriangleMesh part_;
  RayScene scene_;
};

/// Initial poses with errors from a band (degrees and mm), and the uncertainty that every method is told:
/// 15 mm and 15 degrees about the part's centre, what `gantry-fusion register` assumes without --prior.
std::vector<UncertainPose> initial_poses(const ScanSet& set, double from, double to, uint64_t seed);

}  // namespace gantry::bench
