#include "gantry/fusion/fusion.h"

#include <tbb/parallel_for.h>

#include <algorithm>
#include <array>
#include <chrono>

#include "free_space_check.h"
#include "gantry/foundation/error.h"

namespace gantry {
namespace {

constexpr std::array<std::pair<RegistrationMethod, std::string_view>, 4> kMethods = {
    {{RegistrationMethod::kJoint, "joint"},
     {RegistrationMethod::kRefinedPoseGraph, "refined-pose-graph"},
     {RegistrationMethod::kPoseGraph, "pose-graph"},
     {RegistrationMethod::kGlobalIcp, "global-icp"}}};

class Stopwatch {
 public:
  double seconds() const {
    return std::chrono::duration<double>(std::chrono::steady_clock::now() - begin_).count();
  }

 private:
  std::chrono::steady_clock::time_point begin_ = std::chrono::steady_clock::now();
};

/// Middle of a scan's points, sensor frame.
Eigen::Vector3d centre_of(const RangeSurface& s) {
  Eigen::Vector3d sum = Eigen::Vector3d::Zero();
  double count = 0;
  for (int row = 0; row < s.height; row += 3)
    for (int column = 0; column < s.width; column += 3) {
      if (s.w[s.index(column, row)] == 0) continue;
      sum += s.point(column, row);
      ++count;
    }
  return s.sensor_from_grid * Eigen::Vector3d(sum / std::max(1.0, count));
}

/// The same poses in a part frame of which the origin lies elsewhere: what was at the origin is now at
/// `there`.
void move_origin(UncertainPose& part_from_sensor, const Eigen::Vector3d& there) {
  Pose shift = Pose::Identity();
  shift.translation() = there;
  const Matrix6d of_errors = adjoint(shift);
  part_from_sensor.mean.translation() += there;
  part_from_sensor.shared_factor = of_errors * part_from_sensor.shared_factor;
  part_from_sensor.independent = of_errors * part_from_sensor.independent * of_errors.transpose();
}

/// The paper's methods lay grids over the part and turn scans about its origin. So that the result does not
/// depend on where the origin happens to lie, they work about the middle of the first scan.
Registration register_scans(const std::vector<RangeSurface>& scans, const FusionOptions& options) {
  if (options.method == RegistrationMethod::kJoint) return register_joint(scans, options.joint);
  const Eigen::Vector3d middle = scans[0].part_from_sensor.mean * centre_of(scans[0]);
  std::vector<ScanSurface> surfaces(scans.size());
  tbb::parallel_for(size_t{0}, scans.size(), [&](size_t i) {
    surfaces[i] = scan_surface(scans[i]);
    move_origin(surfaces[i].part_from_sensor, -middle);
  });
  Registration registration;
  if (options.method == RegistrationMethod::kGlobalIcp) {
    registration = register_global_icp(surfaces, options.global_icp);
  } else if (options.method == RegistrationMethod::kRefinedPoseGraph &&
             options.refined_pairwise == PairwiseMethod::kGeneralizedIcp) {
    registration = register_refined_pose_graph(surfaces, options.pose_graph);
  } else {
    registration = register_pose_graph(surfaces, options.pose_graph);
  }
  surfaces.clear();
  for (UncertainPose& pose : registration.part_from_sensor) move_origin(pose, middle);
  registration.part_from_sensor[0].mean = scans[0].part_from_sensor.mean;  // to the last bit
  internal::check_free_space(scans, registration);
  return registration;
}

/// Which scans the kept pairs connect to the first one, directly or through others.
std::vector<bool> connected_scans(size_t count, const std::vector<PairReport>& pairs) {
  std::vector<bool> reached(count, false);
  reached[0] = true;
  for (bool grew = true; grew;) {
    grew = false;
    for (const PairReport& pair : pairs) {
      if (!pair.kept || reached[pair.target] == reached[pair.source]) continue;
      reached[pair.target] = reached[pair.source] = grew = true;
    }
  }
  return reached;
}

std::string advice_for(const FusionResult& result) {
  const auto lost = [](const ScanResult& scan) { return !scan.connected && scan.left_out.empty(); };
  if (std::any_of(result.scans.begin(), result.scans.end(), lost))
    return "add a view that shares surface with the scans named and with the others, or give initial poses "
           "that are nearer to the truth";
  const auto is_left_out = [](const ScanResult& scan) { return !scan.left_out.empty(); };
  if (std::any_of(result.scans.begin(), result.scans.end(), is_left_out))
    return "scan the views that are left out again, or add views beside them; if the part is covered without "
           "them, allow it: --allow-left-out " +
           std::to_string(std::count_if(result.scans.begin(), result.scans.end(), is_left_out));
  double violation = 0;
  for (const ScanReport& scan : result.registration.scans)
    violation = std::max(violation, scan.free_space_violation + scan.opposite_contact);
  if (violation > 0.005)
    return "look at these scans in merged.ply; give initial poses that are nearer to the truth, check that "
           "they are in the order of the scans, or crop what is not the part";
  if (!result.registration.converged)
    return "give initial poses that are nearer to the truth, or use method joint";
  return "add views that show features which hold the part in the direction named, or give initial poses "
         "from calibrated kinematics with their covariance";
}

}  // namespace

std::string_view to_string(RegistrationMethod method) {
  return std::find_if(kMethods.begin(), kMethods.end(), [&](const auto& m) { return m.first == method; })
      ->second;
}

RegistrationMethod registration_method(std::string_view name) {
  std::string names;
  for (const auto& [method, method_name] : kMethods) {
    if (method_name == name) return method;
    names += (names.empty() ? "" : ", ") + std::string(method_name);
  }
  throw InputError("method: must be one of " + names + "; found '" + std::string(name) + "'");
}

namespace {

/// Of the errors of all poses that take part, about the part's origin: those relative to the first scan, and
/// what is not known of where this one was tagged, which moves all of them alike.
Eigen::MatrixXd covariance_of_kept(const FusionResult& result, const UncertainPose& first_as_tagged) {
  std::vector<size_t> kept;
  for (size_t i = 0; i < result.scans.size(); ++i)
    if (result.scans[i].left_out.empty()) kept.push_back(i);
  const auto at = [](size_t scan) { return static_cast<Eigen::Index>(6 * scan); };
  const Eigen::MatrixXd& joint = result.registration.joint_covariance;
  Eigen::MatrixXd covariance(at(kept.size()), at(kept.size()));
  for (size_t i = 0; i < kept.size(); ++i)
    for (size_t j = 0; j < kept.size(); ++j) {
      Matrix6d block = first_as_tagged.covariance();
      if (joint.size() > 0)
        block += joint.block<6, 6>(at(kept[i]), at(kept[j]));
      else if (i == j && kept[i] > 0)
        block += result.scans[kept[i]].part_from_sensor.covariance();
      covariance.block<6, 6>(at(i), at(j)) = block;
    }
  return covariance;
}

}  // namespace

struct Fusion::Impl {
  FusionOptions options;
  std::vector<RangeSurface> scans;
  double preprocess_s = 0;
};

Fusion::Fusion(FusionOptions options) : impl_(std::make_unique<Impl>()) {
  validate(options.preprocess);
  impl_->options = std::move(options);
}
Fusion::~Fusion() = default;
size_t Fusion::size() const {
  return impl_->scans.size();
}

void Fusion::add(const TaggedScan& scan) {
  const Stopwatch watch;
  RangeSurface surface = make_range_surface(scan, impl_->options.preprocess);
  for (const RangeSurface& other : impl_->scans)
    if (other.width == surface.width && other.measured == surface.measured && other.w == surface.w)
      throw InputError("scan " + scan.name + ": holds the same points as " + other.name);
  impl_->scans.push_back(std::move(surface));
  impl_->preprocess_s += watch.seconds();
}

FusionResult Fusion::finish() {
  std::vector<RangeSurface> scans = std::move(impl_->scans);
  if (scans.empty()) throw InputError("registration: there is no scan to register");
  FusionResult result;
  result.method = impl_->options.method;
  result.timings_s.emplace_back("preprocess", impl_->preprocess_s);
  const Stopwatch registering;
  result.sides_guessed = settle_unknown_sides(scans);
  result.registration = register_scans(scans, impl_->options);
  result.timings_s.emplace_back("register", registering.seconds());
  result.reason = result.registration.reason;
  result.trusted = result.reason.empty();

  const UncertainPose first_as_tagged = scans[0].part_from_sensor;
  const Stopwatch comparing;
  std::vector<Pose> before, after;
  for (size_t i = 0; i < scans.size(); ++i) {
    before.push_back(scans[i].part_from_sensor.mean);
    after.push_back(result.registration.part_from_sensor[i].mean);
  }
  std::vector<double> rms_of_scan;
  result.before = overlap_residual(scans, before);
  result.after = overlap_residual(scans, after, &rms_of_scan);
  result.timings_s.emplace_back("residuals", comparing.seconds());

  const std::vector<bool> connected = connected_scans(scans.size(), result.registration.pairs);
  for (size_t i = 0; i < scans.size(); ++i) {
    const RangeSurface& surface = scans[i];
    const Eigen::Vector3d centre = centre_of(surface);
    ScanResult scan;
    scan.name = surface.name;
    scan.part_from_sensor = result.registration.part_from_sensor[i];
    scan.moved_mm = (after[i] * centre - before[i] * centre).norm();
    scan.turned_rad = rotation_distance(before[i], after[i]);
    scan.rms_mm = rms_of_scan[i];
    scan.noise_mm = surface.noise_mm;
    scan.spacing_mm = surface.spacing_mm;
    scan.measured = surface.measured;
    scan.points = surface.usable;
    scan.dropped_crop = surface.dropped_crop;
    scan.dropped_edges = surface.dropped_edges;
    scan.dropped_hidden = surface.dropped_hidden;
    if (i < result.registration.scans.size()) scan.left_out = result.registration.scans[i].left_out;
    scan.connected = scan.left_out.empty() ? connected[i] : result.registration.scans[i].connected;
    result.scans.push_back(std::move(scan));
  }
  if (!result.trusted) result.advice = advice_for(result);

  if (impl_->options.merge_scans) {
    const Stopwatch merging;
    size_t kept = 0;  // Range surfaces are large: moved, not copied.
    for (size_t i = 0; i < scans.size(); ++i) {
      if (!result.scans[i].left_out.empty()) continue;
      if (kept != i) scans[kept] = std::move(scans[i]);
      after[kept++] = after[i];
    }
    scans.resize(kept);
    after.resize(kept);
    result.merged = merge_surfaces(scans, after, impl_->options.merge, &result.merge);
    auto sources = std::make_shared<CloudSources>(*result.merged.sources);
    sources->pose_covariance = covariance_of_kept(result, first_as_tagged);
    if (!result.trusted) sources->doubt = result.reason;
    result.merged.sources = std::move(sources);
    result.timings_s.emplace_back("merge", merging.seconds());
  }
  return result;
}

}  // namespace gantry
