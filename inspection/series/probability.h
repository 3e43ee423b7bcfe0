#pragma once

namespace gantry::series {

/// Distributions of normal samples, by Boost.Math: its headers take seconds to compile, here only once.

/// Probability that chi-square with `freedoms` (need not be whole) is below `x`.
double chi_square_below(double x, double freedoms);
/// The value that chi-square is below with probability `p`, 0 < p < 1.
double chi_square_quantile(double p, double freedoms);
/// Probability that Fisher's F is above `f`.
double fisher_above(double f, double freedoms_above, double freedoms_below);
/// The value that Student's t is below with probability `p`, 0.5 <= p < 1.
double student_quantile(double p, double freedoms);

}  // namespace gantry::series
