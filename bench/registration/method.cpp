#include "method.h"

#include <algorithm>
#include <functional>

#include "gantry/foundation/error.h"
#include "gantry/fusion/global_icp.h"
#include "gantry/fusion/joint.h"
#include "gantry/fusion/pose_graph_registration.h"
#include "gantry/fusion/preprocess.h"
#ifdef GANTRY_BENCH_OPEN3D
#include "open3d_multiway.h"
#endif

namespace gantry::bench {
namespace {

/// One of fusion's own, which differ in the kind of surface they work on.
template <typename Surface>
class FusionMethod : public Method {
 public:
  using Register = std::function<Registration(std::span<const Surface>)>;
  FusionMethod(Surface (*surface_of)(const TaggedScan&, const PreprocessOptions&), Register run)
      : surface_of_(surface_of), run_(std::move(run)) {}

  Spent add(const TaggedScan& scan) override {
    const Stopwatch watch;
    surfaces_.push_back(surface_of_(scan, {}));
    return watch.spent();
  }

  MethodResult run(std::span<const UncertainPose> initial) override {
    for (size_t i = 0; i < surfaces_.size(); ++i) surfaces_[i].part_from_sensor = initial[i];
    const Stopwatch watch;
    Registration registration = run_(surfaces_);
    return {std::move(registration.part_from_sensor), std::move(registration.reason), watch.spent()};
  }

 private:
  Surface (*surface_of_)(const TaggedScan&, const PreprocessOptions&);
  Register run_;
  std::vector<Surface> surfaces_;
};

using OnRanges = FusionMethod<RangeSurface>;
using OnPoints = FusionMethod<ScanSurface>;

}  // namespace

const std::vector<std::string>& method_names() {
  static const std::vector<std::string> names = {
      "joint",       "refined-pose-graph", "pose-graph",
      "global-icp",
#ifdef GANTRY_BENCH_OPEN3D
      "open3d-gicp", "open3d-gicp-narrow", "open3d-point-to-plane",
#endif
  };
  return names;
}

bool is_peer(const std::string& method) {
  return method.starts_with("open3d");
}

std::unique_ptr<Method> make_method(const std::string& name) {
  if (name == "joint")
    return std::make_unique<OnRanges>(make_range_surface,
                                      [](auto scans) { return register_joint(scans, {}); });
  if (name == "refined-pose-graph")
    return std::make_unique<OnPoints>(preprocess,
                                      [](auto scans) { return register_refined_pose_graph(scans, {}); });
  if (name == "pose-graph")
    return std::make_unique<OnPoints>(preprocess, [](auto scans) { return register_pose_graph(scans, {}); });
  if (name == "global-icp")
    return std::make_unique<OnPoints>(preprocess, [](auto scans) { return register_global_icp(scans, {}); });
#ifdef GANTRY_BENCH_OPEN3D
  if (name == "open3d-gicp") return make_open3d_multiway({.generalized_icp = true});
  if (name == "open3d-gicp-narrow")
    return make_open3d_multiway({.coarse_mm = 4, .fine_mm = 2, .generalized_icp = true});
  if (name == "open3d-point-to-plane") return make_open3d_multiway({.generalized_icp = false});
#endif
  std::string known;
  for (const std::string& method : method_names()) known += (known.empty() ? "" : ", ") + method;
  throw InputError("method \"" + name + "\" is not known to this build; expected one of " + known);
}

std::unique_ptr<Method> make_paper_study_method(const PaperParameters& parameters) {
  PoseGraphRegistrationOptions options;
  options.parameters = parameters;
  options.measured_points = false;
  return std::make_unique<OnPoints>(
      preprocess, [options](auto scans) { return register_refined_pose_graph(scans, options); });
}

}  // namespace gantry::bench
