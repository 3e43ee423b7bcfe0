#include "gantry/inspection/report.h"

#include <gtest/gtest.h>
#include <png.h>
#include <tbb/global_control.h>

#include <cmath>
#include <cstring>
#include <fstream>
#include <limits>
#include <map>
#include <nlohmann/json.hpp>
#include <sstream>

#include "foundation/temporary_folder.h"
#include "gantry/foundation/error.h"
#include "gantry/geometry/point_cloud_file.h"
#include "geometry/solids.h"

namespace gantry {
namespace {

constexpr float kNaN = std::numeric_limits<float>::quiet_NaN();
constexpr const char* kTopView = "view-6";
constexpr const char* kViewFromBelow = "view-3";

/// A plate of 60 x 40 x 1 mm; its top lies in z = 0.
TriangleMesh plate() {
  return box_mesh({-30, -20, -1}, {30, 20, 0});
}

void add_point(InspectionResult& result, const Eigen::Vector3f& point, const Eigen::Vector3f& normal,
               float deviation, int defect = 0) {
  result.cloud.points.push_back(point + deviation * normal);
  result.cloud.normals.push_back(normal);
  result.deviation_mm.push_back(deviation);
  result.uncertainty_mm.push_back(0.01f);
  result.defect_id.push_back(defect);
  result.point_class.push_back(PointClass::kJudged);
}

void add_unjudged(InspectionResult& result, const Eigen::Vector3f& point, PointClass point_class) {
  add_point(result, point, Eigen::Vector3f::UnitZ(), 0);
  result.deviation_mm.back() = result.uncertainty_mm.back() = kNaN;
  result.point_class.back() = point_class;
}

Defect bump_defect() {
  Defect d;
  d.id = 1;
  d.centre_mm = d.peak_at_mm = {15, 5, 0.5};
  d.extent_mm = {12, 12, 0.5};
  d.area_mm2 = 113.1;
  d.peak_mm = 0.5;
  d.mean_mm = 0.4875;
  d.uncertainty_mm = 0.0421;
  d.normal = Eigen::Vector3d::UnitZ();
  d.points = 1810;
  d.certain = true;
  return d;
}

/// The plate's top seen but for x < -15, with a bump of 0.5 mm and radius 6 mm at (15, 5).
InspectionResult plate_with_bump() {
  InspectionResult result;
  for (float x = -15; x <= 30; x += 0.25f)
    for (float y = -20; y <= 20; y += 0.25f) {
      const bool bump = std::hypot(x - 15, y - 5) < 6;
      add_point(result, {x, y, 0}, Eigen::Vector3f::UnitZ(), bump ? 0.5f : 0.0f, bump);
    }
  add_unjudged(result, {0, 0, 300}, PointClass::kFar);
  add_unjudged(result, {0, 0, 3}, PointClass::kFixture);
  add_unjudged(result, {1, 0, 3}, PointClass::kFixture);
  result.verdict = Verdict::kFail;
  result.reason = "1 region is out of tolerance.";
  result.statistics = {result.cloud.size() - 3, 0.0125, 0.0753, 0.0764, -0.001, 0.5, 0.0, 0.001, 0.5, 0.9375};
  result.coverage = 0.7512;
  result.defects = {bump_defect()};
  result.alignment.cad_from_cloud = pose_from_position_rpy({1, 2, 3}, {0.1, 0.2, 0.3});
  result.alignment.covariance(3, 3) = 1e-6;
  result.alignment.rms_before_mm = 0.6;
  result.alignment.rms_after_mm = 0.02;
  result.alignment.inlier_fraction = 0.97;
  result.alignment.iterations = 12;
  result.alignment.converged = true;
  return result;
}

InspectionOptions options() {
  InspectionOptions o;
  o.tolerance_mm = 0.2;
  return o;
}

Traceability traceability() {
  return {
      "plate <b>&\"7'", "2026-05-04T10:20:30Z", true, {{"CAD model", "plate.stl"}, {"Cell <i>", "a & b"}}};
}

std::string read_text(const std::filesystem::path& path) {
  std::ifstream file(path, std::ios::binary);
  std::stringstream text;
  text << file.rdbuf();
  return text.str();
}

std::string html_of(const InspectionResult& result, const TriangleMesh& cad) {
  const TemporaryFolder folder;
  return read_text(write_report(folder.path(), result, SignedDistance(cad), options(), traceability()));
}

/// The page of plate_with_bump(), written once for all tests that only read it.
const std::string& bump_page() {
  static const std::string html = html_of(plate_with_bump(), plate());
  return html;
}

bool contains(const std::string& text, const std::string& part) {
  return text.find(part) != std::string::npos;
}

/// The page without the bytes of its pictures.
std::string without_pictures(std::string html) {
  const std::string start = "data:image/png;base64,";
  for (size_t at = 0; (at = html.find(start, at)) != std::string::npos; at += start.size())
    html.erase(at + start.size(), html.find('"', at) - at - start.size());
  return html;
}

/// The page without its scripts and their data.
std::string without_scripts(std::string html) {
  for (size_t at = 0; (at = html.find("<script", at)) != std::string::npos;)
    html.erase(at, html.find("</script>", at) + 9 - at);
  return html;
}

size_t count_of(const std::string& text, const std::string& part) {
  size_t count = 0;
  for (size_t at = 0; (at = text.find(part, at)) != std::string::npos; at += part.size()) ++count;
  return count;
}

/// A number as the page writes it.
std::string shown(const nlohmann::json& number, int decimals, bool with_sign = false) {
  char text[64];
  std::snprintf(text, sizeof text, with_sign ? "%+.*f" : "%.*f", decimals, number.get<double>());
  return text[0] == '-' ? "\u2212" + std::string(text + 1) : text;
}

/// The svg element with this id.
std::string svg_of(const std::string& html, const std::string& id) {
  const size_t begin = html.find("id=\"" + id + "\"");
  if (begin == std::string::npos) return "";
  return html.substr(begin, html.find("</svg>", begin) - begin);
}

std::string from_base64(const std::string& text) {
  std::string bytes;
  uint32_t bits = 0;
  int count = 0;
  for (const char c : text) {
    const std::string alphabet = "ABCDEFGHIJKLMNOPQRSTUVWXYZabcdefghijklmnopqrstuvwxyz0123456789+/";
    const size_t value = alphabet.find(c);
    if (value == std::string::npos) break;
    bits = bits << 6 | static_cast<uint32_t>(value);
    if ((count += 6) < 8) continue;
    count -= 8;
    bytes += static_cast<char>(bits >> count & 255);
  }
  return bytes;
}

struct Pixel {
  int r, g, b, a;

