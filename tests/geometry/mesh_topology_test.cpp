#include "gantry/geometry/mesh_topology.h"

#include <gtest/gtest.h>

#include "geometry/solids.h"

namespace gantry {
namespace {

const TriangleMesh kCube = box_mesh({0, 0, 0}, {10, 10, 10});

TEST(MeshTopology, ClosedSolidsAreWatertight) {
  for (const TriangleMesh& mesh :
       {kCube, star_mesh(10, 30), wedge_mesh(10, 50, 0.1f), uneven_needle_mesh(5, 60, 20)}) {
    EXPECT_TRUE(analyse_topology(mesh).watertight());
    EXPECT_EQ(analyse_topology(mesh).text(), "watertight");
  }
}

TEST(MeshTopology, AMissingTriangleLeavesThreeBoundaryEdges) {
  TriangleMesh mesh = kCube;
  mesh.triangles.pop_back();
  const MeshTopology topology = analyse_topology(mesh);
  EXPECT_EQ(topology.boundary_edges, 3u);
  EXPECT_EQ(topology.nonmanifold_edges, 0u);
  EXPECT_EQ(topology.inconsistent_edges, 0u);
  EXPECT_FALSE(topology.watertight());
  EXPECT_EQ(topology.text(), "not watertight: 3 boundary edges");
}

TEST(MeshTopology, AFlippedTriangleMakesItsThreeEdgesInconsistent) {
  TriangleMesh mesh = kCube;
  std::swap(mesh.triangles[5][0], mesh.triangles[5][1]);
  const MeshTopology topology = analyse_topology(mesh);
  EXPECT_EQ(topology.inconsistent_edges, 3u);
  EXPECT_EQ(topology.boundary_edges, 0u);
  EXPECT_FALSE(topology.watertight());
}

TEST(MeshTopology, AFinOnAnEdgeIsNotManifold) {
  TriangleMesh mesh = kCube;
  mesh.vertices.emplace_back(20, 0, 0);
  mesh.triangles.emplace_back(0, 1, 8);
  const MeshTopology topology = analyse_topology(mesh);
  EXPECT_EQ(topology.nonmanifold_edges, 1u);
  EXPECT_EQ(topology.boundary_edges, 2u);
  EXPECT_FALSE(topology.watertight());
}

TEST(MeshTopology, DegenerateTrianglesAreCounted) {
  TriangleMesh mesh = kCube;
  mesh.vertices[1] = mesh.vertices[0];
  EXPECT_GT(analyse_topology(mesh).degenerate_triangles, 0u);
  EXPECT_EQ(analyse_topology(kCube).degenerate_triangles, 0u);
}

TEST(MeshTopology, VerticesAreJoinedByPosition) {
  EXPECT_TRUE(analyse_topology(split_vertices(kCube)).watertight());
}

}  // namespace
}  // namespace gantry
