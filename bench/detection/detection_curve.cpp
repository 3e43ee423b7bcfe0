#include "detection_curve.h"

#include <Eigen/Core>
#include <Eigen/LU>
#include <algorithm>
#include <cmath>

namespace gantry::bench {
namespace {

double logistic(double x) {
  return 1 / (1 + std::exp(-x));
}

}  // namespace

double DetectionCurve::probability(double depth_mm) const {
  return logistic(slope * (std::log(depth_mm) - middle));
}

std::optional<DetectionCurve> fit_detection(std::span<const Trial> trials) {
  const auto hits = std::count_if(trials.begin(), trials.end(), [](const Trial& t) { return t.found; });
  if (trials.size() < 10 || hits == 0 || hits == static_cast<std::ptrdiff_t>(trials.size()))
    return std::nullopt;
  double mean = 0;
  for (const Trial& t : trials) mean += std::log(t.depth_mm) / static_cast<double>(trials.size());
  Eigen::Vector2d b(0, 1);  // logit(p) = b0 + b1 (ln depth - mean)
  Eigen::Matrix2d inverse = Eigen::Matrix2d::Identity();
  for (int round = 0; round < 200; ++round) {
    Eigen::Matrix2d information = Eigen::Matrix2d::Zero();
    for (const Trial& t : trials) {
      const Eigen::Vector2d x(1, std::log(t.depth_mm) - mean);
      const double p = logistic(b.dot(x));
      information += p * (1 - p) * x * x.transpose();
    }
    if (!(information.determinant() > 1e-12)) return std::nullopt;
    inverse = information.inverse();
    Eigen::Vector2d score = Eigen::Vector2d::Zero();
    for (const Trial& t : trials) {
      const Eigen::Vector2d x(1, std::log(t.depth_mm) - mean);
      const double p = logistic(b.dot(x)), leverage = p * (1 - p) * x.dot(inverse * x);
      score += (t.found - p + leverage * (0.5 - p)) * x;
    }
    Eigen::Vector2d step = inverse * score;
    step *= std::min(1.0, 2 / std::max(step.norm(), 1e-12));
    b += step;
    if (step.norm() < 1e-8) break;
  }
  if (!(b[1] > 0)) return std::nullopt;
  DetectionCurve curve;
  curve.slope = b[1];
  curve.middle = mean - b[0] / b[1];
  const double logit90 = std::log(9.0), at90 = (logit90 - b[0]) / b[1];  // ln a90 - mean
  const Eigen::Vector2d gradient(-1 / b[1], -at90 / b[1]);
  curve.a50_mm = std::exp(curve.middle);
  curve.a90_mm = std::exp(mean + at90);
  curve.a90_95_mm = std::exp(mean + at90 + 1.645 * std::sqrt(gradient.dot(inverse * gradient)));
  return curve;
}

}  // namespace gantry::bench
