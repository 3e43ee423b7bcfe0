#include "series/probability.h"

#include <cmath>
#include <initializer_list>

namespace gantry::series {
namespace {

constexpr double kPrecision = 1e-15;

/// Regularised incomplete gamma function P(a, x): its series below a + 1, its continued fraction above
/// (Abramowitz and Stegun 6.5.29 and 6.5.31, the latter by Lentz's method).
double incomplete_gamma(double a, double x) {
  if (x <= 0) return 0;
  const double front = std::exp(a * std::log(x) - x - std::lgamma(a));
  if (x < a + 1) {
    double term = 1 / a, sum = term;
    for (int n = 1; n < 10'000 && term > kPrecision * sum; ++n) sum += term *= x / (a + n);
    return front * sum;
  }
  constexpr double kTiny = 1e-300;
  double b = x + 1 - a, c = 1 / kTiny, d = 1 / b, h = d;
  for (int i = 1; i < 10'000; ++i) {
    const double numerator = -i * (i - a);
    b += 2;
    d = numerator * d + b;
    c = b + numerator / c;
    if (std::abs(d) < kTiny) d = kTiny;
    if (std::abs(c) < kTiny) c = kTiny;
    d = 1 / d;
    h *= d * c;
    if (std::abs(d * c - 1) < kPrecision) break;
  }
  return 1 - front * h;
}

/// The continued fraction of the incomplete beta function (Abramowitz and Stegun 26.5.8), by Lentz's method.
double beta_fraction(double x, double a, double b) {
  constexpr double kTiny = 1e-300;
  double c = 1, d = 1 - (a + b) * x / (a + 1);
  if (std::abs(d) < kTiny) d = kTiny;
  d = 1 / d;
  double h = d;
  for (int m = 1; m < 10'000; ++m) {
    const double even = m * (b - m) * x / ((a + 2 * m - 1) * (a + 2 * m));
    const double odd = -(a + m) * (a + b + m) * x / ((a + 2 * m) * (a + 2 * m + 1));
    double step = 1;
    for (const double numerator : {even, odd}) {
      d = 1 + numerator * d;
      c = 1 + numerator / c;
      if (std::abs(d) < kTiny) d = kTiny;
      if (std::abs(c) < kTiny) c = kTiny;
      d = 1 / d;
      step = d * c;
      h *= step;
    }
    if (std::abs(step - 1) < kPrecision) break;
  }
  return h;
}

/// Regularised incomplete beta function I_x(a, b).
double incomplete_beta(double x, double a, double b) {
  if (x <= 0) return 0;
  if (x >= 1) return 1;
  const double front =
      std::exp(std::lgamma(a + b) - std::lgamma(a) - std::lgamma(b) + a * std::log(x) + b * std::log1p(-x));
  if (x < (a + 1) / (a + b + 2)) return front * beta_fraction(x, a, b) / a;
  return 1 - front * beta_fraction(1 - x, b, a) / b;
}

/// Where the rising function `below` reaches p; the upper end is found by doubling.
template <typename Below>
double inverted(Below&& below, double p) {
  double low = 0, high = 1;
  while (below(high) < p && high < 1e12) high *= 2;
  for (int i = 0; i < 200 && high - low > 1e-14 * high; ++i) {
    const double middle = (low + high) / 2;
    (below(middle) < p ? low : high) = middle;
  }
  return (low + high) / 2;
}

}  // namespace

double chi_square_below(double x, double freedoms) {
  return incomplete_gamma(freedoms / 2, x / 2);
}

double chi_square_quantile(double p, double freedoms) {
  return inverted([&](double x) { return chi_square_below(x, freedoms); }, p);
}

double fisher_above(double f, double freedoms_above, double freedoms_below) {
  if (!(f > 0)) return 1;
  if (std::isinf(f)) return 0;
  return incomplete_beta(freedoms_below / (freedoms_below + freedoms_above * f), freedoms_below / 2,
                         freedoms_above / 2);
}

double student_quantile(double p, double freedoms) {
  return inverted(
      [&](double t) { return 1 - incomplete_beta(freedoms / (freedoms + t * t), freedoms / 2, 0.5) / 2; }, p);
}

}  // namespace gantry::series
