#include "report/renderer.h"

#include <tbb/parallel_for.h>

#include <algorithm>
#include <array>
#include <cmath>
#include <limits>

namespace gantry::report {
namespace {

constexpr float kInfinity = std::numeric_limits<float>::infinity();
constexpr int kBandRows = 16;         // rows that one task draws
constexpr int kSamples = 4;           // per pixel and direction where surfaces meet
constexpr int kHatchPixels = 18;      // from line to line, sideways
constexpr float kSameNormal = 0.93f;  // cosine; a sharper turn is an edge
constexpr float kBiasMm = 0.15f;      // the CAD surface wins over discs that lie in it

const Eigen::Vector3f kCutColour(0.30f, 0.31f,
                                 0.33f);  // the inside of the material, behind a picture plane that cuts it
const Eigen::Vector3f kOutlineColour(0.07f, 0.08f, 0.10f);

enum class Kind : unsigned char { kEmpty, kCad, kCut, kDisc };

/// The surface that one line of sight meets.
struct Sight {
  Kind kind = Kind::kEmpty;
  float depth = kInfinity;
  Eigen::Vector3f normal = Eigen::Vector3f::Zero();  // towards the viewer
};

/// What a pixel's surface is known to be like.
struct Attributes {
  float deviation = std::numeric_limits<float>::quiet_NaN();  // NaN: not seen
  float defect = 0;                                           // share of the neighbourhood that is defective
  float light = 1;                                            // what ambient occlusion leaves
};

class Renderer {
 public:
  Renderer(const RayScene& cad, const MeasuredSurface& measured, const ColourScale& colours,
           const Camera& camera, Colouring colouring)
      : cad_(cad),
        measured_(measured),
        colours_(colours),
        camera_(camera),
        colouring_(colouring),
        width_(camera.width),
        height_(camera.height) {
    const size_t pixels = static_cast<size_t>(width_) * height_;
    sights_.resize(pixels);
    attributes_.resize(pixels);
    disc_depth_.assign(4 * pixels, kInfinity);
    disc_.assign(4 * pixels, -1);
    light_ = (camera.towards + 0.28f * camera.up - 0.2f * camera.right).normalized();
  }

  Rendering draw() {
    draw_discs();
    for_rows([this](int y) {
      for (int x = 0; x < width_; ++x) look(x, y);
    });
    spread_deviations();
    smooth_defect_shares();
    for_rows([this](int y) {
      for (int x = 0; x < width_; ++x) attributes_[at(x, y)].light = ambient_light(x, y);
    });
    Rendering rendering;
    rendering.image.width = width_;
    rendering.image.height = height_;
    rendering.image.rgba.assign(4 * sights_.size(), 0);
    for_rows([&](int y) {
      for (int x = 0; x < width_; ++x) paint(x, y, &rendering.image.rgba[4 * at(x, y)]);
    });
    for (const Sight& s : sights_) rendering.depth_mm.push_back(s.depth);
    return rendering;
  }

 private:
  size_t at(int x, int y) const { return static_cast<size_t>(y) * width_ + x; }
  bool inside(int x, int y) const { return x >= 0 && y >= 0 && x < width_ && y < height_; }

  template <typename Function>
  void for_bands(Function&& draw_band) const {
    tbb::parallel_for(0, (height_ + kBandRows - 1) / kBandRows, [&](int band) {
      draw_band(band * kBandRows, std::min(height_, (band + 1) * kBandRows));
    });
  }
  template <typename Function>
  void for_rows(Function&& draw_row) const {
    for_bands([&](int begin, int end) {
      for (int y = begin; y < end; ++y) draw_row(y);
    });
  }

