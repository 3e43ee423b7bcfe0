#include "gantry/fusion/joint.h"

#include <gtest/gtest.h>
#include <tbb/global_control.h>

#include <Eigen/Eigenvalues>
#include <algorithm>
#include <cstring>
#include <numbers>

#include "foundation/expect_input_error.h"
#include "fusion/scenes.h"
#include "gantry/fusion/preprocess.h"
#include "gantry/kinematics/chain.h"
#include "gantry/sim/parts.h"
#include "gantry/sim/views.h"
#include "joint/coarse.h"
#include "joint/matches.h"
#include "joint/normal_equations.h"

namespace gantry {
namespace {

constexpr double kDegree = std::numbers::pi / 180;

/// Scans of a part with their true poses.
struct Scene {
  std::vector<TaggedScan> scans;
  std::vector<Pose> truth;
  Eigen::Vector3d centre;
};

Scene make_scene(const TriangleMesh& part, size_t views, int width, uint64_t seed) {
  Scene scene;
  const SensorModel model = small_sensor(width);
  scene.centre = part.bounds().center().cast<double>();
  scene.truth = poisson_disc_views(part, model, views, seed);
  const RayScene rays(part);
  for (size_t i = 0; i < views; ++i)
    scene.scans.push_back(scan_of(rays, model, scene.truth[i], i, "view" + std::to_string(i)));
  return scene;
}

const Scene& bracket_scene() {
  static const Scene scene = make_scene(make_bracket(), 8, 1200, 1);
  return scene;
}

/// The scans as surfaces, tagged wrongly by motions of the band (degrees and mm).
std::vector<RangeSurface> perturbed(const Scene& scene, double from, double to, uint64_t seed,
                                    double sigma_mm = 15, double sigma_deg = 15) {
  std::vector<RangeSurface> surfaces;
  for (size_t i = 0; i < scene.scans.size(); ++i) {
    TaggedScan scan = scene.scans[i];
    scan.part_from_sensor.mean = perturbation(seed, i, scene.centre, from, to) * scene.truth[i];
    scan.part_from_sensor.independent = covariance_about(scene.centre, sigma_mm, sigma_deg * kDegree);
    surfaces.push_back(make_range_surface(scan, {}));
  }
  return surfaces;
}

/// The worst displacement of any point, scan 0 being the reference.
double worst_mm(const Scene& scene, const std::vector<RangeSurface>& surfaces, const Registration& result) {
  const Pose gauge = scene.truth[0] * result.part_from_sensor[0].mean.inverse();
  double worst = 0;
  for (size_t i = 1; i < surfaces.size(); ++i) {
    const Pose pose = gauge * result.part_from_sensor[i].mean;
    for (int row = 0; row < surfaces[i].height; row += 5)
      for (int column = 0; column < surfaces[i].width; column += 5) {
        if (surfaces[i].w[surfaces[i].index(column, row)] == 0) continue;
        const Eigen::Vector3d p = surfaces[i].sensor_from_grid * surfaces[i].point(column, row);
        worst = std::max(worst, (pose * p - scene.truth[i] * p).norm());
      }
  }
  return worst;
}

TEST(Joint, KeepsThinWallsApartFromWideStarts) {
  for (const uint64_t seed : {1, 2}) {
    const auto surfaces = perturbed(bracket_scene(), 10, 15, seed);
    const Registration result = register_joint(surfaces, {});
    EXPECT_EQ(result.reason, "");
    EXPECT_LT(worst_mm(bracket_scene(), surfaces, result), 0.1);
    EXPECT_LT(result.wobble_mm, 0.12);
    ASSERT_EQ(result.scans.size(), 8u);
    for (const ScanReport& scan : result.scans) {
      EXPECT_LT(scan.free_space_violation + scan.opposite_contact, 0.002);
      EXPECT_TRUE(scan.connected);
      EXPECT_GT(scan.matches, 100u);
      EXPECT_FALSE(scan.observability.empty());
    }
  }
}

TEST(Joint, StartedAtTheTruthStaysThere) {
  const auto surfaces = perturbed(bracket_scene(), 0, 0, 1);
  const Registration result = register_joint(surfaces, {});
  EXPECT_EQ(result.reason, "");
  EXPECT_LT(worst_mm(bracket_scene(), surfaces, result), 0.05);
}

TEST(Joint, KeepsTheFirstPoseBitForBit) {
  const auto surfaces = perturbed(bracket_scene(), 1, 3, 4);
  const Registration result = register_joint(surfaces, {});
  EXPECT_EQ(std::memcmp(result.part_from_sensor[0].mean.data(), surfaces[0].part_from_sensor.mean.data(),
                        16 * sizeof(double)),
            0);
}

TEST(Joint, IsTheSameOnOneAndTwoThreads) {
  std::vector<Registration> results;
  for (const size_t threads : {1, 2}) {
    const tbb::global_control limit(tbb::global_control::max_allowed_parallelism, threads);
    const auto surfaces = perturbed(bracket_scene(), 6, 10, 3);
    results.push_back(register_joint(surfaces, {}));
  }
  for (size_t i = 0; i < 8; ++i) {
    EXPECT_EQ(std::memcmp(results[0].part_from_sensor[i].mean.data(),
                          results[1].part_from_sensor[i].mean.data(), 16 * sizeof(double)),
              0);
    EXPECT_EQ(results[0].part_from_sensor[i].independent, results[1].part_from_sensor[i].independent);
  }
}

TEST(Joint, DoesNotCareWhereTheOriginIs) {
  const auto here = perturbed(bracket_scene(), 1, 3, 5);
  auto far = here;
  Pose away = Pose::Identity();
  away.translation() = Eigen::Vector3d(6000, -7000, 4000);  // 10 m
  const Matrix6d shift = adjoint(away);
  for (RangeSurface& s : far) {
    s.part_from_sensor.mean = away * s.part_from_sensor.mean;
    s.part_from_sensor.independent = shift * s.part_from_sensor.independent * shift.transpose();
  }
  const Registration a = register_joint(here, {}), b = register_joint(far, {});
  for (size_t i = 0; i < 8; ++i)
    EXPECT_LT(translation_distance(a.part_from_sensor[i].mean, away.inverse() * b.part_from_sensor[i].mean),
              1e-5);
}

TEST(Joint, APartOfRevolutionIsUndecidedAndTheFreeDirectionNamed) {
  const Scene scene = make_scene(make_revolved_part(RevolvedFeature::kNone), 6, 600, 1);
  const auto surfaces = perturbed(scene, 1, 3, 1);
  const Registration result = register_joint(surfaces, {});
  EXPECT_NE(result.reason, "");
  EXPECT_NE(result.reason.find("turning about (0."), std::string::npos) << result.reason;
  EXPECT_NE(result.reason.find("1.00)"), std::string::npos) << result.reason;
}

TEST(Joint, TagsHoldAPartOfRevolution) {
  const Scene scene = make_scene(make_revolved_part(RevolvedFeature::kNone), 6, 600, 1);
  std::vector<RangeSurface> surfaces = perturbed(scene, 0, 0.02, 1, 0.02, 0.02);
  const Registration result = register_joint(surfaces, {});
  EXPECT_EQ(result.reason, "");
  EXPECT_LT(worst_mm(scene, surfaces, result), 0.15);
}

/// A turned part on a rotary table, scanned from the side. The encoder repeats to `repeatability_rad`; where
/// the axis and the sensor are is known badly, and true by a draw from that.
struct TurntableScene {
  Scene scene;
  std::vector<UncertainPose> tags;
};

TurntableScene turntable_scene(double repeatability_rad, uint64_t seed) {
  Chain chain;
  chain.joints.resize(1);
  Joint& table = chain.joints[0];
  table.repeatability = repeatability_rad;
  table.direction_sigma_rad = 0.1 * kDegree;
  table.point_sigma_mm = 0.3;
  chain.sensor_rotation_sigma_rad = 0.1 * kDegree;
  chain.sensor_position_sigma_mm = 0.3;
  chain.base_from_sensor = looking_at({0, -450, 200}, {0, 0, 0});
  std::mt19937 random(seed);
  std::normal_distribution<double> gauss;
  const auto gauss3 = [&](double sigma) -> Eigen::Vector3d {
    const double x = gauss(random), y = gauss(random), z = gauss(random);
    return sigma * Eigen::Vector3d(x, y, z);
  };
  Chain truth = chain;
  Joint& real = truth.joints[0];
  real.direction =
      rotation_exp(gauss3(table.direction_sigma_rad).cwiseProduct(Eigen::Vector3d(1, 1, 0))) * real.direction;
  real.point_mm += gauss3(table.point_sigma_mm).cwiseProduct(Eigen::Vector3d(1, 1, 0));
  truth.base_from_sensor.linear() *= rotation_exp(gauss3(chain.sensor_rotation_sigma_rad));
  truth.base_from_sensor.translation() += gauss3(chain.sensor_position_sigma_mm);

  TurntableScene result;
  const TriangleMesh part = make_revolved_part(RevolvedFeature::kNone);
  const RayScene rays(part);
  for (size_t i = 0; i < 6; ++i) {
    const double q = static_cast<double>(i) * 60 * kDegree, real_q = q + repeatability_rad * gauss(random);
    result.tags.push_back(chain.uncertain_part_from_sensor(std::vector{q}));
    result.scene.truth.push_back(truth.part_from_sensor(std::vector{real_q}));
    result.scene.scans.push_back(
        scan_of(rays, small_sensor(600), result.scene.truth.back(), i, "view" + std::to_string(i)));
  }
  return result;
}

/// Worst error and worst stated sigma of any scan's rotation against the first scan about the part's axis z,
/// about which nothing but the tags holds it.
std::pair<double, double> about_the_axis(const TurntableScene& t, const Registration& result) {
  double error = 0, sigma = 0;
  const Pose gauge = t.scene.truth[0] * result.part_from_sensor[0].mean.inverse();
  for (size_t i = 1; i < t.scene.truth.size(); ++i) {
    const Pose left = gauge * result.part_from_sensor[i].mean * t.scene.truth[i].inverse();
    error = std::max(error, std::abs(rotation_log(left.linear()).z()));
    sigma = std::max(sigma, std::sqrt(result.part_from_sensor[i].covariance()(2, 2)));
  }
  return {error, sigma};
}

const ParameterChoice& choice(const Registration& result, const std::string& name) {
  return *std::find_if(result.parameters.begin(), result.parameters.end(),
                       [&](const ParameterChoice& each) { return each.name == name; });
}

TEST(Joint, SharedErrorsOfTheTagsLeaveAPartOfRevolutionHeldToTheRepeatability) {
  constexpr double kRepeatability = 0.004 * kDegree;
  for (const uint64_t seed : {1, 2}) {
    SCOPED_TRACE(seed);
    TurntableScene t = turntable_scene(kRepeatability, seed);
    std::vector<RangeSurface> surfaces;
    for (size_t i = 0; i < t.tags.size(); ++i) {
      t.scene.scans[i].part_from_sensor = t.tags[i];
      surfaces.push_back(make_range_surface(t.scene.scans[i], {}));
    }
    const Registration shared = register_joint(surfaces, {});
    EXPECT_EQ(shared.reason, "");
    const auto [error, sigma] = about_the_axis(t, shared);
    // Two encoder positions make an angle between scans.
    EXPECT_NEAR(sigma / (std::sqrt(2.0) * kRepeatability), 1.05, 0.15);
    EXPECT_LT(error, 3 * sigma);
    EXPECT_LT(worst_mm(t.scene, surfaces, shared), 0.05);
    for (const ScanReport& scan : shared.scans) EXPECT_LT(scan.prior_chi_square, 8);
    EXPECT_GT(shared.shared_chi_square, 2);
    EXPECT_LT(shared.shared_chi_square, 25);
    EXPECT_EQ(choice(shared, "shared_parameters").value, 10);  // axis: 2 tilts, 2 shifts; sensor: 6

    for (RangeSurface& s : surfaces) {
      s.part_from_sensor.independent = s.part_from_sensor.covariance();
      s.part_from_sensor.shared_factor.resize(6, 0);
    }
    const Registration independent = register_joint(surfaces, {});
    const auto [error_without, sigma_without] = about_the_axis(t, independent);
    EXPECT_GT(sigma_without, 10 * sigma);
    EXPECT_GT(error_without, 5 * error);
    EXPECT_LT(error_without, 3 * sigma_without);
    EXPECT_EQ(independent.shared_chi_square, 0);
    EXPECT_EQ(choice(independent, "shared_parameters").value, 0);
    EXPECT_LT(worst_mm(t.scene, surfaces, shared), worst_mm(t.scene, surfaces, independent));
  }
}

TEST(Joint, ScansWithNothingInCommonAreUndecided) {
  std::vector<RangeSurface> surfaces = perturbed(bracket_scene(), 0, 1, 1);
  surfaces.resize(3);
  surfaces[2].name = "astray";
  surfaces[2].part_from_sensor.mean.translation() += Eigen::Vector3d(900, 900, 0);
  JointOptions options;
  options.global_fallback = false;
  const Registration result = register_joint(surfaces, options);
  EXPECT_NE(result.reason.find("astray"), std::string::npos) << result.reason;
}

TEST(Joint, OneScanIsItsOwnResult) {
  std::vector<RangeSurface> surfaces = perturbed(bracket_scene(), 0, 1, 1);
  surfaces.resize(1);
  const Registration result = register_joint(surfaces, {});
  EXPECT_EQ(result.reason, "");
  ASSERT_EQ(result.part_from_sensor.size(), 1u);
  EXPECT_TRUE(result.pairs.empty());
}

TEST(Joint, BadInputIsRefused) {
  expect_input_error([] { register_joint({}, {}); }, {"no scan"});
  std::vector<RangeSurface> surfaces = perturbed(bracket_scene(), 0, 1, 1);
  JointOptions options;
  options.noise_mm = -1;
  expect_input_error([&] { register_joint(surfaces, options); }, {"noise_mm", "-1"});
  options = {};
  options.start_mm = std::numeric_limits<double>::quiet_NaN();
  expect_input_error([&] { register_joint(surfaces, options); }, {"start_mm"});
}

TEST(Matches, GradientIsTheDerivativeOfTheCost) {
  // Far below its scale the loss is quadratic: cost' = 2 g for a motion of the source.
  const RayScene scene(make_bracket());
  std::vector<RangeSurface> surfaces;
  for (const double azimuth : {0.5, 0.7}) {
    surfaces.push_back(
        make_range_surface(scan_of(scene, small_sensor(960), bracket_view(azimuth, 0.9), 1), {}));
    surfaces.back().part_from_sensor.mean = bracket_view(azimuth, 0.9);
  }
  internal::MatchGates gates;
  gates.scale_mm = 1000;
  gates.reach_mm = 1;
  const auto sum_at = [&](const Vector6d& motion) {
    const Pose source = internal::exp_about(bracket_scene().centre, motion) * surfaces[1].part_from_grid();
    return internal::match_by_projection(
        surfaces[0], surfaces[1], surfaces[0].part_from_grid().inverse() * source,
        surfaces[0].part_from_grid(), bracket_scene().centre, gates, 0, surfaces[1].height);
  };
  Vector6d at = Vector6d::Zero();
  at << 0.0005, -0.0003, 0.0004, 0.02, -0.03, 0.02;
  const internal::PairSum here = sum_at(at);
  ASSERT_GT(here.matches, 1000u);
  for (int k = 3; k < 6; ++k) {
    const double h = 2e-3;
    const double slope =
        (sum_at(at + h * Vector6d::Unit(k)).cost - sum_at(at - h * Vector6d::Unit(k)).cost) / (2 * h);
    EXPECT_NEAR(slope, 2 * here.gradient[k], 0.05 * 2 * here.gradient.tail<3>().norm()) << k;
  }
}

TEST(Matches, ActiveBlocksChangeNothing) {
  const auto surfaces = perturbed(bracket_scene(), 0, 0, 1);
  const Pose relative = surfaces[0].part_from_grid().inverse() * surfaces[1].part_from_grid();
  internal::MatchGates gates;
  gates.stride = 1;
  internal::ActiveBlocks blocks;
  blocks.active.assign(static_cast<size_t>(internal::ActiveBlocks::across(surfaces[1].width)) *
                           internal::ActiveBlocks::across(surfaces[1].height),
                       0);
  const auto match = [&](const internal::ActiveBlocks* visited, internal::ActiveBlocks* found) {
    return internal::match_by_projection(surfaces[0], surfaces[1], relative, surfaces[0].part_from_grid(),
                                         bracket_scene().centre, gates, 0, surfaces[1].height, nullptr,
                                         visited, found);
  };
  const internal::PairSum all = match(nullptr, &blocks), active = match(&blocks, nullptr);
  EXPECT_EQ(all.matches, active.matches);
  EXPECT_EQ(all.hessian, active.hessian);
  EXPECT_LT(std::count(blocks.active.begin(), blocks.active.end(), 1),
            static_cast<std::ptrdiff_t>(blocks.active.size()) * 9 / 10);
}

TEST(Matches, NoisyNormalsOfAPlaneHoldNothing) {
  TriangleMesh plane;
  plane.vertices = {{-90, -90, 500}, {90, -90, 500}, {90, 90, 500}, {-90, 90, 500}};
  plane.triangles = {{0, 2, 1}, {0, 3, 2}};
  const RayScene scene(plane);
  TaggedScan a = scan_of(scene, small_sensor(960), Pose::Identity(), 1),
             b = scan_of(scene, small_sensor(960), Pose::Identity(), 2);
  const RangeSurface target = make_range_surface(a, {}), source = make_range_surface(b, {});
  internal::MatchGates gates;
  gates.stride = 1;
  const auto in_plane = [&](double variance) {
    gates.normal_variance = variance;
    const internal::PairSum sum = internal::match_by_projection(
        target, source, Pose::Identity(), Pose::Identity(), {0, 0, 500}, gates, 0, source.height);
    return sum.hessian(3, 3) - sum.tilts(3, 3);
  };
  const double n = 2 * source.normal_window_px + 1;
  const double spread = n * n * (n * n - 1) / 12 - 6;
  const double variance = std::pow(source.noise_mm / source.spacing_mm, 2) / spread / 2;
  EXPECT_GT(in_plane(0), 0);
  EXPECT_LT(std::abs(in_plane(variance)), 0.35 * in_plane(0));
}

TEST(NormalEquations, SolveFindsTheMinimumAndLeavesFreeDirectionsAlone) {
  internal::NormalEquations equations(2);
  internal::PairSum sum;
  std::mt19937 random(1);
  Vector6d motion = Vector6d::Zero();
  motion << 0, 0, 0, 0.3, -0.2, 0.1;
  for (int i = 0; i < 300; ++i) {
    const Eigen::Vector3d arm = 50 * random_direction(random), n = random_direction(random);
    Vector6d a;
    a << arm.cross(n), n;
    sum.add(arm, n, a.dot(motion), 1);
  }
  equations.add_pair(0, 1, sum);
  equations.add_prior(0, 1e3 * Matrix6d::Identity(), Vector6d::Zero());
  const Eigen::VectorXd step = equations.solve();
  EXPECT_LT((step.segment<6>(6) - step.segment<6>(0) + motion).norm(), 1e-6);
}

/// A plane z = depth that fills most of the image, facing the origin or away from it.
TriangleMesh plane_at(float depth, bool away = false) {
  TriangleMesh plane;
  plane.vertices = {{-90, -50, depth}, {90, -50, depth}, {90, 50, depth}, {-90, 50, depth}};
  plane.triangles = {{0, 2, 1}, {0, 3, 2}};
  if (away) plane.triangles = {{0, 1, 2}, {0, 2, 3}};
  return plane;
}

TEST(PairSum, SoftenedHessianIsTheDerivativeOfTheGradient) {
  const RayScene scene(plane_at(500));
  const RangeSurface target = make_range_surface(scan_of(scene, small_sensor(), Pose::Identity(), 1), {}),
                     source = make_range_surface(scan_of(scene, small_sensor(), Pose::Identity(), 2), {});
  internal::MatchGates gates;
  gates.stride = 1;
  gates.scale_mm = 0.15;
  gates.reach_mm = 5;
  const auto at = [&](double shift_mm) {
    return internal::match_by_projection(target, source, Pose(Eigen::Translation3d(0, 0, shift_mm)),
                                         Pose::Identity(), {0, 0, 500}, gates, 0, source.height);
  };
  constexpr double kStep_mm = 0.01;
  const double derivative = (at(kStep_mm).gradient[5] - at(-kStep_mm).gradient[5]) / (2 * kStep_mm);
  internal::PairSum sum = at(0);
  EXPECT_GT(sum.hessian(5, 5), 1.15 * derivative) << "weighted squares alone are too stiff";
  sum.soften();
  EXPECT_NEAR(sum.hessian(5, 5), derivative, 0.02 * derivative);
}

TEST(Compare, FacesOfAThinWallTouchOnlyWhenTheyMeet) {
  const RangeSurface front =
      make_range_surface(scan_of(RayScene(plane_at(500)), small_sensor(), Pose::Identity(), 1), {});
  Pose behind = Pose::Identity();  // turned about y, 1 m away
  behind.linear() = rotation_exp({0, std::numbers::pi, 0});
  behind.translation() = Eigen::Vector3d(0, 0, 1000);
  const auto contacts = [&](float thickness_mm) {
    const RangeSurface back = make_range_surface(
        scan_of(RayScene(plane_at(500 + thickness_mm, true)), small_sensor(), behind, 2), {});
    const internal::Agreement a = internal::compare(front, back, behind, 1.5, 2);
    EXPECT_EQ(a.matched, 0u);
    return a.contact;
  };
  EXPECT_EQ(contacts(1), 0u);
  EXPECT_GT(contacts(0.1f), 1000u);
}

TEST(PairSum, BelievesNothingOfWhatTiltsAlonePretend) {
  // A plane z = 0 of 1000 matches, normals tilted by 0.02 rad: it holds z and two tilts, and pretends three
  // more.
  std::mt19937 random(5);
  std::normal_distribution<double> normal;
  std::uniform_real_distribution<double> place(-50, 50);
  internal::PairSum sum;
  for (int i = 0; i < 1000; ++i) {
    const Eigen::Vector3d arm(place(random), place(random), 0);
    const Eigen::Vector3d n = Eigen::Vector3d(0.02 * normal(random), 0.02 * normal(random), 1).normalized();
    sum.add(arm, n, 0.05 * normal(random), 1, 0.0004);
  }
  internal::PairSum clean = sum;
  clean.take_out_tilts();
  for (const int free : {2, 3, 4}) {  // turning about z, sliding along x and y
    EXPECT_GT(sum.hessian(free, free), 0);
    EXPECT_LT(clean.hessian(free, free), 0.02 * sum.hessian(free, free));
  }
  for (const int held : {0, 1, 5}) {
    EXPECT_NEAR(clean.hessian(held, held), sum.hessian(held, held), 0.01 * sum.hessian(held, held));
    EXPECT_NEAR(clean.gradient[held], sum.gradient[held], 0.05 * std::abs(sum.gradient[held]) + 0.01);
  }
  EXPECT_GT(Eigen::SelfAdjointEigenSolver<Matrix6d>(clean.hessian).eigenvalues()(0), -1e-6);
}

TEST(StrongestPairs, ConnectWhatCanBeConnectedAndKeepPartnersFew) {
  // Two clusters of ten that share much, and one weak pair between them.
  std::vector<internal::WeighedPair> candidates;
  for (size_t a = 0; a < 20; ++a)
    for (size_t b = a + 1; b < 20; ++b)
      candidates.push_back({a, b, a / 10 == b / 10 ? 100 + (a * 7 + b * 3) % 50 : size_t{a == 4 && b == 17}});
  const internal::Pairs pairs = internal::strongest_pairs(candidates, 20, 4);
  EXPECT_TRUE(std::find(pairs.begin(), pairs.end(), std::pair<size_t, size_t>(4, 17)) != pairs.end());
  EXPECT_LT(pairs.size(), 70u);
  EXPECT_GE(pairs.size(), 40u);
  EXPECT_TRUE(std::is_sorted(pairs.begin(), pairs.end()));
}

TEST(Joint, ManyViews) {
  const Scene scene = make_scene(make_bracket(), 20, 800, 3);
  const auto surfaces = perturbed(scene, 3, 6, 2);
  const Registration result = register_joint(surfaces, {});
  EXPECT_EQ(result.reason, "");
  EXPECT_LT(worst_mm(scene, surfaces, result), 0.15);
  EXPECT_LT(result.pairs.size(), size_t{20 * 16});
}

TEST(NormalEquations, ExpAndLogAboutACentreAreInverse) {
  std::mt19937 random(2);
  for (int i = 0; i < 50; ++i) {
    const Eigen::Vector3d centre = 100 * random_direction(random);
    Vector6d twist;
    twist << 0.5 * random_direction(random), 20 * random_direction(random);
    EXPECT_LT((internal::log_about(centre, internal::exp_about(centre, twist)) - twist).norm(), 1e-9);
    EXPECT_LT((internal::exp_about(centre, twist) * centre - centre - twist.tail<3>()).norm(), 1e-9);
  }
}

}  // namespace
}  // namespace gantry
