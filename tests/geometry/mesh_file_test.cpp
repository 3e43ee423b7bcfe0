#include "gantry/geometry/mesh_file.h"

#include <gtest/gtest.h>
#include <unistd.h>

#include <cstring>
#include <limits>

#include "foundation/expect_input_error.h"
#include "foundation/temporary_folder.h"
#include "gantry/geometry/mesh_topology.h"
#include "geometry/solids.h"

namespace gantry {
namespace {

/// A binary STL written by hand: 80 bytes, count, then 50 bytes a triangle.
std::string binary_stl(const TriangleMesh& mesh) {
  std::string bytes(80, ' ');
  const auto append = [&](const void* data, size_t size) {
    bytes.append(static_cast<const char*>(data), size);
  };
  const auto count = static_cast<uint32_t>(mesh.triangles.size());
  append(&count, 4);
  for (size_t t = 0; t < count; ++t) {
    const Eigen::Vector3f n = mesh.normal(t);
    append(n.data(), 12);
    for (int k = 0; k < 3; ++k) append(mesh.vertices[mesh.triangles[t][k]].data(), 12);
    bytes.append(2, '\0');
  }
  return bytes;
}

void expect_same_surface(const TriangleMesh& read, const TriangleMesh& written) {
  ASSERT_EQ(read.vertices.size(), written.vertices.size());
  ASSERT_EQ(read.triangles.size(), written.triangles.size());
  for (size_t t = 0; t < read.triangles.size(); ++t)
    for (int k = 0; k < 3; ++k)
      ASSERT_EQ(read.vertices[read.triangles[t][k]], written.vertices[written.triangles[t][k]]);
}

class MeshFile : public ::testing::Test {
 protected:
  TemporaryFolder folder_;
  TriangleMesh star_ =
      transformed(star_mesh(15, 40), pose_from_position_rpy({100.1, -7.3, 1e-3}, {0.1, 0.2, 0.3}));
};

TEST_F(MeshFile, RoundTripIsExactAndJoinsVertices) {
  for (const char* name : {"star.stl", "star.ply"}) {
    SCOPED_TRACE(name);
    write_mesh(folder_ / name, star_);
    const TriangleMesh read = read_mesh(folder_ / name);
    expect_same_surface(read, star_);
    EXPECT_TRUE(analyse_topology(read).watertight());
    EXPECT_FALSE(std::filesystem::exists(folder_ / (std::string(name) + ".partial")));
  }
}

TEST_F(MeshFile, ReadsAStlThatAnotherProgramWrote) {
  expect_same_surface(read_mesh(folder_.write("hand.stl", binary_stl(star_))), star_);
  // The other way round: what is written has the layout of the format.
  write_mesh(folder_ / "ours.stl", star_);
  const std::string bytes = TemporaryFolder::read(folder_ / "ours.stl");
  ASSERT_EQ(bytes.size(), 84 + 50 * star_.triangles.size());
  EXPECT_NE(bytes.substr(0, 5), "solid") << "readers would take it for ascii";
  for (size_t t = 0; t < star_.triangles.size(); ++t)
    for (int k = 0; k < 3; ++k) {
      Eigen::Vector3f v;
      std::memcpy(v.data(), bytes.data() + 84 + 50 * t + 12 * (k + 1), 12);
      ASSERT_EQ(v, star_.vertices[star_.triangles[t][k]]);
    }
}

TEST_F(MeshFile, ReadsAsciiStlAndObj) {
  const auto stl = folder_.write("a.stl",
                                 "solid a\nfacet normal 0 0 1\nouter loop\nvertex 0 0 0\nvertex 1.5 0 0\n"
                                 "vertex 0 2.5 0\nendloop\nendfacet\nendsolid a\n");
  const auto obj = folder_.write("a.obj", "v 0 0 0\nv 1.5 0 0\nv 0 2.5 0\nf 1 2 3\n");
  for (const auto& path : {stl, obj}) {
    const TriangleMesh mesh = read_mesh(path);
    ASSERT_EQ(mesh.triangles.size(), 1u) << path;
    EXPECT_NEAR(mesh.area(0), 0.5 * 1.5 * 2.5, 1e-6);
    EXPECT_GT(mesh.normal(0).z(), 0.99f);
  }
}

/// As programs of all kinds write it: two solids, keywords in capitals, lines of Windows, a normal that is
/// none.
const std::string kAsciiStl =
    "solid the part, facet by facet\n"
    "facet normal 0 0 1\n outer loop\n  vertex 0 0 0\n  vertex +1.5 0 0\n  vertex 0 25e-1 0\n "
    "endloop\nendfacet\n"
    "endsolid the part, facet by facet\n"
    "SOLID\r\nFACET NORMAL -nan(ind) 0 0\r\nOUTER LOOP\r\nVERTEX 0 0 0\r\nVERTEX 0 2.5 0\r\nVERTEX 0 0 4\r\n"
    "ENDLOOP\r\nENDFACET\r\nENDSOLID";

TEST_F(MeshFile, ReadsAsciiStlOfAllKinds) {
  const TriangleMesh mesh = read_mesh(folder_.write("a.stl", kAsciiStl));
  ASSERT_EQ(mesh.triangles.size(), 2u);
  EXPECT_EQ(mesh.vertices.size(), 4u);
  EXPECT_EQ(mesh.bounds().max(), Eigen::Vector3f(1.5f, 2.5f, 4));
  EXPECT_NEAR(mesh.surface_area(), 0.5 * (1.5 * 2.5 + 2.5 * 4), 1e-6);
}

TEST_F(MeshFile, ABinaryStlMayBeginLikeText) {
  std::string bytes = binary_stl(star_);
  bytes.replace(0, 5, "solid");
  expect_same_surface(read_mesh(folder_.write("solid.stl", bytes)), star_);
}

TEST_F(MeshFile, MistakesInAsciiStlAreNamedWithTheirLine) {
  const auto refused = [&](const std::string& from, const std::string& to, const std::string& complaint) {
    std::string text = kAsciiStl;
    text.replace(text.find(from), from.size(), to);
    const auto path = folder_.write("bad.stl", text);
    expect_input_error([&] { read_mesh(path); }, {path.string() + ":", complaint});
  };
  refused("+1.5", "1,5", ":5: expected a number, found '1,5'");
  refused(" endloop", "vertex 1 1 1 endloop", ":7: expected 'endloop', found 'vertex'");
  refused("  vertex 0 0 0\n", "", ":6: expected 'vertex', found 'endloop'");
  refused("endfacet\nendsolid", "endfacet\nendfacet", ":9: expected 'facet' or 'endsolid', found 'endfacet'");
  refused("facet by facet\nSOLID", "\nbye", ":10: expected 'solid', found 'bye'");
  // Wherever it is cut: at the border of a facet too, where the rest would pass for a whole part.
  for (size_t size = 5; size < kAsciiStl.find("SOLID"); ++size) {
    if (size >= kAsciiStl.find("endsolid") + 8) continue;  // all but the name is there
    const auto path = folder_.write("cut.stl", kAsciiStl.substr(0, size));
    expect_input_error([&] { read_mesh(path); }, {path.string()});
  }
}

TEST_F(MeshFile, ReadsAsciiPlyWithPolygons) {
  const std::string head =
      "ply\nformat ascii 1.0\nelement vertex 4\nproperty float x\nproperty float y\nproperty float z\n"
      "element face 1\nproperty list uchar int vertex_indices\nend_header\n0 0 0\n2 0 0\n2 3 0\n0 3 0\n";
  const TriangleMesh mesh = read_mesh(folder_.write("quad.ply", head + "4 0 1 2 3\n"));
  ASSERT_EQ(mesh.triangles.size(), 2u);
  EXPECT_NEAR(mesh.surface_area(), 6, 1e-6);
  EXPECT_GT(mesh.normal(0).z(), 0.99f);
  const auto outside = folder_.write("outside.ply", head + "4 0 1 2 4\n");
  expect_input_error([&] { read_mesh(outside); }, {outside.string(), "does not exist"});
}

TEST_F(MeshFile, UnitScalesToMillimetres) {
  write_mesh(folder_ / "m.stl", box_mesh({0, 0, 0}, {0.25f, 0.5f, 1}));
  EXPECT_EQ(read_mesh(folder_ / "m.stl", 1000).bounds().max(), Eigen::Vector3f(250, 500, 1000));
}

TEST_F(MeshFile, BrokenFilesAreNamed) {
  const auto refused = [&](const std::filesystem::path& path) {
    expect_input_error([&] { read_mesh(path); }, {path.string()});
  };
  refused(folder_ / "absent.stl");
  std::filesystem::create_directory(folder_ / "directory.stl");
  refused(folder_ / "directory.stl");
  for (const char* extension : {"stl", "ply", "obj"}) {
    SCOPED_TRACE(extension);
    refused(folder_.write(std::string("empty.") + extension, ""));
    refused(folder_.write(std::string("text.") + extension, "Dear reader, this is no mesh at all.\n"));
  }
  refused(folder_.write("no_triangles.obj", "v 0 0 0\nv 1 0 0\nv 0 1 0\n"));
  refused(folder_.write("mesh.unknown", "solid"));
  const std::string triangle = "v 0 0 0\nv 1 0 0\nv 0 1 0\nf 1 2 3\n";
  EXPECT_EQ(read_mesh(folder_.write("CAPITALS.OBJ", triangle)).triangles.size(), 1u);
  refused(folder_.write("mesh.3ds", triangle));
  refused(folder_.write("collapsed.stl", binary_stl({{{1, 1, 1}, {1, 1, 1}, {1, 1, 1}}, {{0, 1, 2}}})));
}

TEST_F(MeshFile, CoordinatesThatAreNotFiniteAreRefused) {
  for (const float bad : {std::numeric_limits<float>::quiet_NaN(), std::numeric_limits<float>::infinity()}) {
    TriangleMesh mesh = star_;
    mesh.vertices[5].y() = bad;
    const auto path = folder_.write("nan.stl", binary_stl(mesh));
    expect_input_error([&] { read_mesh(path); }, {path.string(), "finite"});
  }
}

TEST_F(MeshFile, TruncatedFilesAreRefusedAndNeverCrash) {
  write_mesh(folder_ / "whole.stl", star_);
  write_mesh(folder_ / "whole.ply", star_);
  for (const char* extension : {"stl", "ply"}) {
    const std::string bytes = TemporaryFolder::read(folder_ / (std::string("whole.") + extension));
    for (int part = 0; part < 20; ++part) {
      SCOPED_TRACE(std::string(extension) + " cut to " + std::to_string(part) + "/20");
      const auto path =
          folder_.write(std::string("cut.") + extension, bytes.substr(0, bytes.size() * part / 20));
      expect_input_error([&] { read_mesh(path); }, {path.string()});
    }
  }
}

TEST_F(MeshFile, WhatIsNoMeshAtAllIsSaidPlainly) {
  for (const char* extension : {"stl", "ply", "obj"}) {
    SCOPED_TRACE(extension);
    const std::string name = std::string("part.") + extension;
    for (const char* page :
         {"<!DOCTYPE html>\n<html><body>Sign in</body></html>", "\xef\xbb\xbf \n<HTML lang=en>"})
      expect_input_error([&] { read_mesh(folder_.write(name, page)); }, {name, "web page"});
    expect_input_error([&] { read_mesh(folder_.write(name, "")); }, {name, "empty"});
  }
}

TEST_F(MeshFile, AFileThatMayNotBeReadIsNamed) {
  write_mesh(folder_ / "mine.stl", star_);
  std::filesystem::permissions(folder_.path(), std::filesystem::perms::all);
  std::filesystem::permissions(folder_ / "mine.stl", std::filesystem::perms::none);
  const uid_t self = ::geteuid();
  if (self == 0) {
    ASSERT_EQ(::seteuid(65534), 0);  // root may read everything
  }
  expect_input_error([&] { read_mesh(folder_ / "mine.stl"); }, {"mine.stl", "Permission denied"});
  expect_input_error([&] { holds_triangles(folder_ / "mine.stl"); }, {"mine.stl", "Permission denied"});
  if (self == 0) {
    ASSERT_EQ(::seteuid(0), 0);
  }
}

TEST_F(MeshFile, DegenerateTrianglesAreLeftOutAndCounted) {
  TriangleMesh mesh = star_;
  const Eigen::Vector3f a = mesh.vertices[0], b = mesh.vertices[1];
  mesh.vertices.insert(mesh.vertices.end(), {a, a, b});
  const int n = static_cast<int>(mesh.vertices.size());
  mesh.triangles.emplace_back(n - 3, n - 2, n - 1);
  MeshReading reading;
  EXPECT_EQ(read_mesh(folder_.write("a.stl", binary_stl(mesh)), 1, &reading).triangles.size(),
            star_.triangles.size());
  EXPECT_EQ(reading.collapsed_triangles, 1u);
  read_mesh(folder_.write("a.stl", binary_stl(star_)), 1, &reading);
  EXPECT_EQ(reading.collapsed_triangles, 0u);
  // Three corners on a line stay, and are counted by the topology.
  mesh = star_;
  mesh.vertices.push_back((a + b) / 2);
  mesh.triangles.emplace_back(0, 1, n - 3);
  const TriangleMesh read = read_mesh(folder_.write("a.stl", binary_stl(mesh)), 1, &reading);
  EXPECT_EQ(reading.collapsed_triangles, 0u);
  EXPECT_GE(analyse_topology(read).nonmanifold_edges, 1u);
}

TEST_F(MeshFile, WhatCannotBeWrittenIsNamed) {
  expect_input_error([&] { write_mesh(folder_ / "a.obj", star_); }, {(folder_ / "a.obj").string(), ".stl"});
  expect_input_error([&] { write_mesh(folder_ / "no/such/folder.stl", star_); }, {"no/such/folder.stl"});
  std::filesystem::create_directory(folder_ / "directory.stl");
  expect_input_error([&] { write_mesh(folder_ / "directory.stl", star_); }, {"directory.stl"});
}

}  // namespace
}  // namespace gantry
