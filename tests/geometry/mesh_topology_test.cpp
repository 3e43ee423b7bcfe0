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

TriangleMesh turned_over(TriangleMesh mesh) {
  for (auto& t : mesh.triangles) std::swap(t[1], t[2]);
  return mesh;
}

TEST(MeshTopology, AMeshThatIsInsideOutIsFound) {
  for (const TriangleMesh& mesh :
       {kCube, star_mesh(10, 30), wedge_mesh(10, 50, 0.1f), split_vertices(kCube)}) {
    EXPECT_EQ(analyse_topology(mesh).inside_out_shells, 0u);
    EXPECT_EQ(analyse_topology(turned_over(mesh)).inside_out_shells, 1u);
    EXPECT_EQ(analyse_topology(turned_over(mesh)).shells, 1u);
    EXPECT_TRUE(analyse_topology(turned_over(mesh)).watertight());
  }
  // Wherever it stands.
  const Pose far = pose_from_position_rpy({-5000, 3000, 100}, {1, 2, 3});
  EXPECT_EQ(analyse_topology(transformed(turned_over(kCube), far)).inside_out_shells, 1u);
  EXPECT_EQ(analyse_topology(transformed(kCube, far)).inside_out_shells, 0u);
}

TEST(MeshTopology, WithHolesItIsFoundWhereTheSideIsCertain) {
  TriangleMesh star = turned_over(star_mesh(10, 30));
  star.triangles.pop_back();
  EXPECT_EQ(analyse_topology(star).inside_out_shells, 1u);
  // A lone sheet has no side: neither it nor its reverse is called wrong.
  TriangleMesh sheet = kCube;
  sheet.triangles.resize(2);
  EXPECT_EQ(analyse_topology(sheet).inside_out_shells, 0u);
  EXPECT_EQ(analyse_topology(turned_over(sheet)).inside_out_shells, 0u);
  // Nor has a mesh whose faces contradict each other.
  TriangleMesh mixed = turned_over(kCube);
  std::swap(mixed.triangles[5][0], mixed.triangles[5][1]);
  EXPECT_EQ(analyse_topology(mixed).inside_out_shells, 0u);
}

TEST(MeshTopology, ACavityIsNoMistake) {
  const TriangleMesh hollow = merged(kCube, turned_over(box_mesh({3, 3, 3}, {7, 7, 7})));
  EXPECT_EQ(analyse_topology(hollow).shells, 2u);
  EXPECT_EQ(analyse_topology(hollow).inside_out_shells, 0u);
  EXPECT_EQ(analyse_topology(merged(kCube, turned_over(box_mesh({30, 3, 3}, {70, 7, 7})))).inside_out_shells,
            1u);
  EXPECT_EQ(analyse_topology(turned_over(hollow)).inside_out_shells, 1u);
}

TEST(MeshTopology, VerticesAreJoinedByPosition) {
  EXPECT_TRUE(analyse_topology(split_vertices(kCube)).watertight());
}

}  // namespace
}  // namespace gantry
