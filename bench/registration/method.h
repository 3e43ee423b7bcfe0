#pragma once

#include <memory>
#include <span>
#include <string>
#include <vector>

#include "gantry/fusion/paper_parameters.h"
#include "gantry/geometry/scan.h"
#include "stopwatch.h"

namespace gantry::bench {

/// What a method said.
struct MethodResult {
  std::vector<UncertainPose> part_from_sensor;  ///< Covariances only where the method states them.
  std::string reason;  ///< Why it does not trust its result; empty: it does, or never asks itself.
  Spent registration;
};

/// A way to register scans. Preparation (normals, filters, downsampling: what does not depend on the initial
/// poses) is apart from registration, so that scans prepared once serve many initial poses.
class Method {
 public:
  virtual ~Method() = default;
  /// Takes the next scan.
  virtual Spent add(const TaggedScan& scan) = 0;
  virtual MethodResult run(std::span<const UncertainPose> initial) = 0;
};

/// All that this build can run; Open3D's only where its library was found.
const std::vector<std::string>& method_names();
bool is_peer(const std::string& method);
/// Throws InputError for an unknown name.
std::unique_ptr<Method> make_method(const std::string& name);

/// The paper's refined pose graph as the paper has it, on voxel averages alone, with given parameters.
std::unique_ptr<Method> make_paper_study_method(const PaperParameters& parameters);

}  // namespace gantry::bench