  bool red() const { return a == 255 && r > 1.6 * g && r > 1.6 * b; }
  bool green() const { return a == 255 && g > 1.3 * r && g > 1.3 * b; }
  bool blue() const { return a == 255 && b > 1.6 * r && b > 1.6 * g; }
  bool grey() const { return a == 255 && std::abs(r - g) < 16 && std::abs(g - b) < 16; }
  bool empty() const { return a == 0; }
};

std::ostream& operator<<(std::ostream& out, const Pixel& p) {
  return out << "rgba(" << p.r << ", " << p.g << ", " << p.b << ", " << p.a << ")";
}

/// A picture of the page, decoded.
class DecodedView {
 public:
  DecodedView(const std::string& html, const std::string& id) {
    const std::string svg = svg_of(html, id);
    const std::string start = "href=\"data:image/png;base64,";
    const size_t begin = svg.find(start) + start.size();
    const std::string bytes = from_base64(svg.substr(begin, svg.find('"', begin) - begin));
    png_image image{};
    image.version = PNG_IMAGE_VERSION;
    if (!png_image_begin_read_from_memory(&image, bytes.data(), bytes.size()))
      throw std::runtime_error(image.message);
    image.format = PNG_FORMAT_RGBA;
    rgba_.resize(PNG_IMAGE_SIZE(image));
    if (!png_image_finish_read(&image, nullptr, rgba_.data(), 0, nullptr))
      throw std::runtime_error(image.message);
    width_ = static_cast<int>(image.width);
    height_ = static_cast<int>(image.height);
    for (int row = 0; row < height_; ++row)
      for (int column = 0; column < width_; ++column)
        if (pixel(column, row).a > 127) extent_.extend(Eigen::Vector2i(column, row));
  }