  /// Depth-tested discs for material beyond the CAD model, at two samples per pixel and direction.
  void draw_discs() {
    const float scale = 0.5f * camera_.mm_per_pixel, radius = measured_.disc_mm;
    for_bands([&](int begin, int end) {
      for (size_t s = 0; s < measured_.off_cad.size(); ++s) {
        const Surfel& disc = measured_.off_cad[s];
        const float facing = disc.normal.dot(camera_.towards);
        if (facing < 0.05f) continue;
        const Eigen::Vector3f seen = camera_.project(disc.position);
        if (seen.z() <= 0) continue;
        const float reach = radius / scale;
        const int y0 = std::max(2 * begin, static_cast<int>(2 * seen.y() - reach));
        const int y1 = std::min(2 * end - 1, static_cast<int>(2 * seen.y() + reach));
        const int x0 = std::max(0, static_cast<int>(2 * seen.x() - reach));
        const int x1 = std::min(2 * width_ - 1, static_cast<int>(2 * seen.x() + reach));
        const float slope_x = disc.normal.dot(camera_.right) / facing,
                    slope_y = disc.normal.dot(camera_.up) / facing;
        for (int y = y0; y <= y1; ++y)
          for (int x = x0; x <= x1; ++x) {
            const float dx = (x + 0.5f - 2 * seen.x()) * scale, dy = (2 * seen.y() - y - 0.5f) * scale;
            const float dz = slope_x * dx + slope_y * dy;
            if (dx * dx + dy * dy + dz * dz > radius * radius) continue;
            const size_t i = static_cast<size_t>(y) * 2 * width_ + x;
            if (seen.z() + dz >= disc_depth_[i]) continue;
            disc_depth_[i] = seen.z() + dz;
            disc_[i] = static_cast<int>(s);
          }
      }
    });
  }

  /// Which disc covers a place of the picture; -1: none.
  int disc_at(float column, float row) const {
    const int x = std::min(static_cast<int>(2 * column), 2 * width_ - 1);
    const int y = std::min(static_cast<int>(2 * row), 2 * height_ - 1);
    return disc_[static_cast<size_t>(y) * 2 * width_ + x];
  }

  Sight sight(float column, float row) const {
    Sight s;
    if (const auto hit = cad_.cast(camera_.unproject(column, row, 0), -camera_.towards)) {
      s.depth = hit->distance;
      s.normal = cad_.mesh().normal(hit->triangle);
      const bool outside = s.normal.dot(camera_.towards) >= 0;
      s.kind = outside ? Kind::kCad : Kind::kCut;
      if (!outside) s.normal = -s.normal;
    }
    if (const int d = disc_at(column, row); d >= 0) {
      const Surfel& disc = measured_.off_cad[d];
      const float depth = camera_.project(disc.position).z();
      if (depth < s.depth - kBiasMm) s = {Kind::kDisc, depth, disc.normal};
    }
    return s;
  }

  void look(int x, int y) {
    Sight& s = sights_[at(x, y)];
    s = sight(x + 0.5f, y + 0.5f);
    if (s.kind != Kind::kDisc) return;
    const Surfel& disc = measured_.off_cad[disc_at(x + 0.5f, y + 0.5f)];
    attributes_[at(x, y)].deviation = disc.deviation_mm;
    attributes_[at(x, y)].defect = disc.defect > 0;
  }

