// STEP files are written by OpenCASCADE itself, read back, and compared with the shape's equation. Where the
// build has no OpenCASCADE, all but the refusal is skipped.

#include <gtest/gtest.h>

#include "foundation/expect_input_error.h"
#include "foundation/temporary_folder.h"
#include "gantry/geometry/mesh_file.h"
#include "gantry/geometry/mesh_topology.h"
#include "gantry/geometry/signed_distance.h"

#ifdef GANTRY_HAS_OPENCASCADE
#include <BRepPrimAPI_MakeBox.hxx>
#include <BRepPrimAPI_MakeCylinder.hxx>
#include <Interface_Static.hxx>
#include <STEPControl_Controller.hxx>
#include <STEPControl_Writer.hxx>
#include <TopoDS_Shape.hxx>
#endif

namespace gantry {
namespace {

constexpr const char* kWithout = "this build has no OpenCASCADE";

TEST(StepFile, ABuildWithoutOpenCascadeSaysWhatToInstall) {
  if (reads_step()) GTEST_SKIP() << "this build reads STEP";
  const TemporaryFolder folder;
  for (const char* name : {"part.step", "part.STP"}) {
    const auto path = folder.write(name, "ISO-10303-21;\nHEADER;\n");
    EXPECT_TRUE(holds_triangles(path));
    expect_input_error([&] { read_mesh(path); },
                       {path.string(), "reads no STEP", "libocct-data-exchange-dev"});
  }
  EXPECT_NE(step_support().find("install libocct-data-exchange-dev"), std::string::npos);
}

TEST(StepFile, StatesItsOwnUnit) {
  const TemporaryFolder folder;
  const auto path = folder.write("part.step", "ISO-10303-21;\n");
  expect_input_error([&] { read_mesh(path, 1000); }, {path.string(), "its own unit"});
}

TEST(StepFile, BrokenFilesAreRefused) {
  if (!reads_step()) GTEST_SKIP() << kWithout;
  const TemporaryFolder folder;
  const std::string header = "ISO-10303-21;\nHEADER;\nFILE_SCHEMA(('CONFIG_CONTROL_DESIGN'));\nENDSEC;\n";
  for (const std::string& text :
       {std::string("no STEP"), header, header + "DATA;\n#1=CARTESIAN_POINT('',(0.,0.,NAN));\nENDSEC;\n",
        header + "DATA;\n#1=#1;\nENDSEC;\nEND-ISO-10303-21;\n", std::string(1000, '(')}) {
    const auto path = folder.write("broken.step", text);
    expect_input_error([&] { read_mesh(path); }, {path.string()});
  }
}

#ifdef GANTRY_HAS_OPENCASCADE
#ifdef __SANITIZE_ADDRESS__
/// OpenCASCADE's writer, which only this test uses, leaves memory behind.
extern "C" const char* __lsan_default_suppressions() {
  return "leak:libTK\n";
}
#endif

void write_step(const std::filesystem::path& path, const TopoDS_Shape& shape, const char* unit) {
  STEPControl_Controller::Init();  // makes the settings known; a writer reads them when it is made
  Interface_Static::SetCVal("write.step.unit", unit);
  STEPControl_Writer writer;
  ASSERT_EQ(writer.Transfer(shape, STEPControl_AsIs), IFSelect_RetDone);
  ASSERT_EQ(writer.Write(path.c_str()), IFSelect_RetDone);
}

TEST(StepFile, ABoxIsExactInWhateverUnit) {
  const TemporaryFolder folder;
  for (const char* unit : {"MM", "M", "INCH"}) {
    write_step(folder / "box.step", BRepPrimAPI_MakeBox(30, 20, 10).Shape(), unit);
    MeshReading reading;
    const TriangleMesh mesh = read_mesh(folder / "box.step", 1, &reading);
    EXPECT_TRUE(analyse_topology(mesh).watertight()) << unit;
    EXPECT_NEAR(mesh.volume(), 6000, 0.01) << unit;
    EXPECT_LT((mesh.bounds().sizes() - Eigen::Vector3f(30, 20, 10)).norm(), 1e-4f) << unit;
    EXPECT_NE(reading.tessellation.find("0.005 mm"), std::string::npos) << reading.tessellation;
  }
}

TEST(StepFile, ACylinderLiesWithinTheChord) {
  const TemporaryFolder folder;
  const double radius = 12, height = 30;
  write_step(folder / "cylinder.stp", BRepPrimAPI_MakeCylinder(radius, height).Shape(), "MM");
  for (const double chord_mm : {0.1, 0.01, 0.002}) {
    const TriangleMesh mesh =
        read_mesh(folder / "cylinder.stp", 1, nullptr, {.chord_mm = chord_mm, .angle_rad = 1.5});
    EXPECT_TRUE(analyse_topology(mesh).watertight());
    EXPECT_GT(mesh.volume(), 0);
    const SignedDistance distance(mesh);
    for (int i = 0; i < 1000; ++i) {
      const double angle = 0.00628 * i, z = 1 + 0.028 * i;
      const Eigen::Vector3f on((radius + 0.5) * std::cos(angle), (radius + 0.5) * std::sin(angle), z);
      const double found = distance(on, 10)->distance;
      EXPECT_GE(found, 0.5 - 1e-4);
      EXPECT_LE(found, 0.5 + chord_mm + 1e-4);
    }
  }
}

TEST(StepFile, TruncatedFilesAreRefusedOrReadButNeverCrash) {
  const TemporaryFolder folder;
  write_step(folder / "whole.step", BRepPrimAPI_MakeCylinder(12, 30).Shape(), "MM");
  const std::string bytes = TemporaryFolder::read(folder / "whole.step");
  for (int part = 0; part < 10; ++part) {
    const auto path = folder.write("cut.step", bytes.substr(0, bytes.size() * part / 10));
    expect_input_error([&] { read_mesh(path); }, {path.string()});
  }
}
#endif

TEST(StepFile, TessellationOptionsAreChecked) {
  if (!reads_step()) GTEST_SKIP() << kWithout;
  const TemporaryFolder folder;
  const auto path = folder.write("part.step", "ISO-10303-21;\n");
  expect_input_error([&] { read_mesh(path, 1, nullptr, {.chord_mm = 0}); }, {"chord"});
  expect_input_error([&] { read_mesh(path, 1, nullptr, {.chord_mm = 0.01, .angle_rad = 4}); }, {"angle"});
}

}  // namespace
}  // namespace gantry
