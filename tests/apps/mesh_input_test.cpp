// What an engineer is told about a reference mesh that is broken, open, inside out or in another unit: an
// exit code of 2 with one clear line, or a warning and a result that says so. A wrong unit never ends in a
// verdict.

#include <gtest/gtest.h>

#include <cstring>
#include <limits>
#include <nlohmann/json.hpp>

#include "apps/process.h"
#include "apps/test_cell.h"
#include "gantry/geometry/mesh_file.h"
#include "gantry/geometry/point_cloud_file.h"
#include "gantry/geometry/surface_samples.h"
#include "geometry/solids.h"

namespace gantry::testing {
namespace {

class MeshInput : public ::testing::Test {
 protected:
  MeshInput() {
    write_mesh(folder_ / "box.stl", box_);
    write_point_cloud(folder_ / "cloud.ply", sample_surface(box_, 10'000, 3));
  }

  ProcessResult inspect(const std::string& reference, const std::vector<std::string>& more = {},
                        const std::string& cloud = "cloud.ply") {
    std::vector<std::string> arguments = {
        "inspect", "--cloud", folder_ / cloud, "--reference", folder_ / reference, "--tolerance",
        "0.2",     "--align", "none",          "--out",       folder_ / "out"};
    arguments.insert(arguments.end(), more.begin(), more.end());
    return run_program("gantry-fusion", arguments);
  }
  void expect_refused(const ProcessResult& result, const std::vector<std::string>& fragments) {
    EXPECT_EQ(result.exit_code, 2) << result.out << result.err;
    for (const std::string& fragment : fragments)
      EXPECT_NE(result.err.find(fragment), std::string::npos) << "no '" << fragment << "' in " << result.err;
    EXPECT_EQ(result.out, "");
    EXPECT_FALSE(std::filesystem::exists(folder_ / "out"));
  }
  void expect_pass(const ProcessResult& result, const std::vector<std::string>& told = {}) {
    EXPECT_EQ(result.exit_code, 0) << result.out << result.err;
    for (const std::string& fragment : told)
      EXPECT_NE((result.out + result.err).find(fragment), std::string::npos)
          << "no '" << fragment << "' in " << result.out << result.err;
  }
  std::string scaled(const std::string& name, float factor) {
    TriangleMesh mesh = box_;
    for (auto& v : mesh.vertices) v *= factor;
    write_mesh(folder_ / name, mesh);
    return name;
  }
  nlohmann::json report() { return nlohmann::json::parse(read_text(folder_ / "out/report.json")); }

  TemporaryFolder folder_;
  TriangleMesh box_ = box_mesh({0, 0, 0}, {30, 20, 10});
};

TEST_F(MeshInput, BrokenFiles) {
  std::string bytes = read_text(folder_ / "box.stl");
  const auto broken = [&](const std::string& name, const std::string& content,
                          const std::vector<std::string>& fragments) {
    write_text(folder_ / name, content);
    expect_refused(inspect(name), fragments);
  };
  broken("half.stl", bytes.substr(0, bytes.size() / 2), {"half.stl"});
  broken("empty.stl", "", {"empty.stl", "empty"});
  broken("page.stl", "<!DOCTYPE html>\n<html></html>", {"page.stl", "web page"});
  for (const float bad : {std::numeric_limits<float>::quiet_NaN(), std::numeric_limits<float>::infinity()}) {
    std::string with_bad = bytes;
    std::memcpy(with_bad.data() + 84 + 12, &bad, sizeof bad);
    broken("bad.stl", with_bad, {"bad.stl", "not a finite number"});
  }
  broken("points.obj", "v 0 0 0\nv 1 0 0\nv 0 1 0\n", {"points.obj"});
  std::filesystem::create_directory(folder_ / "folder.stl");
  expect_refused(inspect("folder.stl"), {"folder.stl", "a file is expected"});
  expect_refused(inspect("none.stl"), {"none.stl", "no such file"});
  broken("part.iges", "x", {"part.iges", ".step"});
  if (!reads_step()) broken("part.step", "ISO-10303-21;", {"part.step", "install libocct-data-exchange-dev"});
}

TEST_F(MeshInput, InsideOut) {
  for (auto& t : box_.triangles) std::swap(t[1], t[2]);
  write_mesh(folder_ / "inside_out.stl", box_);
  expect_refused(inspect("inside_out.stl"), {"inside_out.stl", "inside out", "flip its normals"});
  const ProcessResult compared =
      run_program("gantry-fusion", {"compare", folder_ / "cloud.ply", folder_ / "inside_out.stl"});
  EXPECT_EQ(compared.exit_code, 2) << compared.out;
  EXPECT_NE(compared.err.find("inside out"), std::string::npos);
}

TEST_F(MeshInput, OneFlippedFaceIsReported) {
  std::swap(box_.triangles[5][0], box_.triangles[5][1]);
  write_mesh(folder_ / "flipped.stl", box_);
  const ProcessResult result = inspect("flipped.stl");
  EXPECT_NE(result.exit_code, 2) << result.err;
  EXPECT_NE(result.out.find("12 triangles, not watertight: 3 edges with a flipped neighbour"),
            std::string::npos)
      << result.out;
  EXPECT_NE(result.err.find("flipped"), std::string::npos);
  EXPECT_EQ(report()["reference"]["inconsistent_edges"], 3);
}

TEST_F(MeshInput, AnOpenMeshIsReportedWithThePointsBesideItsBorder) {
  expect_pass(inspect("box.stl"), {"reference  12 triangles, watertight"});
  EXPECT_EQ(report()["reference"]["watertight"], true);
  EXPECT_EQ(report()["reference"]["points_beside_border"], 0);
  EXPECT_NE(read_text(folder_ / "out/report.html").find("12 triangles, watertight"), std::string::npos);

  box_.triangles.resize(10);  // the face at x = 30 is missing
  write_mesh(folder_ / "open.stl", box_);
  const ProcessResult result = inspect("open.stl");
  EXPECT_NE(result.out.find("10 triangles, not watertight: 4 boundary edges"), std::string::npos)
      << result.out;
  EXPECT_NE(result.out.find("points lie beside its border and were not judged"), std::string::npos)
      << result.out;
  const nlohmann::json reference = report()["reference"];
  EXPECT_EQ(reference["boundary_edges"], 4);
  // Of the missing face, which has 200 of 2200 mm2, all whose nearest surface is the border.
  EXPECT_NEAR(reference["points_beside_border"].get<double>(), 10'000 * 200 / 2200., 100);
  EXPECT_NE(read_text(folder_ / "out/report.html").find("points lie beside its border"), std::string::npos);

  const ProcessResult compared =
      run_program("gantry-fusion", {"compare", folder_ / "cloud.ply", folder_ / "open.stl", "--metric",
                                    "cloud-to-mesh", "--json", folder_ / "compared.json"});
  EXPECT_EQ(compared.exit_code, 0) << compared.err;
  EXPECT_NE(compared.out.find("4 boundary edges"), std::string::npos) << compared.out;
  EXPECT_NE(compared.out.find("lie beside the border"), std::string::npos) << compared.out;
  const nlohmann::json json = nlohmann::json::parse(read_text(folder_ / "compared.json"));
  EXPECT_EQ(json["reference"]["mesh"]["watertight"], false);
  EXPECT_EQ(json["reference"]["mesh"]["triangles"], 10);
  EXPECT_GT(json["metrics"][0]["points_beside_border"], 750);
}

TEST_F(MeshInput, DegenerateTrianglesAreWarnedOf) {
  box_.vertices.push_back(box_.vertices[0]);
  box_.triangles.emplace_back(0, 8, 1);
  write_mesh(folder_ / "degenerate.stl", box_);
  expect_pass(inspect("degenerate.stl"),
              {"1 degenerate triangles were left out", "12 triangles, watertight"});
}

TEST_F(MeshInput, AWrongUnitIsNoVerdict) {
  expect_refused(inspect(scaled("metres.stl", 1e-3f)),
                 {"metres.stl is 0.03 x 0.02 x 0.01 mm", "--reference-unit m"});
  expect_refused(inspect(scaled("inch.stl", 1 / 25.4f)), {"25.4 times", "--reference-unit inch"});
  expect_refused(inspect(scaled("large.stl", 8)), {"8 times as large", "--any-size"});
  expect_pass(inspect("inch.stl", {"--reference-unit", "inch"}));
}

TEST_F(MeshInput, SizesMayDifferWhereThePersonSaysSo) {
  const ProcessResult result = inspect(scaled("large.stl", 8), {"--any-size"});
  EXPECT_NE(result.exit_code, 2) << result.err;
  EXPECT_NE(result.err.find("8 times as large"), std::string::npos) << result.err;
}

TEST_F(MeshInput, ACloudInAnotherUnitIsNoVerdict) {
  PointCloud cloud = read_point_cloud(folder_ / "cloud.ply");
  for (auto& p : cloud.points) p /= 1000;
  write_point_cloud(folder_ / "metres.ply", cloud);
  expect_refused(inspect("box.stl", {}, "metres.ply"), {"metres.ply", "1e+03 times", "--unit m"});
  expect_pass(inspect("box.stl", {"--unit", "m"}, "metres.ply"));
}

TEST_F(MeshInput, AFixtureInAnotherUnitIsQuestioned) {
  const ProcessResult result = inspect("box.stl", {"--fixture", folder_ / scaled("fixture.stl", 1e-3f)});
  EXPECT_NE(result.err.find("fixture.stl is 0.03 x 0.02 x 0.01 mm"), std::string::npos) << result.err;
}

TEST_F(MeshInput, CompareQuestionsSizesAndGoesOn) {
  const ProcessResult result = run_program(
      "gantry-fusion",
      {"compare", folder_ / "cloud.ply", folder_ / scaled("metres.stl", 1e-3f), "--metric", "cloud-to-mesh"});
  EXPECT_EQ(result.exit_code, 0) << result.err;
  EXPECT_NE(result.err.find("--reference-unit m"), std::string::npos) << result.err;
}

TEST_F(MeshInput, TheCellRefusesAReferenceInAnotherUnitBeforeItMoves) {
  write_text(folder_ / "cell.yaml", simulated_cell_text());
  write_text(folder_ / "plan.yaml", kThreeViews);
  TriangleMesh bracket = read_mesh(kExamples / "parts/bracket.stl");
  for (auto& v : bracket.vertices) v *= 1e-3f;
  write_mesh(folder_ / "bracket.stl", bracket);
  expect_refused(
      run_program("gantry-cell", {"run", "--cell", folder_ / "cell.yaml", "--plan", folder_ / "plan.yaml",
                                  "--reference", folder_ / "bracket.stl", "--out", folder_ / "out"}),
      {"bracket.stl is 0.1", "metres", "--reference-unit m", "tolerance"});
}

TEST_F(MeshInput, TheVersionTellsOfStep) {
  const ProcessResult result = run_program("gantry-fusion", {"--version"});
  EXPECT_EQ(result.exit_code, 0);
  EXPECT_EQ(result.out.rfind("gantry ", 0), 0u);
  EXPECT_NE(result.out.find(reads_step() ? "read by OpenCASCADE" : "install libocct-data-exchange-dev"),
            std::string::npos)
      << result.out;
}

}  // namespace
}  // namespace gantry::testing