  /// Every surfel gives its deviation to the CAD surface around it, weighted by the distance in space,
  /// and only to surface that faces as it does: opposite sides of a thin wall do not mix.
  void spread_deviations() {
    const float reach = measured_.reach_mm, sharpness = 4.5f / (reach * reach);
    if (measured_.on_cad.empty()) return;
    struct Sums {
      float weight = 0, deviation = 0, defect = 0;
    };
    for_bands([&](int begin, int end) {
      std::vector<Sums> sums(static_cast<size_t>(width_) * (end - begin));
      for (const Surfel& surfel : measured_.on_cad) {
        const Eigen::Vector3f seen = camera_.project(surfel.position);
        const float pixels = reach / camera_.mm_per_pixel;
        if (seen.y() + pixels < begin || seen.y() - pixels > end || seen.x() + pixels < 0 ||
            seen.x() - pixels > width_ || surfel.normal.dot(camera_.towards) < -0.3f)
          continue;
        const int y0 = std::max(begin, static_cast<int>(seen.y() - pixels));
        const int y1 = std::min(end - 1, static_cast<int>(seen.y() + pixels));
        const int x0 = std::max(0, static_cast<int>(seen.x() - pixels));
        const int x1 = std::min(width_ - 1, static_cast<int>(seen.x() + pixels));
        for (int y = y0; y <= y1; ++y)
          for (int x = x0; x <= x1; ++x) {
            const Sight& s = sights_[at(x, y)];
            if (s.kind != Kind::kCad) continue;
            const float dx = (x + 0.5f - seen.x()) * camera_.mm_per_pixel;
            const float dy = (y + 0.5f - seen.y()) * camera_.mm_per_pixel, dz = s.depth - seen.z();
            const float squared = dx * dx + dy * dy + dz * dz;
            if (squared > reach * reach || s.normal.dot(surfel.normal) < 0.5f) continue;
            const float weight = std::exp(-sharpness * squared);
            Sums& sum = sums[static_cast<size_t>(y - begin) * width_ + x];
            sum.weight += weight;
            sum.deviation += weight * surfel.deviation_mm;
            sum.defect += surfel.defect > 0 ? weight : 0;
          }
      }
      for (int y = begin; y < end; ++y)
        for (int x = 0; x < width_; ++x) {
          const Sums& sum = sums[static_cast<size_t>(y - begin) * width_ + x];
          if (sum.weight <= 0) continue;
          attributes_[at(x, y)].deviation = sum.deviation / sum.weight;
          attributes_[at(x, y)].defect = sum.defect / sum.weight;
        }
    });
  }

  /// Evens out the share of defective surface along the surface, so that a defect's outline does not
  /// follow the noise of single points.
  void smooth_defect_shares() {
    constexpr int kReach = 6;
    for (const auto& [step_x, step_y] : {std::pair{1, 0}, std::pair{0, 1}}) {
      std::vector<float> smooth(attributes_.size(), 0.0f);
      for_rows([&, dx = step_x, dy = step_y](int y) {
        for (int x = 0; x < width_; ++x) {
          const Sight& s = sights_[at(x, y)];
          if (s.kind != Kind::kCad) continue;
          float sum = 0, weights = 0;
          for (int k = -kReach; k <= kReach; ++k) {
            if (!inside(x + k * dx, y + k * dy)) continue;
            const size_t i = at(x + k * dx, y + k * dy);
            if (sights_[i].kind != Kind::kCad || s.normal.dot(sights_[i].normal) < kSameNormal) continue;
            const auto weight = static_cast<float>(kReach + 1 - std::abs(k));
            sum += weight * attributes_[i].defect;
            weights += weight;
          }
          smooth[at(x, y)] = sum / weights;
        }
      });
      for (size_t i = 0; i < smooth.size(); ++i)
        if (sights_[i].kind == Kind::kCad) attributes_[i].defect = smooth[i];
    }
  }

