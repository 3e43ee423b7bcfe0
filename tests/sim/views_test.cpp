#include "gantry/sim/views.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <numbers>

#include "gantry/foundation/error.h"
#include "gantry/sim/bracket.h"
#include "gantry/sim/parts.h"

namespace gantry {
namespace {

using std::numbers::pi;

constexpr double kDegree = pi / 180;

double angle(const Eigen::Vector3d& a, const Eigen::Vector3d& b) {
  return std::atan2(a.cross(b).norm(), a.dot(b));
}

/// The angle from each direction to its nearest neighbour.
std::vector<double> nearest_angles(const std::vector<Eigen::Vector3d>& directions) {
  std::vector<double> nearest;
  for (size_t i = 0; i < directions.size(); ++i) {
    double least = pi;
    for (size_t j = 0; j < directions.size(); ++j)
      if (j != i) least = std::min(least, angle(directions[i], directions[j]));
    nearest.push_back(least);
  }
  return nearest;
}

TEST(PoissonDiscDirections, EightStandAsFarApartAsInThePaper) {
  for (uint64_t seed = 0; seed < 50; ++seed) {
    const auto directions = poisson_disc_directions(8, seed);
    ASSERT_EQ(directions.size(), 8u);
    for (const auto& d : directions) EXPECT_NEAR(d.norm(), 1, 1e-12);
    for (const double nearest : nearest_angles(directions)) {
      EXPECT_GE(nearest, 58 * kDegree) << seed;
      EXPECT_LE(nearest, 80 * kDegree) << seed;
    }
    for (size_t i = 1; i < directions.size(); ++i)
      EXPECT_LT(angle(directions[i - 1], directions[i]), 90 * kDegree) << seed;
  }
}

TEST(PoissonDiscDirections, SpreadForAnyCount) {
  EXPECT_EQ(poisson_disc_directions(1, 1).size(), 1u);
  for (size_t count = 2; count <= 40; ++count) {
    const auto directions = poisson_disc_directions(count, count);
    ASSERT_EQ(directions.size(), count);
    const auto nearest = nearest_angles(directions);
    // The caps of half that angle would fill the sphere without a gap, which no packing does.
    const double cap = 2 * std::acos(1 - 2.0 / static_cast<double>(count));
    EXPECT_GE(*std::min_element(nearest.begin(), nearest.end()), std::min(0.65 * cap, 70 * kDegree)) << count;
    EXPECT_LE(*std::max_element(nearest.begin(), nearest.end()), cap) << count;
  }
}

/// No direction is preferred: over many seeds the first view's mean is near zero, its square near 1/3 an
/// axis.
TEST(PoissonDiscDirections, PreferNoSide) {
  Eigen::Vector3d mean = Eigen::Vector3d::Zero(), square = Eigen::Vector3d::Zero();
  constexpr int kSeeds = 1000;
  for (int seed = 0; seed < kSeeds; ++seed) {
    const Eigen::Vector3d d = poisson_disc_directions(6, seed).front();
    mean += d / kSeeds;
    square += d.cwiseAbs2() / kSeeds;
  }
  EXPECT_LT(mean.norm(), 0.1);
  EXPECT_LT((square - Eigen::Vector3d::Constant(1.0 / 3)).cwiseAbs().maxCoeff(), 0.05);
}

TEST(PoissonDiscViews, StandAtThePapersDistanceAndLookAtThePart) {
  const TriangleMesh parts[] = {make_bracket(), make_slim_lever(), make_plate()};
  for (const TriangleMesh& part : parts) {
    const Eigen::Vector3d centre = part.bounds().center().cast<double>();
    for (uint64_t seed = 0; seed < 5; ++seed) {
      const auto views = poisson_disc_views(part, SensorModel(), 8, seed);
      const auto directions = poisson_disc_directions(8, seed);
      ASSERT_EQ(views.size(), 8u);
      for (size_t i = 0; i < views.size(); ++i) {
        const Pose& view = views[i];
        EXPECT_TRUE((view.linear() * view.linear().transpose()).isIdentity(1e-12));
        EXPECT_NEAR(view.linear().determinant(), 1, 1e-12);
        const Eigen::Vector3d middle = view.inverse() * centre;
        EXPECT_GE(middle.z(), 450);
        EXPECT_LE(middle.z(), 550);
        EXPECT_LT(middle.head<2>().norm(), 15);
        EXPECT_LT(angle(-view.linear().col(2), directions[i]), 1e-6);
      }
    }
  }
}

/// Oracle: the traced image has a clear border all around, and as many pixels as a sensor with twice the
/// field of view and depth of field sees.
TEST(PoissonDiscViews, HaveTheWholePartInTheImage) {
  SensorModel sensor;
  sensor.width = 320;
  sensor.height = 200;
  sensor.projector_offset_mm = 0;
  sensor.noise_mm = sensor.mixed_pixel_probability = sensor.dropout_probability = 0;
  sensor.max_incidence_rad = 0.5 * pi;
  SensorModel deeper = sensor;
  deeper.near_mm = 1;
  deeper.far_mm = 5000;
  TriangleMesh large_bracket = make_bracket();  // stretched: it fits from far away only
  for (auto& vertex : large_bracket.vertices)
    vertex = 1.5f * vertex.cwiseProduct(Eigen::Vector3f(0.8f, 1.2f, 1.2f));
  for (const TriangleMesh& part : {large_bracket, make_slim_lever()}) {
    const RayScene scene(part);
    for (const Pose& view : poisson_disc_views(part, sensor, 8, 11)) {
      const Scan scan = trace_scan(sensor, scene, view, view, 1, 0);
      EXPECT_GT(scan.valid_count(), 100u);
      EXPECT_EQ(scan.valid_count(), trace_scan(deeper, scene, view, view, 1, 0).valid_count());
      for (int column = 0; column < scan.width; ++column)
        EXPECT_FALSE(scan.valid(scan.index(column, 0)) || scan.valid(scan.index(column, scan.height - 1)));
      for (int row = 0; row < scan.height; ++row)
        EXPECT_FALSE(scan.valid(scan.index(0, row)) || scan.valid(scan.index(scan.width - 1, row)));
    }
  }
}

TriangleMesh cube(float size) {
  TriangleMesh mesh;
  for (int i = 0; i < 8; ++i)
    mesh.vertices.emplace_back(i & 1 ? size : 0, i & 2 ? size : 0, i & 4 ? size : 0);
  mesh.triangles = {{0, 1, 2}, {5, 6, 7}};
  return mesh;
}

TEST(PoissonDiscViews, MoveBackForALargePartAndRefuseOneThatDoesNotFit) {
  // From 450 mm the image is 197 mm high, from 550 mm 241 mm; the cube's diagonal is 208 mm.
  const TriangleMesh large = cube(120);
  for (const Pose& view : poisson_disc_views(large, SensorModel(), 8, 2))
    for (const auto& vertex : large.vertices) {
      const Eigen::Vector3d p = view.inverse() * vertex.cast<double>();
      EXPECT_LT(std::abs(p.x()) / p.z(), std::tan(19.35 * kDegree));
      EXPECT_LT(std::abs(p.y()) / p.z(), std::tan(12.375 * kDegree));
    }
  EXPECT_THROW(poisson_disc_views(cube(200), SensorModel(), 8, 2), InputError);
  EXPECT_THROW(poisson_disc_views(TriangleMesh(), SensorModel(), 8, 2), InputError);
  EXPECT_THROW(poisson_disc_views(cube(50), SensorModel(), 0, 2), InputError);
}

TEST(PoissonDiscViews, DependOnTheSeedAlone) {
  const TriangleMesh part = cube(80);
  const auto a = poisson_disc_views(part, SensorModel(), 8, 5),
             b = poisson_disc_views(part, SensorModel(), 8, 5);
  const auto c = poisson_disc_views(part, SensorModel(), 8, 6);
  for (size_t i = 0; i < a.size(); ++i) {
    EXPECT_EQ(a[i].matrix(), b[i].matrix());
    EXPECT_GT(translation_distance(a[i], c[i]), 1);
  }
}

const Eigen::Vector3d kCentre(60, -20, 35);

TEST(Perturbation, LiesInItsBand) {
  for (const auto& [from, to] : {std::pair{0.0, 1.0}, {1.0, 3.0}, {6.0, 10.0}, {10.0, 15.0}, {2.0, 2.0}}) {
    double least_angle = 1e9, most_angle = 0, least_shift = 1e9, most_shift = 0;
    for (size_t scan = 0; scan < 500; ++scan) {
      const Pose motion = perturbation(4, scan, kCentre, from, to);
      EXPECT_TRUE((motion.linear() * motion.linear().transpose()).isIdentity(1e-12));
      const double degrees = rotation_distance(motion, Pose::Identity()) / kDegree;
      const double shift_mm = (motion * kCentre - kCentre).norm();
      least_angle = std::min(least_angle, degrees), most_angle = std::max(most_angle, degrees);
      least_shift = std::min(least_shift, shift_mm), most_shift = std::max(most_shift, shift_mm);
    }
    const double slack = 0.05 * (to - from) + 1e-9;  // 500 draws come that close to both ends
    for (const auto& [least, most] : {std::pair{least_angle, most_angle}, {least_shift, most_shift}}) {
      EXPECT_GE(least, from - 1e-9);
      EXPECT_LE(least, from + slack);
      EXPECT_LE(most, to + 1e-9);
      EXPECT_GE(most, to - slack);
    }
  }
}

TEST(Perturbation, PrefersNoAxisAndDrawsAngleAndShiftApart) {
  constexpr int kDraws = 4000;
  Eigen::Matrix3d axes = Eigen::Matrix3d::Zero(), shifts = Eigen::Matrix3d::Zero();
  Eigen::Vector3d axis_mean = Eigen::Vector3d::Zero(), shift_mean = Eigen::Vector3d::Zero();
  double angle_mean = 0, angle_square = 0, product = 0, axis_along_shift = 0;
  for (int scan = 0; scan < kDraws; ++scan) {
    const Pose motion = perturbation(9, scan, kCentre, 1, 3);
    const Eigen::Vector3d rotation = rotation_log(motion.linear()), shift = motion * kCentre - kCentre;
    const Eigen::Vector3d axis = rotation.normalized(), direction = shift.normalized();
    const double degrees = rotation.norm() / kDegree;
    axes += axis * axis.transpose() / kDraws;
    shifts += direction * direction.transpose() / kDraws;
    axis_mean += axis / kDraws;
    shift_mean += direction / kDraws;
    angle_mean += degrees / kDraws;
    angle_square += degrees * degrees / kDraws;
    product += (degrees - 2) * (shift.norm() - 2) / kDraws;
    axis_along_shift += axis.dot(direction) / kDraws;
  }
  // Bounds of four to five standard errors.
  const Eigen::Matrix3d third = Eigen::Matrix3d::Identity() / 3;
  EXPECT_LT((axes - third).cwiseAbs().maxCoeff(), 0.025);
  EXPECT_LT((shifts - third).cwiseAbs().maxCoeff(), 0.025);
  EXPECT_LT(axis_mean.cwiseAbs().maxCoeff(), 0.04);
  EXPECT_LT(shift_mean.cwiseAbs().maxCoeff(), 0.04);
  EXPECT_NEAR(angle_mean, 2, 0.04);
  EXPECT_NEAR(angle_square - angle_mean * angle_mean, 1.0 / 3, 0.025);
  EXPECT_NEAR(product, 0, 0.025);
  EXPECT_NEAR(axis_along_shift, 0, 0.04);
}

TEST(Perturbation, IsOneDrawScaledByTheBand) {
  const Pose small = perturbation(3, 5, kCentre, 0, 1), large = perturbation(3, 5, kCentre, 0, 10);
  EXPECT_LT((10 * rotation_log(small.linear()) - rotation_log(large.linear())).norm(), 1e-9);
  EXPECT_LT((10 * (small * kCentre - kCentre) - (large * kCentre - kCentre)).norm(), 1e-9);
  EXPECT_GT(rotation_distance(small, perturbation(3, 6, kCentre, 0, 1)), 1e-4);
  EXPECT_GT(rotation_distance(small, perturbation(4, 5, kCentre, 0, 1)), 1e-4);
}

TEST(Perturbation, RefusesABandThatIsNone) {
  EXPECT_THROW(perturbation(1, 0, kCentre, 3, 1), InputError);
  EXPECT_THROW(perturbation(1, 0, kCentre, -1, 1), InputError);
  EXPECT_THROW(perturbation(1, 0, kCentre, 0, std::nan("")), InputError);
}

}  // namespace
}  // namespace gantry