  Pixel pixel(int column, int row) const {
    const uint8_t* p = &rgba_[4 * (static_cast<size_t>(row) * width_ + column)];
    return {p[0], p[1], p[2], p[3]};
  }
  /// The pixel at (x, y) of the plate, seen from above; the plate's corners give the scale.
  Pixel at_mm(float x, float y) const {
    const Eigen::Vector2f size = (extent_.sizes() + Eigen::Vector2i(1, 1)).cast<float>();
    return pixel(static_cast<int>(extent_.min().x() + (x + 30) / 60 * size.x()),
                 static_cast<int>(extent_.min().y() + (20 - y) / 40 * size.y()));
  }
  template <typename Predicate>
  int count(Predicate&& predicate) const {
    int n = 0;
    for (int row = 0; row < height_; ++row)
      for (int column = 0; column < width_; ++column) n += predicate(pixel(column, row));
    return n;
  }
  const Eigen::AlignedBox2i& extent() const { return extent_; }

 private:
  int width_, height_;
  std::vector<uint8_t> rgba_;
  Eigen::AlignedBox2i extent_;
};

TEST(InspectionReport, SaysHowTheCloudWasAligned) {
  InspectionResult result = plate_with_bump();
  result.alignment.datums = {{"A<b>", "plane, fixes 3 freedoms", 3, 100, 0.012, 0, 0}};
  result.alignment.masked_regions = 2;
  result.alignment.masked_fraction = 0.125;
  result.alignment.free_motions = {{Vector6d::Zero(), "turning about z"}};
  result.alignment.equivalents = {{Pose::Identity(), "turned by 180 degrees about x"}};
  const TemporaryFolder folder;
  const std::string html =
      read_text(write_report(folder.path(), result, SignedDistance(plate()), options(), traceability()));
  for (const char* words :
       {"datums, by precedence: A&lt;b&gt;", "Datum A&lt;b&gt;", "plane, fixes 3 freedoms", "2 regions",
        "12.5", "turning about z", "turned by 180 degrees about x"})
    EXPECT_NE(html.find(words), std::string::npos) << words;
  EXPECT_EQ(html.find("A<b>"), std::string::npos);
}

TEST(InspectionReport, JsonEqualsTheResult) {
  const InspectionResult result = plate_with_bump();
  const TemporaryFolder folder;
  const auto html = write_report(folder.path(), result, SignedDistance(plate()), options(), traceability());
  EXPECT_EQ(html, folder.path() / "report.html");
  const auto json = nlohmann::json::parse(read_text(folder.path() / "report.json"));

  EXPECT_EQ(json["verdict"], "FAIL");
  EXPECT_EQ(json["reason"], result.reason);
  EXPECT_EQ(json["title"], traceability().title);
  EXPECT_EQ(json["created"], "2026-05-04T10:20:30Z");
  EXPECT_EQ(json["simulated"], true);
  EXPECT_EQ(json["tolerance_mm"], 0.2);
  EXPECT_EQ(json["coverage"], result.coverage);
  const auto& s = json["statistics"];
  EXPECT_EQ(s["count"], result.statistics.count);
  EXPECT_EQ(s["mean_mm"], result.statistics.mean);
  EXPECT_EQ(s["sigma_mm"], result.statistics.sigma);
  EXPECT_EQ(s["rms_mm"], result.statistics.rms);
  EXPECT_EQ(s["min_mm"], result.statistics.min);
  EXPECT_EQ(s["max_mm"], result.statistics.max);
  EXPECT_EQ(s["p05_mm"], result.statistics.p05);
  EXPECT_EQ(s["p50_mm"], result.statistics.p50);
  EXPECT_EQ(s["p95_mm"], result.statistics.p95);
  EXPECT_EQ(s["within_tolerance"], result.statistics.within_tolerance);
  EXPECT_EQ(json["point_classes"]["judged"], result.cloud.size() - 3);
  EXPECT_EQ(json["point_classes"]["fixture"], 2);
  EXPECT_EQ(json["point_classes"]["far"], 1);

  const auto& a = json["alignment"];
  for (int r = 0; r < 4; ++r)
    for (int c = 0; c < 4; ++c)
      EXPECT_EQ(a["cad_from_cloud"][r][c], result.alignment.cad_from_cloud.matrix()(r, c));
  for (int r = 0; r < 6; ++r)
    for (int c = 0; c < 6; ++c) EXPECT_EQ(a["covariance"][r][c], result.alignment.covariance(r, c));
  EXPECT_EQ(a["rms_before_mm"], 0.6);
  EXPECT_EQ(a["rms_after_mm"], 0.02);
  EXPECT_EQ(a["inlier_fraction"], 0.97);
  EXPECT_EQ(a["iterations"], 12);
  EXPECT_EQ(a["converged"], true);

  ASSERT_EQ(json["defects"].size(), 1u);
  const auto& d = json["defects"][0];
  const Defect& expected = result.defects[0];
  EXPECT_EQ(d["id"], 1);
  for (int k = 0; k < 3; ++k) {
    EXPECT_EQ(d["centre_mm"][k], expected.centre_mm[k]);
    EXPECT_EQ(d["extent_mm"][k], expected.extent_mm[k]);
    EXPECT_EQ(d["peak_at_mm"][k], expected.peak_at_mm[k]);
    EXPECT_EQ(d["normal"][k], expected.normal[k]);
  }
  EXPECT_EQ(d["area_mm2"], expected.area_mm2);
  EXPECT_EQ(d["peak_mm"], expected.peak_mm);
  EXPECT_EQ(d["mean_mm"], expected.mean_mm);
  EXPECT_EQ(d["uncertainty_mm"], expected.uncertainty_mm);
  EXPECT_EQ(d["points"], expected.points);
  EXPECT_EQ(d["certain"], true);
  EXPECT_EQ(json["traceability"]["Cell <i>"], "a & b");
}

TEST(InspectionReport, DeviationsKeepTheOrderOfThePoints) {
  const InspectionResult result = plate_with_bump();
  const TemporaryFolder folder;
  write_report(folder.path(), result, SignedDistance(plate()), options(), traceability());

  const std::string ply = read_text(folder.path() / "deviations.ply");
  const size_t body = ply.find("end_header\n") + std::strlen("end_header\n");
  std::istringstream header(ply.substr(0, body));
  std::vector<std::string> names;
  bool of_vertex = false;
  for (std::string line; std::getline(header, line);) {
    std::istringstream words(line);
    std::string first, second, third;
    words >> first >> second >> third;
    if (first == "format") {
      EXPECT_EQ(second, "binary_little_endian");
    }
    if (first == "element") of_vertex = second == "vertex";
    if (first != "property" || !of_vertex) continue;
    EXPECT_EQ(second, "float") << third;
    names.push_back(third);
  }
  const std::vector<std::string> wanted = {"x", "y", "z", "deviation", "uncertainty", "defect"};
  for (size_t i = 0; i < result.cloud.size(); ++i) {
    std::map<std::string, float> row;
    for (size_t k = 0; k < names.size(); ++k)
      std::memcpy(&row[names[k]], &ply[body + 4 * (i * names.size() + k)], 4);
    for (const auto& name : wanted) ASSERT_TRUE(row.contains(name)) << name;
    ASSERT_EQ(Eigen::Vector3f(row["x"], row["y"], row["z"]), result.cloud.points[i]) << i;
    ASSERT_EQ(row["defect"], static_cast<float>(result.defect_id[i])) << i;
    if (result.point_class[i] == PointClass::kJudged) {
      ASSERT_EQ(row["deviation"], result.deviation_mm[i]) << i;
      ASSERT_EQ(row["uncertainty"], result.uncertainty_mm[i]) << i;
    } else {
      ASSERT_TRUE(std::isnan(row["deviation"]) && std::isnan(row["uncertainty"])) << i;
    }
  }
  EXPECT_EQ(read_point_cloud(folder.path() / "deviations.ply").size(), result.cloud.size());
}

TEST(InspectionReport, PageStandsAlone) {
  const std::string html = without_pictures(bump_page());
  for (const char* foreign : {"http:", "https:", "@import", "<link", "src=", "<iframe", "fetch(",
                              "XMLHttpRequest", "import(", "WebSocket", "sendBeacon"})
    EXPECT_FALSE(contains(html, foreign)) << foreign;
  const std::string reference = "href=\"";
  for (size_t at = 0; (at = html.find(reference, at)) != std::string::npos; ++at)
    EXPECT_TRUE(html[at + reference.size()] == '#' ||
                html.compare(at + reference.size(), 15, "data:image/png;") == 0)
        << html.substr(at, 60);
  for (size_t at = 0; (at = html.find("url(", at)) != std::string::npos; ++at) EXPECT_EQ(html[at + 4], '#');
}

TEST(InspectionReport, PageSaysWhatWasFound) {
  const std::string html = without_pictures(bump_page());
  EXPECT_TRUE(contains(html, ">FAIL<") || contains(html, "</svg>FAIL</div>"));
  EXPECT_TRUE(contains(html, "1 region is out of tolerance."));
  EXPECT_TRUE(contains(html, "SIMULATED"));
  EXPECT_TRUE(contains(html, "<tr id=\"defect-1\">"));
  EXPECT_TRUE(contains(html, "<b>+0.500</b> \u00b1 0.042"));
  EXPECT_TRUE(contains(html, "75.12\u202f%"));
  EXPECT_TRUE(contains(html, "93.75\u202f%"));
  EXPECT_TRUE(contains(html, "id=\"close-up-1\""));
  EXPECT_EQ(svg_of(html, "close-up-2"), "");
}

TEST(InspectionReport, RealMeasurementIsNotCalledSimulated) {
  const TemporaryFolder folder;
  Traceability real = traceability();
  real.simulated = false;
  write_report(folder.path(), plate_with_bump(), SignedDistance(plate()), options(), real);
  EXPECT_FALSE(contains(read_text(folder.path() / "report.html"), "SIMULATED"));
}

TEST(InspectionReport, TextIsEscaped) {
  InspectionResult result = plate_with_bump();
  result.reason = "a < b && \"c\" <img>";
  const std::string html = html_of(result, plate());
  EXPECT_TRUE(contains(html, "plate &lt;b&gt;&amp;&quot;7&#39;"));
  EXPECT_TRUE(contains(html, "Cell &lt;i&gt;"));
  EXPECT_TRUE(contains(html, "a &amp; b"));
  EXPECT_TRUE(contains(html, "a &lt; b &amp;&amp; &quot;c&quot; &lt;img&gt;"));
  EXPECT_FALSE(contains(html, "plate <b>"));
  EXPECT_FALSE(contains(html, "<img>"));
}

TEST(InspectionReport, TextCannotBecomeScript) {
  const std::string hostile = "</script><script>alert('x')</script><svg onload=\"alert(1)\"><!--";
  InspectionResult result = plate_with_bump();
  result.reason = hostile;
  Traceability t = traceability();
  t.title = t.created = hostile;
  t.entries = {{hostile, hostile}};
  const TemporaryFolder folder;
  write_report(folder.path(), result, SignedDistance(plate()), options(), t);
  const std::string html = read_text(folder.path() / "report.html");
  EXPECT_EQ(count_of(html, "<script"), count_of(bump_page(), "<script"));
  EXPECT_EQ(count_of(html, "</script"), count_of(bump_page(), "</script"));
  for (const char* part : {"<svg onload", "alert('x')", "<!--"}) EXPECT_FALSE(contains(html, part)) << part;
}

TEST(InspectionReport, PageAndJsonSayTheSame) {
  const TemporaryFolder folder;
  InspectionResult result = plate_with_bump();
  for (size_t i = 0; i < result.cloud.size(); ++i)
    result.deviation_mm[i] += 0.03f * std::sin(0.37f * static_cast<float>(i));
  write_report(folder.path(), result, SignedDistance(plate()), options(), traceability());
  const auto json = nlohmann::json::parse(read_text(folder.path() / "report.json"));
  const std::string html = without_scripts(without_pictures(read_text(folder.path() / "report.html")));
  const auto& s = json["statistics"];
  EXPECT_TRUE(contains(html, ">Mean</th><td class=\"n\">" + shown(s["mean_mm"], 3, true)));
  EXPECT_TRUE(contains(html, "\u03c3</th><td class=\"n\">" + shown(s["sigma_mm"], 3)));
  EXPECT_TRUE(contains(html, ">Root mean square</th><td class=\"n\">" + shown(s["rms_mm"], 3)));
  const auto& d = json["distribution"];
  const auto& w = d["weibull_of_magnitudes"];
  ASSERT_TRUE(d["magnitude_p95_mm"].is_number());
  EXPECT_TRUE(contains(html, shown(d["magnitude_p50_mm"], 3) + "\u202fmm&ensp;" +
                                 shown(d["magnitude_p95_mm"], 3) + "\u202fmm&ensp;" +
                                 shown(d["magnitude_p99_mm"], 3)));
  ASSERT_TRUE(w.is_object());
  EXPECT_TRUE(contains(html, shown(w["shape"], 3) + ",&ensp;" + shown(w["scale_mm"], 4) +
                                 "\u202fmm</td><td class=\"n\">" + shown(w["kolmogorov_smirnov"], 3)));
  EXPECT_TRUE(contains(html, shown(d["gaussian_of_bulk"]["mean_mm"], 3) + " \u00b1 " +
                                 shown(d["gaussian_of_bulk"]["sigma_mm"], 3)));
  ASSERT_EQ(json["sections"].size(), 3u);
  for (const auto& section : json["sections"]) {
    const std::string axis = section["axis"];
    EXPECT_TRUE(contains(
        html, section["name"].get<std::string>() + ": " + axis + " = " + shown(section["offset_mm"], 2)));
    if (section["count"] == 0) continue;
    EXPECT_TRUE(contains(html, "Measured: " + shown(section["min_mm"], 3, true) + "\u202fmm \u2026 " +
                                   shown(section["max_mm"], 3, true)));
  }
  ASSERT_EQ(json["coverage_by_side"].size(), 6u);
  EXPECT_TRUE(contains(html, "<th scope=\"row\">+z</th><td class=\"n\">2\u202f400</td>"));
  EXPECT_TRUE(contains(html, "not seen: <b>24.88\u202f%</b>"));
}

TEST(InspectionReport, CoverageMapAndItsSidesTellWhatWasSeen) {
  const TemporaryFolder folder;
  write_report(folder.path(), plate_with_bump(), SignedDistance(plate()), options(), traceability());
  const auto json = nlohmann::json::parse(read_text(folder.path() / "report.json"));
  for (const auto& side : json["coverage_by_side"]) {
    if (side["towards"] == "+z") {
      EXPECT_NEAR(side["area_mm2"].get<double>(), 2400, 0.01);
      EXPECT_NEAR(side["seen"].get<double>(), 46.0 / 60, 0.01);  // x from -15 less the radius of 1 mm
    } else if (side["towards"] == "-z") {
      EXPECT_EQ(side["seen"], 0.0);
    }
  }
  const DecodedView below(bump_page(), "coverage-3"), above(bump_page(), "coverage-1");
  const auto grey = [](const Pixel& p) { return p.grey(); };
  const auto seen = [](const Pixel& p) { return p.a == 255 && p.b > 1.3 * p.r; };
  EXPECT_GT(below.count(grey), 25000);
  EXPECT_LT(below.count(seen), 200);  // its edges, half of which belong to the top
  EXPECT_GT(above.count(grey), 8000);
  EXPECT_GT(above.count(seen), 25000);
}

TEST(InspectionReport, PageStaysSmallForALargeCloudAndAFineModel) {
  // A bowl of 180 000 triangles, seen at 160 000 places that deviate by noise: nothing is smooth.
  TriangleMesh cad;
  constexpr int kSide = 300;
  const auto height = [](float x, float y) { return 0.01f * (x * x + y * y); };
  for (int i = 0; i <= kSide; ++i)
    for (int j = 0; j <= kSide; ++j) {
      const float x = 60.0f * i / kSide - 30, y = 60.0f * j / kSide - 30;
      cad.vertices.emplace_back(x, y, height(x, y));
    }
  for (int i = 0; i < kSide; ++i)
    for (int j = 0; j < kSide; ++j) {
      const int a = i * (kSide + 1) + j, b = a + kSide + 1;
      cad.triangles.emplace_back(a, b, b + 1);
      cad.triangles.emplace_back(a, b + 1, a + 1);
    }
  InspectionResult result;
  uint32_t random = 1;
  for (int i = 0; i < 400; ++i)
    for (int j = 0; j < 400; ++j) {
      const float x = 60.0f * i / 400 - 30, y = 60.0f * j / 400 - 30;
      random = random * 1664525u + 1013904223u;
      add_point(result, {x, y, height(x, y)}, Eigen::Vector3f(-0.02f * x, -0.02f * y, 1).normalized(),
                0.4f * (static_cast<float>(random >> 8) / 16777216.0f - 0.5f));
    }
  result.statistics.count = result.cloud.size();
  const std::string html = html_of(result, cad);
  EXPECT_LT(html.size(), 15u << 20);
  const size_t begin = html.find('>', html.find("id=\"viewer-data\"")) + 1;
  const auto json = nlohmann::json::parse(html.substr(begin, html.find("</script>", begin) - begin));
  EXPECT_LE(json["surface"]["triangles"], 160000);
  EXPECT_GT(json["surface"]["triangles"], 80000);
}

TEST(InspectionReport, TopViewIsRedAtTheBumpGreenElsewhereGreyWhereUnseen) {
  const DecodedView view(bump_page(), kTopView);
  for (const float dx : {-3.0f, 0.0f, 3.0f})
    for (const float dy : {-3.0f, 0.0f, 3.0f})
      EXPECT_TRUE(view.at_mm(15 + dx, 5 + dy).red()) << dx << " " << dy << " " << view.at_mm(15 + dx, 5 + dy);
  for (const auto& [x, y] : {std::pair{0.f, 0.f}, {-12.f, 18.f}, {15.f, -10.f}, {28.f, 18.f}, {15.f, 15.f}})
    EXPECT_TRUE(view.at_mm(x, y).green()) << x << " " << y << " " << view.at_mm(x, y);
  for (const auto& [x, y] : {std::pair{-25.f, 0.f}, {-18.f, 15.f}, {-28.f, -18.f}})
    EXPECT_TRUE(view.at_mm(x, y).grey()) << x << " " << y << " " << view.at_mm(x, y);
  EXPECT_TRUE(view.pixel(0, 0).empty());
}

TEST(InspectionReport, DefectIsLabelledWhereItIsSeenOnly) {
  const std::string html = without_pictures(bump_page());
  EXPECT_TRUE(contains(svg_of(html, kTopView), "class=\"badge\""));
  EXPECT_TRUE(contains(svg_of(html, kTopView), ">1</text>"));
  EXPECT_FALSE(contains(svg_of(html, kViewFromBelow), "class=\"badge\""));
}

TEST(InspectionReport, FacesOfAThinWallDoNotMix) {
  InspectionResult result;
  for (float x = -30; x <= 30; x += 0.25f)
    for (float y = -20; y <= 20; y += 0.25f) {
      add_point(result, {x, y, 0}, Eigen::Vector3f::UnitZ(), 0.4f);
      add_point(result, {x, y, -0.2f}, -Eigen::Vector3f::UnitZ(), -0.4f);
    }
  const std::string html = html_of(result, box_mesh({-30, -20, -0.2f}, {30, 20, 0}));
  const auto red = [](const Pixel& p) { return p.red(); };
  const auto blue = [](const Pixel& p) { return p.blue(); };
  EXPECT_GT(DecodedView(html, kTopView).count(red), 100000);
  EXPECT_EQ(DecodedView(html, kTopView).count(blue), 0);
  EXPECT_GT(DecodedView(html, kViewFromBelow).count(blue), 50000);
  EXPECT_EQ(DecodedView(html, kViewFromBelow).count(red), 0);
}

TEST(InspectionReport, MaterialBeyondTheCadModelIsDrawn) {
  // Two plates in the CAD model; the part has material in the gap of 8 mm between them.
  const TriangleMesh cad = merged(box_mesh({-30, -20, -1}, {-4, 20, 0}), box_mesh({4, -20, -1}, {30, 20, 0}));
  InspectionResult open, filled;
  for (float x = -30; x <= 30; x += 0.25f)
    for (float y = -20; y <= 20; y += 0.25f) {
      const float beyond = std::max(4 - std::abs(x), 0.0f);
      if (beyond == 0) add_point(open, {x, y, 0}, Eigen::Vector3f::UnitZ(), 0);
      add_point(filled, {x, y, 0}, Eigen::Vector3f::UnitZ(), 0);
      filled.deviation_mm.back() = beyond;
    }
  const DecodedView without(html_of(open, cad), kTopView), with(html_of(filled, cad), kTopView);
  for (const float x : {-2.5f, 0.0f, 2.5f})
    for (const float y : {-15.0f, 0.0f, 15.0f}) {
      EXPECT_TRUE(without.at_mm(x, y).empty()) << without.at_mm(x, y);
      EXPECT_TRUE(with.at_mm(x, y).red()) << with.at_mm(x, y);
    }
}

TEST(InspectionReport, SinglePointsBesideTheEdgeAreNoMaterial) {
  InspectionResult result = plate_with_bump();
  for (const float y : {-15.0f, 0.0f, 15.0f}) add_point(result, {31.5f, y, 0}, Eigen::Vector3f::UnitZ(), 0);
  const DecodedView clean(bump_page(), kTopView), noisy(html_of(result, plate()), kTopView);
  EXPECT_EQ(clean.extent().max(), noisy.extent().max());
}

TEST(InspectionReport, CloseUpShowsTheFaceThatThePeakIsOn) {
  InspectionResult result = plate_with_bump();
  for (const double side : {1.0, -1.0}) {  // a region on both faces may be given the normal of the other one
    result.defects[0].normal = side * Eigen::Vector3d::UnitZ();
    const DecodedView view(html_of(result, plate()), "close-up-1");
    EXPECT_TRUE(view.pixel(240, 180).red()) << view.pixel(240, 180);
    EXPECT_TRUE(view.pixel(240, 320).green()) << view.pixel(240, 320);
  }
}

TEST(InspectionReport, CloudWithoutNormalsServes) {
  InspectionResult result = plate_with_bump();
  result.cloud.normals.clear();
  const DecodedView view(html_of(result, plate()), kTopView);
  EXPECT_TRUE(view.at_mm(15, 5).red()) << view.at_mm(15, 5);
  EXPECT_TRUE(view.at_mm(0, 0).green()) << view.at_mm(0, 0);
  EXPECT_TRUE(view.at_mm(-25, 0).grey()) << view.at_mm(-25, 0);
}

TEST(InspectionReport, PartWithoutDefects) {
  InspectionResult result = plate_with_bump();
  result.verdict = Verdict::kPass;
  result.defects.clear();
  result.defect_id.assign(result.cloud.size(), 0);
  const std::string html = without_pictures(html_of(result, plate()));
  EXPECT_TRUE(contains(html, "</svg>PASS</div>"));
  EXPECT_TRUE(contains(html, "No region of the judged surface is out of tolerance, nor in doubt."));
  EXPECT_FALSE(contains(html, "close-up-"));
}

TEST(InspectionReport, NothingJudged) {
  InspectionResult result;
  for (int i = 0; i < 50; ++i) add_unjudged(result, {static_cast<float>(i), 0, 500}, PointClass::kFar);
  result.reason = "No point lies near the part.";
  result.statistics.mean = result.statistics.sigma = result.statistics.min = kNaN;
  result.alignment.rms_after_mm = kNaN;
  const TemporaryFolder folder;
  write_report(folder.path(), result, SignedDistance(plate()), options(), traceability());

  const std::string html = without_scripts(without_pictures(read_text(folder.path() / "report.html")));
  EXPECT_TRUE(contains(html, "</svg>UNDECIDED</div>"));
  EXPECT_TRUE(contains(html, "No point was judged"));
  for (const char* number : {"nan", "NaN", "inf<", "-inf", ">inf"})
    EXPECT_FALSE(contains(html, number)) << number;
  const auto json = nlohmann::json::parse(read_text(folder.path() / "report.json"));
  EXPECT_TRUE(json["statistics"]["mean_mm"].is_null());
  EXPECT_EQ(json["statistics"]["count"], 0);
  EXPECT_EQ(json["point_classes"]["far"], 50);
  EXPECT_TRUE(json["distribution"]["weibull_of_magnitudes"].is_null());
  const DecodedView view(read_text(folder.path() / "report.html"), kTopView);
  EXPECT_TRUE(view.at_mm(0, 0).grey());
}

TEST(InspectionReport, SameBytesOnAnyNumberOfThreads) {
  const std::string& many = bump_page();
  const tbb::global_control one(tbb::global_control::max_allowed_parallelism, 1);
  EXPECT_EQ(many, html_of(plate_with_bump(), plate()));
}

TEST(InspectionReport, BadInputIsRefused) {
  const TemporaryFolder folder;
  const SignedDistance cad(plate());
  EXPECT_THROW(write_report(folder.path() / "missing", plate_with_bump(), cad, options(), traceability()),
               InputError);
  EXPECT_THROW(write_report(folder.path(), plate_with_bump(), cad, InspectionOptions{}, traceability()),
               InputError);
}

TEST(InspectionReport, TextThatIsNotUtf8DoesNotCostTheReport) {
  const TemporaryFolder folder;
  Traceability t = traceability();
  t.entries.emplace_back("CAD model",
                         "pl\xff"
                         "ate.stl");
  EXPECT_NO_THROW(write_report(folder.path(), plate_with_bump(), SignedDistance(plate()), options(), t));
  EXPECT_NO_THROW(nlohmann::json::parse(read_text(folder.path() / "report.json")));
}

}  // namespace
}  // namespace gantry
