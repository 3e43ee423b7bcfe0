#include "scan_set.h"

#include <algorithm>
#include <cmath>
#include <numbers>
#include <random>

#include "gantry/foundation/error.h"
#include "gantry/geometry/mesh_file.h"
#include "gantry/sim/bracket.h"
#include "gantry/sim/parts.h"
#include "gantry/sim/scan_set.h"
#include "gantry/sim/views.h"

namespace gantry::bench {
namespace {

constexpr double kBunnyHeightMm = 150;
constexpr double kPriorMm = 15;
constexpr double kPriorRad = 15 * std::numbers::pi / 180;
/// One of so many measured points is a probe.
constexpr size_t kProbeStride = 101;

/// Round patches of lost pixels, as dark paint leaves them, until the fraction is reached.
void drop_patches(Scan& scan, double fraction, uint64_t seed) {
  std::mt19937_64 random(seed);
  std::vector<size_t> valid;
  for (size_t i = 0; i < scan.points.size(); ++i)
    if (scan.valid(i)) valid.push_back(i);
  if (valid.empty()) return;
  const size_t wanted = static_cast<size_t>(fraction * static_cast<double>(valid.size()));
  std::uniform_int_distribution<size_t> pick(0, valid.size() - 1);
  std::uniform_int_distribution<int> size(scan.width / 96, scan.width / 32);
  for (size_t dropped = 0; dropped < wanted;) {
    const size_t middle = valid[pick(random)];
    const int radius = size(random);
    const int row0 = static_cast<int>(middle) / scan.width, column0 = static_cast<int>(middle) % scan.width;
    for (int r = std::max(0, row0 - radius); r <= std::min(scan.height - 1, row0 + radius); ++r) {
      for (int c = std::max(0, column0 - radius); c <= std::min(scan.width - 1, column0 + radius); ++c) {
        const size_t i = scan.index(c, r);
        if (std::hypot(r - row0, c - column0) > radius || !scan.valid(i)) continue;
        scan.points[i] = invalid_point();
        ++dropped;
      }
    }
  }
}

}  // namespace

const std::vector<std::string>& part_names() {
  static const std::vector<std::string> names = {"bunny", "bracket",     "slim-lever",   "prismatic-block",
                                                 "plate", "turned-flat", "turned-bumps", "turned"};
  return names;
}

TriangleMesh make_part(const std::string& name, const std::filesystem::path& bunny) {
  if (name == "bunny") {
    if (bunny.empty()) throw InputError("part bunny: its mesh is needed (--bunny FILE)");
    return scaled_to_height(read_mesh(bunny, 1000), kBunnyHeightMm);
  }
  if (name == "bracket") return make_bracket();
  if (name == "slim-lever") return make_slim_lever();
  if (name == "prismatic-block") return make_prismatic_block();
  if (name == "plate") return make_plate();
  if (name == "turned-flat") return make_revolved_part(RevolvedFeature::kFlat);
  if (name == "turned-bumps") return make_revolved_part(RevolvedFeature::kBumps);
  if (name == "turned") return make_revolved_part(RevolvedFeature::kNone);
  std::string known;
  for (const std::string& part : part_names()) known += (known.empty() ? "" : ", ") + part;
  throw InputError("part \"" + name + "\" is not known; expected one of " + known);
}

ScannedPart::ScannedPart(const std::string& name, const std::filesystem::path& bunny, bool holder)
    : name_(name), part_(make_part(name, bunny)), scene_(holder ? merged(part_, make_holder()) : part_) {}

ScanSet ScannedPart::scan(const ScanSettings& settings) const {
  ScanSet set;
  set.centre = part_.bounds().center().cast<double>();
  set.truth = poisson_disc_views(part_, settings.sensor, settings.views, settings.view_seed);
  for (size_t i = 0; i < set.truth.size(); ++i) {
    TaggedScan tagged;
    tagged.name = "scan " + std::to_string(i);
    tagged.scan = scan_of_view(settings.sensor, scene_, set.truth, i, settings.noise_seed);
    if (settings.dark_fraction > 0)
      drop_patches(tagged.scan, settings.dark_fraction, 1000 * settings.noise_seed + i);
    std::vector<Eigen::Vector3d> probes;
    size_t valid = 0;
    for (size_t p = 0; p < tagged.scan.points.size(); ++p) {
      if (!tagged.scan.valid(p)) continue;
      if (valid++ % kProbeStride == 0) probes.push_back(tagged.scan.points[p].cast<double>());
    }
    set.valid_points += valid;
    set.probes.push_back(std::move(probes));
    if (settings.without_grid) tagged.scan = without_grid(tagged.scan);
    set.scans.push_back(std::move(tagged));
  }
  set.valid_points /= set.scans.size();
  return set;
}

std::vector<UncertainPose> initial_poses(const ScanSet& set, double from, double to, uint64_t seed) {
  Matrix6d at_centre = Matrix6d::Zero();
  at_centre.diagonal().head<3>().setConstant(kPriorRad * kPriorRad);
  at_centre.diagonal().tail<3>().setConstant(kPriorMm * kPriorMm);
  Matrix6d origin_from_centre = Matrix6d::Identity();
  origin_from_centre.bottomLeftCorner<3, 3>() = cross_matrix(set.centre);
  std::vector<UncertainPose> initial;
  for (const Pose& pose : perturbed_poses(set.truth, set.centre, from, to, seed)) {
    UncertainPose& tag = initial.emplace_back();
    tag.mean = pose;
    tag.independent = origin_from_centre * at_centre * origin_from_centre.transpose();
  }
  return initial;
}

}  // namespace gantry::bench