  /// Light that reaches a pixel past its surroundings in the depth picture. A flat surface keeps all.
  float ambient_light(int x, int y) const {
    const Sight& s = sights_[at(x, y)];
    if (s.kind == Kind::kEmpty) return 1;
    static constexpr std::array<std::array<float, 2>, 8> kDirections = {{{1, 0},
                                                                         {0.7071f, 0.7071f},
                                                                         {0, 1},
                                                                         {-0.7071f, 0.7071f},
                                                                         {-1, 0},
                                                                         {-0.7071f, -0.7071f},
                                                                         {0, -1},
                                                                         {0.7071f, -0.7071f}}};
    const float nx = s.normal.dot(camera_.right), ny = s.normal.dot(camera_.up),
                nz = s.normal.dot(camera_.towards);
    float blocked = 0;
    for (const auto& direction : kDirections) {
      float horizon = 0;
      for (const int step : {3, 7, 13, 22, 34}) {
        const int px = x + static_cast<int>(std::lround(step * direction[0]));
        const int py = y + static_cast<int>(std::lround(step * direction[1]));
        if (!inside(px, py)) break;
        const Sight& other = sights_[at(px, py)];
        if (other.kind == Kind::kEmpty) continue;
        const Eigen::Vector3f to((px - x) * camera_.mm_per_pixel, (y - py) * camera_.mm_per_pixel,
                                 s.depth - other.depth);
        const float distance = to.norm(), range = 40 * camera_.mm_per_pixel;
        const float above = (to.x() * nx + to.y() * ny + to.z() * nz) / distance;
        horizon = std::max(horizon, (above - 0.08f) / (1 + distance * distance / (range * range)));
      }
      blocked += horizon;
    }
    return 1 - 0.75f * std::min(blocked / kDirections.size(), 1.0f);
  }

  /// Whether b, seen (dx, dy) pixels to the right of and below a, continues the same surface.
  bool continues(const Sight& a, const Sight& b, float dx, float dy) const {
    if (a.kind != b.kind) return false;
    if (a.kind == Kind::kEmpty || a.kind == Kind::kDisc || a.kind == Kind::kCut) return true;
    if (a.normal.dot(b.normal) < kSameNormal) return false;
    const Eigen::Vector3f to = dx * camera_.mm_per_pixel * camera_.right -
                               dy * camera_.mm_per_pixel * camera_.up + (a.depth - b.depth) * camera_.towards;
    return std::abs(to.dot(a.normal)) < 1.5f * camera_.mm_per_pixel;
  }

  const Eigen::Vector3f& surface_colour(const Attributes& a, int x, int y) const {
    if (!std::isfinite(a.deviation))
      return (x + y) % kHatchPixels < kHatchPixels / 2 ? kUnseenColour : kUnseenLineColour;
    return colouring_ == Colouring::kCoverage ? kSeenColour : colours_(a.deviation);
  }

  Eigen::Vector3f shade(const Sight& s, const Attributes& a, int x, int y) const {
    if (s.kind == Kind::kCut) return kCutColour;
    const Eigen::Vector3f& colour = surface_colour(a, x, y);
    const float light = (0.62f + 0.42f * std::max(0.0f, s.normal.dot(light_))) * a.light;
    return (colour * std::min(light, 1.04f)).cwiseMin(1.0f);
  }

  /// How dark the line round a defect is here.
  float outline(int x, int y) const {
    const Sight& s = sights_[at(x, y)];
    if (colouring_ == Colouring::kCoverage || s.kind != Kind::kCad || x < 1 || y < 1 || x + 1 >= width_ ||
        y + 1 >= height_)
      return 0;
    const float here = attributes_[at(x, y)].defect;
    const auto slope = [&](int dx, int dy) {
      const size_t a = at(x - dx, y - dy), b = at(x + dx, y + dy);
      if (sights_[a].kind != s.kind || sights_[b].kind != s.kind) return 0.0f;
      return 0.5f * (attributes_[b].defect - attributes_[a].defect);
    };
    const float gradient = std::hypot(slope(1, 0), slope(0, 1));
    if (gradient < 1e-4f) return 0;
    return 0.8f * std::clamp(1.35f - std::abs(here - 0.5f) / gradient, 0.0f, 1.0f);
  }

