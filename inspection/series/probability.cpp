#include "probability.h"

#include <boost/math/distributions/chi_squared.hpp>
#include <boost/math/distributions/fisher_f.hpp>
#include <boost/math/distributions/students_t.hpp>
#include <cmath>

namespace gantry::series {

using boost::math::cdf;
using boost::math::complement;
using boost::math::quantile;

double chi_square_below(double x, double freedoms) {
  return cdf(boost::math::chi_squared(freedoms), x);
}

double chi_square_quantile(double p, double freedoms) {
  return quantile(boost::math::chi_squared(freedoms), p);
}

double fisher_above(double f, double freedoms_above, double freedoms_below) {
  if (std::isinf(f)) return 0;  // which Boost refuses
  return cdf(complement(boost::math::fisher_f(freedoms_above, freedoms_below), f));
}

double student_quantile(double p, double freedoms) {
  return quantile(boost::math::students_t(freedoms), p);
}

}  // namespace gantry::series
