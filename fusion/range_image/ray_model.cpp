#include "range_image/ray_model.h"

#include <Eigen/Eigenvalues>
#include <Eigen/QR>
#include <cmath>

namespace gantry {

Eigen::Matrix<double, RayModel::kTerms, 1> RayModel::terms(double a, double b) {
  Eigen::Matrix<double, kTerms, 1> t;
  t << 1, a, b, a * a, a * b, b * b, a * a * a, a * a * b, a * b * b, b * b * b;
  return t;
}

namespace internal {
namespace {

/// Residuals below this (pixels) are the rounding of coordinates, not distortion.
constexpr double kUndistorted_px = 0.02;
constexpr double kWorstFit_px = 0.1;

/// Least squares with `count` leading terms; `rms` in the unit of `to`.
RayModel::Polynomial fit_polynomial(const std::vector<Eigen::Vector2d>& from,
                                    const std::vector<Eigen::Vector2d>& to, int count, double& rms) {
  const auto n = static_cast<Eigen::Index>(from.size());
  Eigen::MatrixXd a(n, count), b(n, 2);
  for (Eigen::Index i = 0; i < n; ++i) {
    a.row(i) = RayModel::terms(from[i].x(), from[i].y()).head(count).transpose();
    b.row(i) = to[i].transpose();
  }
  const Eigen::VectorXd scale = a.colwise().norm().transpose().cwiseMax(1e-300);
  a *= scale.cwiseInverse().asDiagonal();
  const Eigen::MatrixXd x = a.colPivHouseholderQr().solve(b);
  rms = std::sqrt((a * x - b).squaredNorm() / static_cast<double>(n));
  RayModel::Polynomial p = RayModel::Polynomial::Zero();
  p.leftCols(count) = (scale.cwiseInverse().asDiagonal() * x).transpose();
  return p;
}

/// Fits both maps for samples whose rays are known; `rms_px` tells how well.
RayModel fit_maps(const std::vector<Eigen::Vector2d>& pixels, const std::vector<Eigen::Vector2d>& rays,
                  bool central, double& rms_px) {
  RayModel model;
  model.central = central;
  double unused = 0;
  model.pixel_of_ray = fit_polynomial(rays, pixels, 3, rms_px);
  model.distorted = rms_px > kUndistorted_px;
  const int terms = model.distorted ? RayModel::kTerms : 3;
  if (model.distorted) model.pixel_of_ray = fit_polynomial(rays, pixels, terms, rms_px);
  model.ray_of_pixel = fit_polynomial(pixels, rays, terms, unused);
  return model;
}

/// Positions across parallel rays are linear in column and row, so what a linear fit of the points leaves
/// over lies along the rays.
Eigen::Vector3d parallel_direction(const std::vector<PixelSample>& samples) {
  const auto n = static_cast<Eigen::Index>(samples.size());
  Eigen::MatrixXd a(n, 3), b(n, 3);
  for (Eigen::Index i = 0; i < n; ++i) {
    a.row(i) << 1, samples[i].pixel.x(), samples[i].pixel.y();
    b.row(i) = samples[i].point.transpose();
  }
  const Eigen::MatrixXd left = b - a * a.colPivHouseholderQr().solve(b);
  return Eigen::SelfAdjointEigenSolver<Eigen::Matrix3d>(left.transpose() * left).eigenvectors().col(2);
}

/// The camera that sees the points at their pixels, wherever it stands: direct linear transformation
/// (Hartley and Zisserman, algorithm 7.1). Noise along the rays does not disturb it. Nothing for points on
/// a plane, which fix no camera.
std::optional<Pose> locate_camera(const std::vector<PixelSample>& samples) {
  Eigen::Vector3d middle = Eigen::Vector3d::Zero();
  Eigen::Vector2d pixel_middle = Eigen::Vector2d::Zero();
  for (const auto& s : samples) {
    middle += s.point / static_cast<double>(samples.size());
    pixel_middle += s.pixel / static_cast<double>(samples.size());
  }
  double size = 0, pixel_size = 0;
  for (const auto& s : samples) {
    size += (s.point - middle).norm() / static_cast<double>(samples.size());
    pixel_size += (s.pixel - pixel_middle).norm() / static_cast<double>(samples.size());
  }
  if (!(size > 0) || !(pixel_size > 0)) return std::nullopt;
  Eigen::Matrix<double, 12, 12> squares = Eigen::Matrix<double, 12, 12>::Zero();
  for (const auto& s : samples) {
    const Eigen::Vector4d x = ((s.point - middle) / size).homogeneous();
    const Eigen::Vector2d c = (s.pixel - pixel_middle) / pixel_size;
    for (int k = 0; k < 2; ++k) {
      Eigen::Matrix<double, 12, 1> row = Eigen::Matrix<double, 12, 1>::Zero();
      row.segment<4>(4 * k) = x;
      row.tail<4>() = -c[k] * x;
      squares += row * row.transpose();
    }
  }
  const Eigen::SelfAdjointEigenSolver<Eigen::Matrix<double, 12, 12>> solver(squares);
  if (solver.eigenvalues()(1) < 1e-9 * solver.eigenvalues()(11)) return std::nullopt;
  const Eigen::Matrix<double, 12, 1> p = solver.eigenvectors().col(0);
  Eigen::Matrix<double, 3, 4> camera;
  camera << p.segment<4>(0).transpose(), p.segment<4>(4).transpose(), p.tail<4>().transpose();
  double in_front = 0;
  for (const auto& s : samples)
    in_front += camera.row(2).dot(((s.point - middle) / size).homogeneous()) > 0 ? 1 : -1;
  if (in_front < 0) camera *= -1;
  const Eigen::Matrix3d m = camera.leftCols<3>();
  if (std::abs(m.determinant()) < 1e-12 * std::pow(m.norm(), 3)) return std::nullopt;
  // The viewing direction is the third row; the image's axes follow by making the rows orthogonal to it.
  const Eigen::Vector3d z = m.row(2).transpose().normalized();
  const Eigen::Vector3d right = m.row(0).transpose();
  const Eigen::Vector3d x = (right - right.dot(z) * z).normalized();
  Pose scan_from_camera = Pose::Identity();
  scan_from_camera.linear() << x, z.cross(x), z;
  scan_from_camera.translation() = middle - size * m.inverse() * camera.col(3);
  return scan_from_camera;
}

}  // namespace

std::optional<FittedRays> fit_rays(const std::vector<PixelSample>& samples) {
  if (samples.size() < 50) return std::nullopt;
  std::vector<Eigen::Vector2d> pixels, rays;
  bool in_front = true;
  for (const auto& s : samples) {
    pixels.push_back(s.pixel);
    rays.emplace_back(s.point.x() / s.point.z(), s.point.y() / s.point.z());
    in_front = in_front && s.point.z() > 0;
  }
  double rms_px = 0;
  FittedRays fitted;
  if (in_front) {
    fitted.rays = fit_maps(pixels, rays, true, rms_px);
    if (rms_px < kWorstFit_px) return fitted;
  }
  if (const auto camera = locate_camera(samples)) {
    const Pose camera_from_scan = camera->inverse();
    in_front = true;
    for (size_t i = 0; i < samples.size(); ++i) {
      const Eigen::Vector3d p = camera_from_scan * samples[i].point;
      rays[i] = p.head<2>() / p.z();
      in_front = in_front && p.z() > 0;
    }
    if (in_front) {
      fitted.rays = fit_maps(pixels, rays, true, rms_px);
      fitted.sensor_from_grid = *camera;
      if (rms_px < kWorstFit_px) return fitted;
    }
  }
  const Eigen::Vector3d z = parallel_direction(samples);
  fitted.sensor_known = false;
  Eigen::Matrix3d axes = Eigen::Quaterniond::FromTwoVectors(Eigen::Vector3d::UnitZ(), z).toRotationMatrix();
  const auto fit_along = [&] {
    for (size_t i = 0; i < samples.size(); ++i) rays[i] = (axes.transpose() * samples[i].point).head<2>();
    fitted.rays = fit_maps(pixels, rays, false, rms_px);
  };
  fit_along();
  // Columns run to the right and rows down as the sensor sees them, unless the grid is listed mirrored.
  if (fitted.rays.ray_of_pixel.block<2, 2>(0, 1).determinant() < 0) {
    axes = axes * Eigen::Vector3d(1, -1, -1).asDiagonal();
    fit_along();
  }
  fitted.sensor_from_grid = Pose::Identity();
  fitted.sensor_from_grid.linear() = axes;
  if (rms_px < kWorstFit_px) return fitted;
  return std::nullopt;
}

}  // namespace internal
}  // namespace gantry