  void paint(int x, int y, uint8_t* rgba) const {
    const Sight& s = sights_[at(x, y)];
    bool plain = true;
    for (int dy = -1; dy <= 1 && plain; ++dy)
      for (int dx = -1; dx <= 1 && plain; ++dx)
        if (inside(x + dx, y + dy))
          plain = continues(s, sights_[at(x + dx, y + dy)], static_cast<float>(dx), static_cast<float>(dy));
    if (plain) {
      if (s.kind == Kind::kEmpty) return;
      const float line = outline(x, y);
      store((1 - line) * shade(s, attributes_[at(x, y)], x, y) + line * kOutlineColour, 1, rgba);
      return;
    }
    // Surfaces meet here: look many times, and draw an edge where the pixel is divided.
    Eigen::Vector3f sum = Eigen::Vector3f::Zero();
    int hits = 0, same = 0;
    Sight first;
    for (int i = 0; i < kSamples * kSamples; ++i) {
      const float dx = (i % kSamples + 0.5f) / kSamples, dy = (i / kSamples + 0.5f) / kSamples;
      const Sight sample = sight(x + dx, y + dy);
      if (i == 0) first = sample;
      same += continues(first, sample, dx - 0.5f / kSamples, dy - 0.5f / kSamples);
      if (sample.kind == Kind::kEmpty) continue;
      sum += shade(sample, nearby_attributes(x, y, sample, dx - 0.5f, dy - 0.5f), x, y);
      ++hits;
    }
    if (hits == 0) return;
    const float share = static_cast<float>(same) / (kSamples * kSamples);
    const float line = 0.5f * 4 * share * (1 - share);
    store((1 - line) * sum / static_cast<float>(hits) + line * kOutlineColour,
          static_cast<float>(hits) / (kSamples * kSamples), rgba);
  }

  /// The attributes of the neighbouring pixel whose surface a sample belongs to.
  Attributes nearby_attributes(int x, int y, const Sight& sample, float dx, float dy) const {
    Attributes best;
    float best_score = -kInfinity;
    for (int j = -1; j <= 1; ++j)
      for (int i = -1; i <= 1; ++i) {
        if (!inside(x + i, y + j)) continue;
        const Sight& other = sights_[at(x + i, y + j)];
        if (other.kind == Kind::kEmpty) continue;
        float score =
            -std::hypot(dx - i, dy - j) - std::abs(other.depth - sample.depth) / camera_.mm_per_pixel;
        score += 20 * other.normal.dot(sample.normal) + (other.kind == sample.kind ? 40.0f : 0.0f);
        if (score <= best_score) continue;
        best_score = score;
        best = attributes_[at(x + i, y + j)];
      }
    return best;
  }

  static void store(const Eigen::Vector3f& colour, float alpha, uint8_t* rgba) {
    for (int k = 0; k < 3; ++k)
      rgba[k] = static_cast<uint8_t>(std::lround(std::clamp(colour[k], 0.0f, 1.0f) * 255));
    rgba[3] = static_cast<uint8_t>(std::lround(alpha * 255));
  }

  const RayScene& cad_;
  const MeasuredSurface& measured_;
  const ColourScale& colours_;
  const Camera& camera_;
  const Colouring colouring_;
  const int width_, height_;
  Eigen::Vector3f light_;
  std::vector<Sight> sights_;  // one for every pixel's centre
  std::vector<Attributes> attributes_;
  std::vector<float> disc_depth_;  // 2 x 2 for every pixel
  std::vector<int> disc_;
};

}  // namespace

bool Rendering::shows(const Camera& camera, const Surfel& surfel) const {
  if (surfel.normal.dot(camera.towards) < 0.1f) return false;
  const Eigen::Vector3f seen = camera.project(surfel.position);
  const int x = static_cast<int>(std::floor(seen.x())), y = static_cast<int>(std::floor(seen.y()));
  if (x < 0 || y < 0 || x >= image.width || y >= image.height || seen.z() <= 0) return false;
  const float slack = 0.3f + 3 * camera.mm_per_pixel;
  return seen.z() < depth_mm[static_cast<size_t>(y) * image.width + x] + slack;
}

Rendering render(const RayScene& cad, const MeasuredSurface& measured, const ColourScale& colours,
                 const Camera& camera, Colouring colouring) {
  return Renderer(cad, measured, colours, camera, colouring).draw();
}

}  // namespace gantry::report
