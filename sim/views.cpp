#include "gantry/sim/views.h"

#include <algorithm>
#include <cmath>
#include <numbers>
#include <optional>
#include <random>

#include "gantry/foundation/error.h"

namespace gantry {
namespace {

using std::numbers::pi;

/// The engine is laid down by the standard, its distributions are not: these are our own.
class Random {
 public:
  /// Streams of one seed are independent of each other.
  Random(uint64_t seed, uint64_t stream) {
    std::seed_seq numbers{seed & 0xFFFFFFFF, seed >> 32, stream & 0xFFFFFFFF, stream >> 32};
    engine_.seed(numbers);
  }

  double uniform(double from, double to) {
    return from + (to - from) * (static_cast<double>(engine_() >> 11) * 0x1.0p-53);
  }
  Eigen::Vector3d direction() {
    const double z = uniform(-1, 1), angle = uniform(-pi, pi);
    const double radius = std::sqrt(std::max(1 - z * z, 0.0));
    return {radius * std::cos(angle), radius * std::sin(angle), z};
  }

 private:
  std::mt19937_64 engine_;
};

double angle_between(const Eigen::Vector3d& a, const Eigen::Vector3d& b) {
  return std::acos(std::clamp(a.dot(b), -1.0, 1.0));
}

/// The widest least angle that `count` directions could have (Fejes Toth's bound), but at most 90 degrees:
/// fewer views need not stand on opposite sides.
double widest_angle_rad(size_t count) {
  if (count < 4) return pi / 2;
  const double n = static_cast<double>(count);
  const double sine = std::sin(n * pi / (6 * (n - 2)));
  return std::min(2 * std::asin(0.5 * std::sqrt(4 - 1 / (sine * sine))), pi / 2);
}

/// Directions in the order of the darts, or fewer when no dart fits.
std::vector<Eigen::Vector3d> throw_darts(size_t count, double least_angle_rad, Random& random) {
  std::vector<Eigen::Vector3d> directions;
  const double most_cosine = std::cos(least_angle_rad);
  for (int missed = 0; directions.size() < count && missed < 200; ++missed) {
    const Eigen::Vector3d dart = random.direction();
    if (std::all_of(directions.begin(), directions.end(),
                    [&](const Eigen::Vector3d& d) { return d.dot(dart) <= most_cosine; })) {
      directions.push_back(dart);
      missed = 0;
    }
  }
  return directions;
}

/// The largest angle from any direction to its nearest neighbour.
double loneliest_rad(const std::vector<Eigen::Vector3d>& directions) {
  double loneliest = 0;
  for (size_t i = 0; i < directions.size(); ++i) {
    double nearest = pi;
    for (size_t j = 0; j < directions.size(); ++j)
      if (i != j) nearest = std::min(nearest, angle_between(directions[i], directions[j]));
    loneliest = std::max(loneliest, nearest);
  }
  return loneliest;
}

/// From each start always on to the nearest that is left; of these paths the one whose longest step is the
/// shortest.
std::vector<Eigen::Vector3d> ordered_as_path(const std::vector<Eigen::Vector3d>& directions) {
  std::vector<Eigen::Vector3d> best;
  double best_step = 2 * pi;
  for (size_t start = 0; start < directions.size(); ++start) {
    std::vector<Eigen::Vector3d> path = directions;
    std::swap(path[0], path[start]);
    double longest = 0;
    for (size_t i = 1; i < path.size(); ++i) {
      const auto nearest = std::max_element(path.begin() + i, path.end(), [&](const auto& a, const auto& b) {
        return a.dot(path[i - 1]) < b.dot(path[i - 1]);
      });
      std::swap(path[i], *nearest);
      longest = std::max(longest, angle_between(path[i - 1], path[i]));
    }
    if (longest < best_step) {
      best_step = longest;
      best = path;
    }
  }
  return best;
}

/// scene_from_sensor at `eye`, looking along `forward`, the scene's z axis up in the image but for the roll.
Pose sensor_pose(const Eigen::Vector3d& eye, const Eigen::Vector3d& forward, double roll_rad) {
  const Eigen::Vector3d down =
      std::abs(forward.z()) > 0.99 ? Eigen::Vector3d::UnitY() : Eigen::Vector3d(-Eigen::Vector3d::UnitZ());
  const Eigen::Vector3d x = down.cross(forward).normalized();
  Pose pose = Pose::Identity();
  pose.linear() << x, forward.cross(x), forward;
  pose.linear() = pose.linear() * rotation_exp({0, 0, roll_rad});
  pose.translation() = eye;
  return pose;
}

/// Whether the sensor sees all of the part, with a little to spare.
bool frames(const SensorModel& sensor, const TriangleMesh& part, const Pose& scene_from_sensor) {
  constexpr double kUsed = 0.98;
  const Eigen::Isometry3f sensor_from_scene = scene_from_sensor.inverse().cast<float>();
  const double reach_x = kUsed * std::tan(0.5 * sensor.horizontal_fov_rad);
  const double reach_y = kUsed * std::tan(0.5 * sensor.vertical_fov_rad);
  return std::all_of(part.vertices.begin(), part.vertices.end(), [&](const Eigen::Vector3f& vertex) {
    const Eigen::Vector3f p = sensor_from_scene * vertex;
    return p.z() > sensor.near_mm && p.z() < sensor.far_mm && std::abs(p.x()) < reach_x * p.z() &&
           std::abs(p.y()) < reach_y * p.z();
  });
}

}  // namespace

std::vector<Eigen::Vector3d> poisson_disc_directions(size_t count, uint64_t seed) {
  if (count == 0) throw InputError("views: 0 were asked for, at least 1 is needed");
  Random random(seed, 0);
  const double widest = widest_angle_rad(count);
  for (double share = 0.8;; share *= 0.9995) {
    const auto directions = throw_darts(count, share * widest, random);
    if (directions.size() == count && (count == 1 || loneliest_rad(directions) <= 1.025 * widest))
      return ordered_as_path(directions);
  }
}

std::vector<Pose> poisson_disc_views(const TriangleMesh& part, const SensorModel& sensor, size_t count,
                                     uint64_t seed) {
  if (part.vertices.empty()) throw InputError("views: the part has no vertices");
  constexpr double kNearest = 450, kFurthest = 550, kRoll = pi / 18, kOffset = 10;
  constexpr int kAttempts = 100;
  const Eigen::Vector3d centre = part.bounds().center().cast<double>();
  Random random(seed, 1);
  std::vector<Pose> views;
  for (const Eigen::Vector3d& direction : poisson_disc_directions(count, seed)) {
    // A large part fits only from further away and well centred: each attempt is drawn a little tighter.
    // The second half may also roll as it likes.
    std::optional<Pose> view;
    for (int attempt = 0; attempt < 2 * kAttempts && !view; ++attempt) {
      const double tightness = static_cast<double>(attempt % kAttempts) / kAttempts;
      const double distance = random.uniform(std::lerp(kNearest, kFurthest, tightness), kFurthest);
      const double most_roll = attempt < kAttempts ? kRoll : pi;
      const double offset = (1 - tightness) * kOffset;
      Pose pose =
          sensor_pose(centre + distance * direction, -direction, random.uniform(-most_roll, most_roll));
      const double shift_x = random.uniform(-offset, offset), shift_y = random.uniform(-offset, offset);
      pose.translation() += pose.linear() * Eigen::Vector3d(shift_x, shift_y, 0);
      if (frames(sensor, part, pose)) view = pose;
    }
    if (!view)
      throw InputError(
          "views: the part does not fit the sensor's field of view and depth of field at 450 to 550 mm");
    views.push_back(*view);
  }
  return views;
}

Pose perturbation(uint64_t seed, size_t scan, const Eigen::Vector3d& centre, double from, double to) {
  if (!(from >= 0 && to >= from))
    throw InputError("perturbation: the band must be 0 <= from <= to, found " + std::to_string(from) + ", " +
                     std::to_string(to));
  Random random(seed, 2 + scan);
  const Eigen::Vector3d axis = random.direction();
  const double angle_rad = random.uniform(from, to) * pi / 180;
  const Eigen::Vector3d direction = random.direction();
  const double length_mm = random.uniform(from, to);
  Pose motion = Pose::Identity();
  motion.linear() = rotation_exp(angle_rad * axis);
  motion.translation() = centre - motion.linear() * centre + length_mm * direction;
  return motion;
}

}  // namespace gantry
