#include "alignment/datum_feature.h"

#include <Eigen/Cholesky>
#include <Eigen/Eigenvalues>
#include <algorithm>
#include <cmath>

#include "alignment/normal_equations.h"
#include "alignment/patch_covariance.h"
#include "alignment/tessellation.h"
#include "gantry/foundation/error.h"
#include "gantry/geometry/surface_index.h"

namespace gantry::internal {
namespace {

constexpr double kSamePlane = 0.985;  // cosine, 10 degrees
constexpr double kFlat = 0.02;        // deviation of the CAD from its feature, as a share of the size
constexpr size_t kFewestPoints = 30;

[[noreturn]] void refuse(const Datum& datum, const std::string& set, const std::string& why) {
  throw InputError("datums '" + set + "': datum '" + datum.name + "': " + why);
}

/// Samples of the feature's faces within the region, evenly by area.
std::vector<Eigen::Vector3d> region_samples(const CadFeature& f, const TriangleMesh& mesh) {
  std::vector<Eigen::Vector3d> samples;
  const double spacing = f.size_mm / 20;
  for (size_t t = 0; t < f.faces.size(); ++t) {
    if (!f.faces[t]) continue;
    const auto corner = [&](int k) -> Eigen::Vector3d {
      return mesh.vertices[mesh.triangles[t][k]].cast<double>();
    };
    const int n = std::clamp(static_cast<int>(std::sqrt(2.0 * mesh.area(t)) / spacing), 1, 300);
    for (int a = 0; a < n; ++a)
      for (int b = 0; a + b < n; ++b) {
        const double u = (a + 1.0 / 3) / n, v = (b + 1.0 / 3) / n;
        const Eigen::Vector3d p = (1 - u - v) * corner(0) + u * corner(1) + v * corner(2);
        if (f.in_region(p)) samples.push_back(p);
      }
  }
  return samples;
}

/// The faces reached from `seed` across smooth edges, those for which `belongs` holds.
template <typename Belongs>
std::vector<unsigned char> connected(const TriangleMesh& mesh, int seed, const Belongs& belongs) {
  const auto adjacent = adjacent_triangles(mesh);
  std::vector<unsigned char> in(mesh.triangles.size(), 0);
  std::vector<int> open{seed};
  in[seed] = 1;
  while (!open.empty()) {
    const int t = open.back();
    open.pop_back();
    for (const int other : adjacent[t]) {
      if (other < 0 || in[other]) continue;
      const float cosine = mesh.normal(static_cast<size_t>(t)).dot(mesh.normal(static_cast<size_t>(other)));
      if (cosine < std::cos(kSmooth_rad) || !belongs(other)) continue;
      in[other] = 1;
      open.push_back(other);
    }
  }
  return in;
}

void fit_plane(CadFeature& f, const TriangleMesh& mesh, int seed, const std::string& set) {
  const Eigen::Vector3f normal = mesh.normal(static_cast<size_t>(seed));
  f.faces = connected(mesh, seed, [&](int t) {
    return mesh.normal(static_cast<size_t>(t)).dot(normal) > static_cast<float>(kSamePlane);
  });
  const auto samples = region_samples(f, mesh);
  if (samples.size() < 3) refuse(f.datum, set, "no CAD surface within its region");
  const FitFrame middle = frame_of(samples);
  Eigen::Matrix3d spread = Eigen::Matrix3d::Zero();
  for (const auto& p : samples) spread += (p - middle.centre) * (p - middle.centre).transpose();
  const Eigen::SelfAdjointEigenSolver<Eigen::Matrix3d> solver(spread / static_cast<double>(samples.size()));
  if (std::sqrt(std::max(0.0, solver.eigenvalues()[0])) > kFlat * f.size_mm)
    refuse(f.datum, set, "the CAD surface there is no plane");
  f.origin = middle.centre;
  f.axis = solver.eigenvectors().col(0);
  if (f.axis.dot(normal.cast<double>()) < 0) f.axis = -f.axis;
}

void fit_cylinder(CadFeature& f, const TriangleMesh& mesh, int seed, const std::string& set) {
  // Faces that the region touches at all: of long thin facets no corner need lie in it.
  const Eigen::Vector3d at = f.datum.position_mm;
  f.faces = connected(mesh, seed, [&](int t) {
    const auto& c = mesh.triangles[static_cast<size_t>(t)];
    TriangleFeature feature;
    return f.in_region(closest_on_triangle(at, mesh.vertices[c[0]].cast<double>(),
                                           mesh.vertices[c[1]].cast<double>(),
                                           mesh.vertices[c[2]].cast<double>(), feature));
  });
  Eigen::Matrix3d normals = Eigen::Matrix3d::Zero();
  for (size_t t = 0; t < f.faces.size(); ++t)
    if (f.faces[t])
      normals += mesh.area(t) * mesh.normal(t).cast<double>() * mesh.normal(t).cast<double>().transpose();
  const Eigen::SelfAdjointEigenSolver<Eigen::Matrix3d> solver(normals / normals.trace());
  if (solver.eigenvalues()[0] > 0.01 || solver.eigenvalues()[1] < 0.02)
    refuse(f.datum, set, "the CAD surface there is no cylinder");
  f.axis = solver.eigenvectors().col(0);
  Eigen::Index most = 0;
  f.axis.cwiseAbs().maxCoeff(&most);
  if (f.axis[most] < 0) f.axis = -f.axis;
  const auto samples = region_samples(f, mesh);
  if (samples.size() < 6) refuse(f.datum, set, "no CAD surface within its region");
  // A circle through the samples seen along the axis: |p|^2 = 2 c.p + (R^2 - |c|^2).
  const Eigen::Vector3d u = f.axis.unitOrthogonal(), v = f.axis.cross(u);
  const Eigen::Vector3d middle = frame_of(samples).centre;
  Eigen::Matrix3d left = Eigen::Matrix3d::Zero();
  Eigen::Vector3d right = Eigen::Vector3d::Zero();
  for (const auto& p : samples) {
    const Eigen::Vector3d row(u.dot(p - middle), v.dot(p - middle), 1);
    left += row * row.transpose();
    right += row * row.head<2>().squaredNorm();
  }
  const Eigen::Vector3d c = left.ldlt().solve(right);
  f.origin = middle + 0.5 * (c[0] * u + c[1] * v);
  f.radius_mm = std::sqrt(c[2] + 0.25 * c.head<2>().squaredNorm());
  double squares = 0;
  for (const auto& p : samples) squares += std::pow((p - f.origin).cross(f.axis).norm() - f.radius_mm, 2);
  if (!(std::sqrt(squares / static_cast<double>(samples.size())) < kFlat * f.radius_mm))
    refuse(f.datum, set, "the CAD surface there is no cylinder");
}

/// A robust linear fit: values = design * coefficients, with a covariance by patches.
struct Regression {
  Eigen::VectorXd coefficients;
  Eigen::MatrixXd covariance;
  double rms = 0;
};

Regression regress(const Eigen::MatrixXd& design, const Eigen::VectorXd& values,
                   const Eigen::VectorXd& weight, const std::vector<int>& patch) {
  Regression fit;
  const Eigen::Index n = values.size(), k = design.cols();
  fit.coefficients = Eigen::VectorXd::Zero(k);
  Eigen::VectorXd slope = Eigen::VectorXd::Ones(n), pull = slope, rest = values;
  double sigma = 1;
  for (int round = 0; round < 30; ++round) {
    const Eigen::MatrixXd weighted = (weight.cwiseProduct(pull)).asDiagonal() * design;
    const Eigen::VectorXd next = (weighted.transpose() * design).ldlt().solve(weighted.transpose() * values);
    const double change = (next - fit.coefficients).norm();
    fit.coefficients = next;
    rest = values - design * fit.coefficients;
    const Eigen::VectorXd scaled = rest.cwiseProduct(weight.cwiseSqrt());
    sigma = std::max(1e-6, robust_sigma({scaled.data(), scaled.data() + n}));
    for (Eigen::Index i = 0; i < n; ++i) {
      const TukeyWeight tw = tukey(scaled[i] / sigma);
      pull[i] = tw.weight;
      slope[i] = tw.slope;
    }
    if (change < 1e-7) break;
  }
  fit.rms = std::sqrt(rest.cwiseAbs2().dot(pull) / pull.sum());
  const auto patches = static_cast<size_t>(*std::max_element(patch.begin(), patch.end()) + 1);
  std::vector<Eigen::MatrixXd> part(patches, Eigen::MatrixXd::Zero(k, k));
  std::vector<Eigen::VectorXd> gradient(patches, Eigen::VectorXd::Zero(k));
  Eigen::MatrixXd curvature = Eigen::MatrixXd::Zero(k, k);
  for (Eigen::Index i = 0; i < n; ++i) {
    const Eigen::MatrixXd share = weight[i] * slope[i] * design.row(i).transpose() * design.row(i);
    const auto p = static_cast<size_t>(patch[static_cast<size_t>(i)]);
    part[p] += share;
    curvature += share;
    gradient[p] += weight[i] * pull[i] * rest[i] * design.row(i).transpose();
  }
  fit.covariance = patch_covariance(curvature, part, gradient);
  return fit;
}

}  // namespace

bool CadFeature::in_region(const Eigen::Vector3d& point) const {
  const Eigen::Vector3d d = point - datum.position_mm;
  return datum.box_mm ? (d.cwiseAbs().array() <= 0.5 * datum.box_mm->array()).all()
                      : d.norm() <= datum.radius_mm;
}

CadFeature cad_feature(const Datum& datum, const TriangleMesh& mesh, const std::string& set_name) {
  CadFeature f;
  f.datum = datum;
  f.size_mm = datum.box_mm ? 0.5 * datum.box_mm->maxCoeff() : datum.radius_mm;
  const SurfaceIndex index(mesh);
  const Eigen::Vector3f at = datum.position_mm.cast<float>();
  const auto reach = static_cast<float>(datum.box_mm ? datum.box_mm->norm() / 2 : datum.radius_mm);
  const auto closest = datum.normal ? index.closest_facing(at, reach, datum.normal->cast<float>(), 0.5f)
                                    : index.closest(at, reach);
  if (!closest) refuse(datum, set_name, "no CAD surface within its region");
  switch (datum.kind) {
    case DatumKind::kPlane:
      fit_plane(f, mesh, closest->triangle, set_name);
      break;
    case DatumKind::kCylinder:
      fit_cylinder(f, mesh, closest->triangle, set_name);
      break;
    case DatumKind::kPoint:
      fit_plane(f, mesh, closest->triangle, set_name);
      f.origin = closest->point.cast<double>();
      f.axis = mesh.normal(static_cast<size_t>(closest->triangle)).cast<double>();
      break;
  }
  return f;
}

FeatureDemand measure_feature(const CadFeature& f, const std::vector<Pair>& pairs,
                              const std::vector<double>& weight, const FitFrame& frame,
                              const std::string& set_name) {
  std::vector<size_t> used;
  std::vector<Eigen::Vector3d> points, normals;
  for (size_t i = 0; i < pairs.size(); ++i)
    if (pairs[i].found && f.faces[static_cast<size_t>(pairs[i].triangle)] && f.in_region(pairs[i].point)) {
      used.push_back(i);
      points.push_back(pairs[i].point);
      normals.push_back(pairs[i].normal);
    }
  if (used.size() < kFewestPoints)
    refuse(f.datum, set_name,
           "only " + std::to_string(used.size()) + " points of the cloud lie on it, too few to fit it to");
  const bool round = f.datum.kind == DatumKind::kCylinder;
  const double h = f.size_mm;
  const Eigen::Vector3d u = f.axis.unitOrthogonal(), v = f.axis.cross(u);
  const auto n = static_cast<Eigen::Index>(used.size());
  Eigen::MatrixXd design(n, round ? 5 : 3);
  Eigen::VectorXd values(n), weights(n);
  for (Eigen::Index i = 0; i < n; ++i) {
    const Eigen::Vector3d q = points[static_cast<size_t>(i)] - f.origin;
    weights[i] = weight[used[static_cast<size_t>(i)]];
    if (round) {
      const double along = f.axis.dot(q) / h, c = u.dot(q), s = v.dot(q),
                   r = std::max(1e-9, std::hypot(c, s));
      values[i] = r - f.radius_mm;
      design.row(i) << along * c / r, along * s / r, c / r, s / r, 1;
    } else {
      values[i] = f.axis.dot(q);
      design.row(i) << u.dot(q) / h, v.dot(q) / h, 1;
    }
  }
  const Regression fit = regress(design, values, weights, patches_of(points, normals, h / 3));
  // The coefficients are: two of direction (mm over h), then the position; a cylinder's radius last.
  FeatureDemand demand;
  demand.points = used.size();
  demand.rms_mm = fit.rms;
  const auto row = [&](const Eigen::Vector3d& at,
                       const Eigen::Vector3d& direction) -> Eigen::Matrix<double, 1, 6> {
    return frame.row(at, direction).transpose();
  };
  const Eigen::Vector3d o = f.origin;
  Eigen::Index first = 0, count = 0;
  if (f.datum.kind == DatumKind::kPoint) {
    demand.rows.resize(1, 6);
    demand.rows.row(0) = row(o, f.axis);
    first = 2, count = 1;
  } else if (!round) {
    demand.directions = 2, count = 3;
    demand.rows.resize(3, 6);
    demand.rows.row(0) = row(o + h * u, f.axis) - row(o, f.axis);
    demand.rows.row(1) = row(o + h * v, f.axis) - row(o, f.axis);
    demand.rows.row(2) = row(o, f.axis);
  } else {
    demand.directions = 2, count = 4;
    demand.rows.resize(4, 6);
    demand.rows.row(0) = row(o + h * f.axis, u) - row(o, u);
    demand.rows.row(1) = row(o + h * f.axis, v) - row(o, v);
    demand.rows.row(2) = row(o, u);
    demand.rows.row(3) = row(o, v);
  }
  Eigen::VectorXd scale = Eigen::VectorXd::Ones(count);
  scale.head(demand.directions).setConstant(frame.lever_mm / h);
  demand.rows = scale.asDiagonal() * demand.rows;
  demand.excess = scale.cwiseProduct(fit.coefficients.segment(first, count));
  demand.covariance =
      scale.asDiagonal() * fit.covariance.block(first, first, count, count) * scale.asDiagonal();
  return demand;
}

}  // namespace gantry::internal
