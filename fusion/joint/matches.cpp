#include "joint/matches.h"

#include "joint/match_kernel.h"
#include "joint/projection.h"

namespace gantry::internal {
namespace {

/// A wall's two faces touch when they are this near to each other, of the tolerance: noise must not let walls
/// that are thinner than the tolerance touch.
constexpr float kContact = 0.3f;
/// Nothing measured within this many pixels: the target saw through here.
constexpr int kEmptyPixels = 6;

/// What tilted normals add to a Hessian: with n' = n + e, e across n with variance s^2,
/// E[a' a'^T] = a a^T + s^2 (A A^T - a a^T), where a = A n and A = [[arm]x; I].
Matrix6d tilts_of(const Matrix6d& hessian, double weight, const Eigen::Vector3d& arms,
                  const Eigen::Matrix3d& squares, double variance) {
  Matrix6d all = Matrix6d::Zero();  // sum w A A^T
  all.topLeftCorner<3, 3>() = squares.trace() * Eigen::Matrix3d::Identity() - squares;
  all.topRightCorner<3, 3>() = cross_matrix(arms);
  all.bottomLeftCorner<3, 3>() = cross_matrix(arms).transpose();
  all.bottomRightCorner<3, 3>() = weight * Eigen::Matrix3d::Identity();
  return variance * (all - hessian);
}

MatchKernel make_kernel(const RangeSurface& target, const RangeSurface& source,
                        const Pose& target_from_source, const Eigen::Vector3d& middle,
                        const MatchGates& gates) {
  MatchKernel kernel;
  kernel.source_central = source.rays.central;
  kernel.target_central = target.rays.central;
  kernel.source_distorted = source.rays.distorted;
  kernel.target_distorted = target.rays.distorted;
  for (int r = 0; r < 3; ++r) {
    for (int c = 0; c < 3; ++c)
      kernel.rotation[3 * r + c] = static_cast<float>(target_from_source.linear()(r, c));
    kernel.shift[r] = static_cast<float>(target_from_source.translation()[r]);
    kernel.centre[r] = static_cast<float>(middle[r]);
  }
  for (int r = 0; r < 2; ++r)
    for (int c = 0; c < 3; ++c) {
      kernel.to_ray[3 * r + c] = static_cast<float>(source.rays.ray_of_pixel(r, c));
      kernel.to_pixel[3 * r + c] = static_cast<float>(target.rays.pixel_of_ray(r, c));
    }
  kernel.last_column = static_cast<float>(target.width - 1);
  kernel.last_row = static_cast<float>(target.height - 1);
  kernel.cosine = static_cast<float>(std::cos(gates.max_angle_rad));
  kernel.reach = static_cast<float>(gates.reach_mm);
  kernel.scale_squared = static_cast<float>(gates.scale_mm * gates.scale_mm);
  return kernel;
}

void collect_pixels(const RangeSurface& source, int first_column, int last_column, int first_row,
                    int last_row, int stride, MatchKernel::Pixels& out) {
  const auto first = [stride](int from) { return (from + stride - 1) / stride * stride; };
  out.count = 0;
  for (int row = first(first_row); row < last_row; row += stride) {
    for (int column = first(first_column); column < last_column; column += stride) {
      const size_t i = source.index(column, row);
      const int k = out.count;
      out.column[k] = static_cast<float>(column);
      out.row[k] = static_cast<float>(row);
      out.w[k] = source.w[i];
      out.a[k] = source.normals[i].a;
      out.b[k] = source.normals[i].b;
      out.count += source.w[i] != 0;
      if (source.rays.distorted && out.count > k) {
        const Eigen::Vector2d ray = source.rays.ray(column, row);
        out.u[k] = static_cast<float>(ray.x());
        out.v[k] = static_cast<float>(ray.y());
      }
      // The next pixel may overwrite an empty one; the last place is never needed for that.
      if (out.count == MatchKernel::kMost) return;
    }
  }
}

/// Keeps what falls between four measurements of the target.
void collect_pairs(const RangeSurface& target, const MatchKernel& kernel, int count,
                   const MatchKernel::Falls& falls, MatchKernel::Pairs& out) {
  out.count = 0;
  for (int k = 0; k < count; ++k) {
    if (falls.facing[k] == 0) continue;
    float column = falls.column[k], row = falls.row[k];
    if (kernel.target_distorted) {
      const Eigen::Vector2d pixel = target.rays.pixel({falls.u[k], falls.v[k]});
      column = static_cast<float>(pixel.x());
      row = static_cast<float>(pixel.y());
    }
    if (!(column >= 0 && row >= 0 && column < kernel.last_column && row < kernel.last_row)) continue;
    const int c = static_cast<int>(column), r = static_cast<int>(row);
    const size_t j = target.index(c, r), below = j + static_cast<size_t>(target.width);
    const float w00 = target.w[j], w01 = target.w[j + 1], w10 = target.w[below], w11 = target.w[below + 1];
    if (w00 == 0 || w01 == 0 || w10 == 0 || w11 == 0) continue;
    const float fc = column - static_cast<float>(c), fr = row - static_cast<float>(r);
    const PackedNormal m = target.normals[(fr > 0.5f ? below : j) + (fc > 0.5f ? 1 : 0)];
    const int n = out.count++;
    out.q_w[n] = (1 - fr) * ((1 - fc) * w00 + fc * w01) + fr * ((1 - fc) * w10 + fc * w11);
    out.a[n] = m.a;
    out.b[n] = m.b;
    out.px[n] = falls.px[k];
    out.py[n] = falls.py[k];
    out.pz[n] = falls.pz[k];
    out.nx[n] = falls.nx[k];
    out.ny[n] = falls.ny[k];
    out.nz[n] = falls.nz[k];
    out.w[n] = falls.w[k];
  }
}

void add_block(const MatchKernel::Sums& block, PairSum& sum, Eigen::Vector3d& arms,
               Eigen::Matrix3d& squares) {
  int h = 0;
  for (int i = 0; i < 6; ++i) {
    for (int j = i; j < 6; ++j) sum.hessian(i, j) += block.hessian[h++];
    sum.gradient[i] += block.gradient[i];
  }
  h = 0;
  for (int i = 0; i < 3; ++i) {
    arms[i] += block.arms[i];
    for (int j = i; j < 3; ++j) {
      squares(i, j) += block.squares[h];
      if (i != j) squares(j, i) += block.squares[h];
      ++h;
    }
  }
  sum.weight += block.weight;
  sum.stiffness += block.stiffness;
  sum.cost += block.cost;
  sum.matches += static_cast<size_t>(block.matches);
}

/// Completes sums (upper triangles so far) and turns them from the target's frame into the part's.
void turn_into_part(PairSum& sum, const Eigen::Vector3d& arms, const Eigen::Matrix3d& squares,
                    double normal_variance, const Matrix6d& part_from_target) {
  const Matrix6d full = sum.hessian.selfadjointView<Eigen::Upper>();
  sum.hessian = part_from_target * full * part_from_target.transpose();
  sum.tilts = part_from_target * tilts_of(full, sum.weight, arms, squares, normal_variance) *
              part_from_target.transpose();
  sum.gradient = part_from_target * sum.gradient;
}

}  // namespace

PairSum match_by_projection(const RangeSurface& target, const RangeSurface& source,
                            const Pose& target_from_source, const Pose& part_from_target,
                            const Eigen::Vector3d& centre, const MatchGates& gates, int first_row,
                            int last_row, std::vector<BlockSum>* blocks, const ActiveBlocks* visited,
                            ActiveBlocks* found) {
  const Eigen::Vector3d middle = part_from_target.inverse() * centre;
  const MatchKernel kernel = make_kernel(target, source, target_from_source, middle, gates);
  Matrix6d turn = Matrix6d::Zero();
  turn.topLeftCorner<3, 3>() = part_from_target.linear();
  turn.bottomRightCorner<3, 3>() = part_from_target.linear();
  // A block never holds more pixels than the kernel takes.
  const int size = ActiveBlocks::kPixels * gates.stride;
  const int step = visited || found ? ActiveBlocks::kPixels : size;

  PairSum sum;  // in the target's frame first; the upper triangle only
  Eigen::Vector3d arms = Eigen::Vector3d::Zero();
  Eigen::Matrix3d squares = Eigen::Matrix3d::Zero();
  MatchKernel::Pixels pixels;
  MatchKernel::Falls falls;
  MatchKernel::Pairs pairs;
  for (int row = first_row; row < last_row; row += step) {
    for (int column = 0; column < source.width; column += step) {
      const size_t at_block = static_cast<size_t>(row / step) * ActiveBlocks::across(source.width) +
                              static_cast<size_t>(column / step);
      if (visited && !visited->active[at_block]) continue;
      collect_pixels(source, column, std::min(source.width, column + step), row,
                     std::min(last_row, row + step), gates.stride, pixels);
      if (pixels.count == 0) continue;
      kernel.project(pixels, falls);
      collect_pairs(target, kernel, pixels.count, falls, pairs);
      if (pairs.count == 0) continue;
      MatchKernel::Sums block;
      kernel.sum(pairs, block);
      if (block.matches == 0) continue;
      if (found) found->active[at_block] = 1;
      add_block(block, sum, arms, squares);
      if (blocks) {
        PairSum alone;
        Eigen::Vector3d its_arms = Eigen::Vector3d::Zero();
        Eigen::Matrix3d its_squares = Eigen::Matrix3d::Zero();
        add_block(block, alone, its_arms, its_squares);
        turn_into_part(alone, its_arms, its_squares, gates.normal_variance, turn);
        const Eigen::Vector3d place =
            Eigen::Vector3d(block.place[0], block.place[1], block.place[2]) / block.matches + middle;
        alone.hessian -= alone.tilts;
        blocks->push_back({(part_from_target * place).cast<float>(), alone.gradient.cast<float>(),
                           alone.hessian.cast<float>()});
      }
    }
  }
  turn_into_part(sum, arms, squares, gates.normal_variance, turn);
  return sum;
}

Agreement& Agreement::operator+=(const Agreement& o) {
  tested += o.tested;
  matched += o.matched;
  in_front += o.in_front;
  background += o.background;
  contact += o.contact;
  squares += o.squares;
  return *this;
}

Agreement compare(const RangeSurface& target, const RangeSurface& source, const Pose& target_from_source,
                  double tolerance_mm, int stride) {
  Agreement result;
  const Projector projector(target, source, target_from_source);
  const auto tolerance = static_cast<float>(tolerance_mm);
  const auto empty = [&](const Projected& at) {
    for (const int dr : {-kEmptyPixels, 0, kEmptyPixels})
      for (const int dc : {-kEmptyPixels, 0, kEmptyPixels}) {
        const int c = at.column + dc, r = at.row + dr;
        if (c < 0 || r < 0 || c >= target.width || r >= target.height) continue;
        if (target.flags[target.index(c, r)] & RangeSurface::kSeen) return false;
      }
    return true;
  };
  projector.block<false>(0, source.width, 0, source.height, stride, [&](const Projected& at) {
    Surface surface;
    if (!projector.measured(at, surface)) {
      if (empty(at)) {
        ++result.tested;
        ++result.background;
      }
      return;
    }
    const Eigen::Vector3f m = unpack_normal(target.normals[surface.nearest]);
    const float d = projector.distance(at, surface, m);
    const float agree = m.dot(at.n);
    if (d < -tolerance) return;  // behind: hidden from the target, which says nothing
    ++result.tested;
    if (d > tolerance) {
      ++result.in_front;
    } else if (agree > 0.7f) {
      ++result.matched;
      result.squares += static_cast<double>(d) * d;
    } else if (agree < -0.5f && std::abs(d) < kContact * tolerance) {
      ++result.contact;
    }
  });
  return result;
}

}  // namespace gantry::internal
