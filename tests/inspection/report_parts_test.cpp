#include <gtest/gtest.h>

#include <array>
#include <cmath>
#include <cstring>
#include <nlohmann/json.hpp>
#include <numbers>
#include <numeric>
#include <random>

#include "geometry/solids.h"
#include "report/section_chart.h"
#include "report/sections.h"
#include "report/surface_model.h"
#include "report/viewer.h"
#include "report/weibull.h"

namespace gantry::report {
namespace {

constexpr double kPi = std::numbers::pi;

/// About the z axis; every triangle has vertices of its own, as in an STL file.
TriangleMesh torus(float major_mm, float minor_mm, int around, int across) {
  const auto at = [&](int i, int j) -> Eigen::Vector3f {
    const double a = 2 * kPi * i / around, b = 2 * kPi * j / across;
    const double r = major_mm + minor_mm * std::cos(b);
    return Eigen::Vector3d(r * std::cos(a), r * std::sin(a), minor_mm * std::sin(b)).cast<float>();
  };
  TriangleMesh mesh;
  const auto add = [&](const Eigen::Vector3f& a, const Eigen::Vector3f& b, const Eigen::Vector3f& c) {
    const int n = static_cast<int>(mesh.vertices.size());
    mesh.vertices.insert(mesh.vertices.end(), {a, b, c});
    mesh.triangles.emplace_back(n, n + 1, n + 2);
  };
  for (int i = 0; i < around; ++i)
    for (int j = 0; j < across; ++j) {
      const int k = (i + 1) % around, l = (j + 1) % across;
      add(at(i, j), at(k, j), at(k, l));
      add(at(i, j), at(k, l), at(i, l));
    }
  return mesh;
}

Section plane(int axis, float offset_mm) {
  Section section;
  section.axis = axis;
  section.offset_mm = offset_mm;
  return section;
}

double length(const SectionLine& line) {
  double sum = 0;
  for (size_t i = 1; i < line.points.size(); ++i) sum += (line.points[i] - line.points[i - 1]).norm();
  return sum;
}

double area(const SectionLine& line) {
  double twice = 0;
  for (size_t i = 1; i < line.points.size(); ++i)
    twice += line.points[i - 1].x() * line.points[i].y() - line.points[i].x() * line.points[i - 1].y();
  return std::abs(twice) / 2;
}

TEST(ReportSections, BoxGivesARectangle) {
  const TriangleMesh mesh = box_mesh({-3, -2, -1}, {5, 4, 9});
  const double sizes[] = {8, 6, 10};
  for (int axis = 0; axis < 3; ++axis) {
    const auto lines = outline(mesh, plane(axis, 0.5f));
    ASSERT_EQ(lines.size(), 1u);
    EXPECT_TRUE(lines[0].closed);
    const double a = sizes[(axis + 1) % 3], b = sizes[(axis + 2) % 3];
    EXPECT_NEAR(length(lines[0]), 2 * (a + b), 1e-5);
    EXPECT_NEAR(area(lines[0]), a * b, 1e-4);
  }
  EXPECT_TRUE(outline(mesh, plane(0, 6)).empty());
}

TEST(ReportSections, TorusGivesTwoCircles) {
  const TriangleMesh mesh = torus(20, 5, 200, 101);
  // z = 0 runs exactly through a row of vertices; x = 0 through two tubes.
  for (const auto& [section, radii] : {std::pair{plane(2, 0), std::array{15.0, 25.0}},
                                       {plane(0, 0), std::array{5.0, 5.0}},
                                       {plane(2, 3), std::array{16.0, 24.0}}}) {
    auto lines = outline(mesh, section);
    ASSERT_EQ(lines.size(), 2u);
    std::sort(lines.begin(), lines.end(), [](const auto& a, const auto& b) { return length(a) < length(b); });
    for (int i = 0; i < 2; ++i) {
      EXPECT_TRUE(lines[i].closed);
      EXPECT_NEAR(length(lines[i]) / (2 * kPi * radii[i]), 1, 2e-3);
      EXPECT_NEAR(area(lines[i]) / (kPi * radii[i] * radii[i]), 1, 3e-3);
    }
  }
}

TEST(ReportSections, OpenMeshGivesOneOpenLine) {
  TriangleMesh mesh;  // a strip of three squares along x, listed out of order and in no plane of symmetry
  for (int i = 0; i < 4; ++i)
    for (int j = 0; j < 2; ++j) mesh.vertices.emplace_back(i, 2 * j, 0.1f * i);
  for (const int i : {1, 0, 2}) {
    mesh.triangles.emplace_back(2 * i, 2 * i + 2, 2 * i + 3);
    mesh.triangles.emplace_back(2 * i, 2 * i + 3, 2 * i + 1);
  }
  const auto lines = outline(mesh, plane(1, 0.7f));
  ASSERT_EQ(lines.size(), 1u);
  EXPECT_FALSE(lines[0].closed);
  EXPECT_NEAR(length(lines[0]), 3 * std::hypot(1, 0.1), 1e-5);
}

/// The top of a plate of 60 x 40 x 1 mm seen but for x < -15, higher by 0.5 mm within 6 mm of (15, 5).
MeasuredSurface bump() {
  MeasuredSurface measured;
  for (float x = -15; x <= 30; x += 0.25f)
    for (float y = -20; y <= 20; y += 0.25f) {
      const bool high = std::hypot(x - 15, y - 5) < 6;
      measured.on_cad.push_back({{x, y, 0}, {0, 0, 1}, high ? 0.5f : 0.0f, 0.01f, high});
    }
  measured.reach_mm = 0.625f;
  measured.disc_mm = 0.5f;
  return measured;
}

Defect bump_defect() {
  Defect d;
  d.id = 1;
  d.centre_mm = d.peak_at_mm = {15, 5, 0.5};
  d.extent_mm = {12, 12, 0.5};
  d.peak_mm = 0.5;
  d.normal = {0, 0, 1};
  return d;
}

const TriangleMesh kPlate = box_mesh({-30, -20, -1}, {30, 20, 0});

TEST(ReportSections, GoThroughTheDefectAndTellWhatWasMeasured) {
  const auto cuts = sections(kPlate, bump(), {bump_defect()});
  ASSERT_EQ(cuts.size(), 3u);
  EXPECT_EQ(cuts[0].through, 1);
  EXPECT_FLOAT_EQ(cuts[0].offset_mm, 15);
  EXPECT_EQ(cuts[1].through, 0);
  EXPECT_FLOAT_EQ(cuts[1].offset_mm, 0);
  const SectionStatistics s = section_statistics(cuts[0]);
  EXPECT_GT(s.count, 150u);
  EXPECT_EQ(s.min, 0.0);
  EXPECT_EQ(s.max, 0.5);
  for (const auto& m : cuts[0].measured)
    EXPECT_EQ(m.deviation_mm, std::abs(m.nominal.x() - 5) < 5.99f ? 0.5f : 0.0f) << m.nominal.x();
  // The cut along the plate shows none of its top.
  EXPECT_EQ(section_statistics(cuts[2]).count, 0u);
}

TEST(ReportSections, ExaggerationIsRoundAndKeepsThePartRecognisable) {
  for (const auto& cut : sections(kPlate, bump(), {bump_defect()})) {
    const double times = exaggeration(cut, 0.2);
    const double mantissa = times / std::pow(10, std::floor(std::log10(times) + 1e-9));
    EXPECT_TRUE(mantissa == 1 || mantissa == 2 || mantissa == 5) << times;
    EXPECT_LE(times * 0.2, 0.1 * 60);
  }
}

TEST(Weibull, FindsTheParametersOfKnownSamples) {
  std::mt19937_64 random(5);
  for (const double shape : {0.5, 1.0, 1.7, 3.6, 12.0})
    for (const double scale : {0.002, 0.3, 40.0}) {
      std::vector<float> sample(20000);
      for (float& v : sample) {
        const double u = (static_cast<double>(random() >> 11) + 0.5) * 0x1p-53;
        v = static_cast<float>(scale * std::pow(-std::log(u), 1 / shape));
      }
      const auto fit = fit_weibull(sample);
      ASSERT_TRUE(fit);
      // Four standard errors of the maximum likelihood estimates: 0.78 k / sqrt(n) and 1.05 scale / (k
      // sqrt(n)).
      EXPECT_NEAR(fit->shape / shape, 1, 4 * 0.78 / std::sqrt(2e4));
      EXPECT_NEAR(fit->scale_mm / scale, 1, 4 * 1.053 / shape / std::sqrt(2e4));
    }
}

TEST(Weibull, SolvesTheLikelihoodEquations) {
  const std::vector<float> sample = {0.2f, 0.5f, 0.9f, 1.1f, 1.6f, 2.2f, 2.3f, 3.1f, 4.7f, 8.0f};
  const auto fit = fit_weibull(sample);
  ASSERT_TRUE(fit);
  const auto log_likelihood = [&](double shape, double scale) {
    double sum = 0;
    for (const float v : sample) sum += std::log(Weibull{shape, scale}.density(v));
    return sum;
  };
  const double best = log_likelihood(fit->shape, fit->scale_mm);
  for (const double factor : {0.97, 1.03}) {
    EXPECT_GT(best, log_likelihood(factor * fit->shape, fit->scale_mm));
    EXPECT_GT(best, log_likelihood(fit->shape, factor * fit->scale_mm));
  }
}

TEST(Weibull, DensityIsTheSlopeOfTheProbability) {
  const Weibull w{1.4, 0.3};
  for (const double x : {0.01, 0.1, 0.5, 1.0})
    EXPECT_NEAR((w.probability(x + 1e-6) - w.probability(x - 1e-6)) / 2e-6, w.density(x), 1e-6);
  EXPECT_EQ(w.probability(0), 0);
}

TEST(Weibull, NothingFromTooLittle) {
  EXPECT_FALSE(fit_weibull({}));
  EXPECT_FALSE(fit_weibull(std::vector<float>(100, 0.0f)));
  EXPECT_FALSE(fit_weibull(std::vector<float>(100, 0.3f)));
  EXPECT_FALSE(fit_weibull(std::vector<float>{1, 2, 3}));
}

double area(const SurfaceModel& model) {
  double sum = 0;
  for (const auto& t : model.triangles) {
    const auto& v = model.vertices;
    sum += 0.5 * (v[t[1]].position - v[t[0]].position).cross(v[t[2]].position - v[t[0]].position).norm();
  }
  return sum;
}

TEST(SurfaceModel, ShowsTheDeviationsAndWhatWasNotSeen) {
  const SurfaceModel model = surface_model(kPlate, bump(), 0.2, 20000);
  EXPECT_LE(model.triangles.size(), 20000u);
  EXPECT_NEAR(area(model), kPlate.surface_area(), 0.1);
  EXPECT_EQ(model.creases.size(), 12u);
  int high = 0, unseen = 0;
  for (const auto& v : model.vertices) {
    const float from_bump = std::hypot(v.position.x() - 15, v.position.y() - 5);
    const bool top = v.normal.z() > 0.9f;
    if (top && from_bump < 5.3f) {
      ++high;
      EXPECT_NEAR(v.deviation_mm, 0.5f, 1e-5f);
      EXPECT_NEAR(v.uncertainty_mm, 0.01f, 1e-6f);
      EXPECT_EQ(v.defect, 1);
    } else if (top && v.position.x() < -15.7f) {
      ++unseen;
      EXPECT_FALSE(v.seen);
    } else if (top && v.position.x() > -14.9f && from_bump > 6.7f) {
      EXPECT_TRUE(v.seen);
      EXPECT_EQ(v.deviation_mm, 0);
    } else if (!top) {
      EXPECT_FALSE(v.seen) << v.position.transpose();
    }
  }
  EXPECT_GT(high, 20);
  EXPECT_GT(unseen, 20);
}

TEST(SurfaceModel, IsFineWhereTheDeviationChanges) {
  const SurfaceModel model = surface_model(kPlate, bump(), 0.2, 20000);
  double at_rim = 0, below = 0;  // mean lengths of edges
  int rim_count = 0, below_count = 0;
  for (const auto& t : model.triangles) {
    const auto &a = model.vertices[t[0]], &b = model.vertices[t[1]];
    const float edge = (a.position - b.position).norm();
    if (a.normal.z() > 0.9f && std::abs(std::hypot(a.position.x() - 15, a.position.y() - 5) - 6) < 0.3f) {
      at_rim += edge;
      ++rim_count;
    } else if (a.normal.z() < -0.9f) {
      below += edge;
      ++below_count;
    }
  }
  ASSERT_GT(rim_count, 100);
  ASSERT_GT(below_count, 100);
  EXPECT_LT(at_rim / rim_count, 0.4 * below / below_count);
}

TEST(SurfaceModel, AFineModelIsMadeCoarserWithinItsShape) {
  const TriangleMesh mesh = torus(20, 5, 400, 150);  // 120 000 triangles
  MeasuredSurface nothing;
  nothing.reach_mm = 0.5f;
  const SurfaceModel model = surface_model(mesh, nothing, 0.2, 10000);
  EXPECT_LE(model.triangles.size(), 10000u);
  EXPECT_NEAR(area(model) / mesh.surface_area(), 1, 0.02);
  for (const auto& v : model.vertices)
    EXPECT_NEAR(std::hypot(std::hypot(v.position.x(), v.position.y()) - 20, v.position.z()), 5,
                0.25);  // the rise of chords of 3 mm over a radius of 5 mm
}

std::string from_base64(const std::string& text) {
  const std::string alphabet = "ABCDEFGHIJKLMNOPQRSTUVWXYZabcdefghijklmnopqrstuvwxyz0123456789+/";
  std::string bytes;
  uint32_t bits = 0;
  int count = 0;
  for (const char c : text) {
    if (c == '=') break;
    bits = bits << 6 | static_cast<uint32_t>(alphabet.find(c));
    if ((count += 6) < 8) continue;
    count -= 8;
    bytes += static_cast<char>(bits >> count & 255);
  }
  return bytes;
}

template <typename Number>
std::vector<Number> numbers(const nlohmann::json& base64) {
  const std::string bytes = from_base64(base64);
  std::vector<Number> values(bytes.size() / sizeof(Number));
  std::memcpy(values.data(), bytes.data(), bytes.size());
  return values;
}

TEST(ViewerData, HoldsTheModel) {
  MeasuredSurface measured = bump();
  measured.off_cad.push_back({{0, 0, 4}, {0, 0, 1}, 4.0f, 0.02f, 1});
  const SurfaceModel model = surface_model(kPlate, measured, 0.2, 20000);
  const auto cuts = sections(kPlate, measured, {bump_defect()});
  const auto json =
      nlohmann::json::parse(viewer_data(model, measured, ColourScale(0.2), {bump_defect()}, cuts));
  const auto& surface = json["surface"];
  const auto positions = numbers<uint16_t>(surface["positions"]);
  const auto deviations = numbers<int16_t>(surface["deviations"]);
  const auto shares = numbers<uint8_t>(surface["shares"]);
  ASSERT_EQ(surface["vertices"], model.vertices.size());
  ASSERT_EQ(positions.size(), 3 * model.vertices.size());
  ASSERT_EQ(deviations.size(), model.vertices.size());
  ASSERT_EQ(shares.size(), model.vertices.size());
  const double step = json["deviation_step_mm"];
  for (size_t i = 0; i < model.vertices.size(); ++i) {
    const auto& v = model.vertices[i];
    for (int k = 0; k < 3; ++k)
      ASSERT_NEAR(
          json["low"][k].get<double>() + positions[3 * i + k] / 65535.0 * json["size"][k].get<double>(),
          v.position[k], 1e-3);
    ASSERT_NEAR(deviations[i] * step, v.deviation_mm, step);
    ASSERT_EQ(shares[i] != 255, v.seen);
  }
  // The corners, as the script reads them.
  const std::string bytes = from_base64(surface["corners"]);
  size_t at = 0;
  int previous = 0;
  for (const auto& t : model.triangles)
    for (const int corner : t) {
      uint32_t value = 0;
      for (int shift = 0;; shift += 7) {
        ASSERT_LT(at, bytes.size());
        const auto byte = static_cast<uint8_t>(bytes[at++]);
        value |= static_cast<uint32_t>(byte & 127) << shift;
        if (byte < 128) break;
      }
      previous += static_cast<int>(value >> 1) ^ -static_cast<int>(value & 1);
      ASSERT_EQ(previous, corner);
    }
  EXPECT_EQ(at, bytes.size());
  EXPECT_EQ(json["discs"]["count"], 1);
  EXPECT_NEAR(numbers<int16_t>(json["discs"]["deviations"])[0] * step, 4.0, step);
  EXPECT_EQ(json["sections"].size(), 3u);
  ASSERT_EQ(json["defects"].size(), 1u);
  EXPECT_EQ(json["defects"][0]["at"][0], 15.0);
}

}  // namespace
}  // namespace gantry::report
