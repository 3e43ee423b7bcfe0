#pragma once

#include <functional>
#include <vector>

namespace gantry::internal {

/// How a window of 2 * half + 1 pixels squared looks around one pixel: the plane w = value + column_slope
/// * (c - c0) + row_slope * (r - r0) fitted to all pixels that hold data but the innermost nine. Without
/// these the fit does not know the noise of the measurements it is used with: a normal tilted by the noise
/// of its own point would, at the border of the data where windows are lopsided, push surfaces sideways.
struct WindowFit {
  const float* value;
  const float* column_slope;  ///< Per pixel.
  const float* row_slope;
  const float* count;  ///< Pixels that took part; fits of fewer than 6 are meaningless.
};

/// Fits a plane around every pixel of one row after the other, in parallel over bands of rows, and calls
/// `row_done(row, fit)` with arrays of `width` entries for each. Pixels with w = 0 take no part.
/// Separable sums: the cost does not depend on how many pixels hold data, and grows with `half`, not its
/// square.
void fit_windows(const std::vector<float>& w, int width, int height, int half,
                 const std::function<void(int row, const WindowFit& fit)>& row_done);

}  // namespace gantry::internal
