#include "range_image/grid_normals.h"

#include <tbb/parallel_for.h>

#include <algorithm>

#include "range_image/simd.h"

namespace gantry::internal {
namespace {

constexpr int kBandRows = 48;
/// Half width of the hole in the middle of each window.
constexpr int kHole = 1;
/// Sums over a window of m (1 where there is data), m x, m x x, m w, m x w along the row.
constexpr int kRowSums = 5;
/// ... and over rows: m, mx, my, mxx, mxy, myy, mw, mxw, myw.
constexpr int kWindowSums = 9;

/// Horizontal sums of one row. `padded` has `half` zeros on either side of the row's w.
GANTRY_MULTIVERSION void sum_along_row(const float* padded, int width, int half, float* __restrict out) {
  float* __restrict m = out;
  float* __restrict mx = out + width;
  float* __restrict mxx = out + 2 * width;
  float* __restrict mw = out + 3 * width;
  float* __restrict mxw = out + 4 * width;
  std::fill(out, out + kRowSums * width, 0.0f);
  for (int d = -half; d <= half; ++d) {
    const float* __restrict w = padded + half + d;
    const float x = static_cast<float>(d), xx = x * x;
    for (int c = 0; c < width; ++c) {
      const float there = w[c] != 0.0f ? 1.0f : 0.0f;
      m[c] += there;
      mx[c] += x * there;
      mxx[c] += xx * there;
      mw[c] += w[c];
      mxw[c] += x * w[c];
    }
  }
}

/// Adds one row's sums, `y` rows below the centre, with a factor of 1 or -1.
GANTRY_MULTIVERSION void add_row(const float* __restrict row, int width, float y, float factor,
                                 float* __restrict out) {
  const float* __restrict m = row;
  const float* __restrict mx = row + width;
  const float* __restrict mxx = row + 2 * width;
  const float* __restrict mw = row + 3 * width;
  const float* __restrict mxw = row + 4 * width;
  float* __restrict s = out;
  for (int c = 0; c < width; ++c) {
    s[c] += factor * m[c];
    s[width + c] += factor * mx[c];
    s[2 * width + c] += factor * y * m[c];
    s[3 * width + c] += factor * mxx[c];
    s[4 * width + c] += factor * y * mx[c];
    s[5 * width + c] += factor * y * y * m[c];
    s[6 * width + c] += factor * mw[c];
    s[7 * width + c] += factor * mxw[c];
    s[8 * width + c] += factor * y * mw[c];
  }
}

/// The least-squares plane from the sums, by elimination about the window's centroid.
GANTRY_MULTIVERSION void solve_row(const float* __restrict s, int width, float* __restrict value,
                                   float* __restrict column_slope, float* __restrict row_slope) {
  for (int c = 0; c < width; ++c) {
    const float n = std::max(s[c], 1.0f), by_n = 1.0f / n;
    const float x = s[width + c] * by_n, y = s[2 * width + c] * by_n, w = s[6 * width + c] * by_n;
    const float xx = s[3 * width + c] - n * x * x, xy = s[4 * width + c] - n * x * y,
                yy = s[5 * width + c] - n * y * y;
    const float xw = s[7 * width + c] - n * x * w, yw = s[8 * width + c] - n * y * w;
    const float determinant = xx * yy - xy * xy;
    const float by_determinant = determinant > 0.5f ? 1.0f / determinant : 0.0f;
    const float a = (yy * xw - xy * yw) * by_determinant, b = (xx * yw - xy * xw) * by_determinant;
    column_slope[c] = a;
    row_slope[c] = b;
    value[c] = w - a * x - b * y;
  }
}

/// Sums along the last 2 * half + 1 rows that were asked for.
class RowSums {
 public:
  RowSums(const std::vector<float>& w, int width, int height, int half)
      : w_(w),
        width_(width),
        height_(height),
        half_(half),
        size_(static_cast<size_t>(kRowSums) * width),
        ring_(size_ * (2 * half + 1)),
        padded_(width + 2 * static_cast<size_t>(half), 0.0f) {}

  void fill(int row) {
    float* out = at(row);
    if (row < 0 || row >= height_) {
      std::fill(out, out + size_, 0.0f);
      return;
    }
    const auto begin = w_.begin() + static_cast<std::ptrdiff_t>(row) * width_;
    std::copy(begin, begin + width_, padded_.begin() + half_);
    sum_along_row(padded_.data(), width_, half_, out);
  }
  const float* of(int row) { return at(row); }

 private:
  float* at(int row) {
    const int rows = 2 * half_ + 1;
    return ring_.data() + size_ * static_cast<size_t>((row + rows) % rows);
  }

  const std::vector<float>& w_;
  int width_, height_, half_;
  size_t size_;
  std::vector<float> ring_, padded_;
};

}  // namespace

void fit_windows(const std::vector<float>& w, int width, int height, int half,
                 const std::function<void(int row, const WindowFit& fit)>& row_done) {
  const int bands = (height + kBandRows - 1) / kBandRows;
  tbb::parallel_for(0, bands, [&](int band) {
    const int first = band * kBandRows, last = std::min(height, first + kBandRows);
    RowSums outer(w, width, height, half), inner(w, width, height, kHole);
    std::vector<float> sums(static_cast<size_t>(kWindowSums) * width), fit(3 * static_cast<size_t>(width));
    for (int row = first - half; row < first + half; ++row) outer.fill(row);
    for (int row = first - kHole; row < first + kHole; ++row) inner.fill(row);
    for (int row = first; row < last; ++row) {
      outer.fill(row + half);
      inner.fill(row + kHole);
      std::fill(sums.begin(), sums.end(), 0.0f);
      for (int y = -half; y <= half; ++y)
        add_row(outer.of(row + y), width, static_cast<float>(y), 1, sums.data());
      for (int y = -kHole; y <= kHole; ++y)
        add_row(inner.of(row + y), width, static_cast<float>(y), -1, sums.data());
      solve_row(sums.data(), width, fit.data(), fit.data() + width, fit.data() + 2 * width);
      row_done(row, {fit.data(), fit.data() + width, fit.data() + 2 * width, sums.data()});
    }
  });
}

}  // namespace gantry::internal
