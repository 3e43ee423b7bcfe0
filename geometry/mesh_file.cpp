#include "gantry/geometry/mesh_file.h"

#include <assimp/postprocess.h>
#include <assimp/scene.h>

#include <algorithm>
#include <assimp/Exporter.hpp>
#include <assimp/Importer.hpp>
#include <cctype>
#include <fstream>

#include "ascii_stl.h"
#include "file_guard.h"
#include "gantry/foundation/error.h"
#include "joined_vertices.h"
#include "point_table.h"
#include "step_file.h"

namespace gantry {
namespace {

/// Joins vertices at exactly the same position (STL repeats every vertex for every triangle) and drops
/// the triangles that have two corners at one place.
TriangleMesh joined(const TriangleMesh& soup, size_t& collapsed) {
  const std::vector<int> first = internal::joined_by_position(soup.vertices);
  TriangleMesh mesh;
  std::vector<int> renamed(soup.vertices.size(), -1);
  for (size_t i = 0; i < soup.vertices.size(); ++i) {
    if (first[i] != static_cast<int>(i)) continue;
    renamed[i] = static_cast<int>(mesh.vertices.size());
    mesh.vertices.push_back(soup.vertices[i]);
  }
  for (const auto& t : soup.triangles) {
    const Eigen::Vector3i n(renamed[first[t[0]]], renamed[first[t[1]]], renamed[first[t[2]]]);
    if (n[0] != n[1] && n[1] != n[2] && n[2] != n[0]) {
      mesh.triangles.push_back(n);
    } else {
      ++collapsed;
    }
  }
  return mesh;
}

/// All meshes of the file one after the other, in the file's unit.
TriangleMesh read_by_assimp(const std::filesystem::path& path) {
  const std::string name = path.string();
  Assimp::Importer importer;
  const aiScene* scene = nullptr;
  try {
    scene = importer.ReadFile(name, aiProcess_Triangulate);
  } catch (const std::exception& e) {
    throw InputError(name + ": not a readable mesh: " + e.what());
  }
  if (!scene) throw InputError(name + ": not a readable mesh: " + importer.GetErrorString());
  TriangleMesh soup;
  for (unsigned m = 0; m < scene->mNumMeshes; ++m) {
    const aiMesh& part = *scene->mMeshes[m];
    const int offset = static_cast<int>(soup.vertices.size());
    for (unsigned i = 0; i < part.mNumVertices; ++i)
      soup.vertices.emplace_back(part.mVertices[i].x, part.mVertices[i].y, part.mVertices[i].z);
    for (unsigned f = 0; f < part.mNumFaces; ++f) {
      const aiFace& face = part.mFaces[f];
      if (face.mNumIndices != 3) continue;  // points and lines that some exporters add
      const Eigen::Vector3i tri(face.mIndices[0], face.mIndices[1], face.mIndices[2]);
      soup.triangles.push_back(tri + Eigen::Vector3i::Constant(offset));
    }
  }
  return soup;
}

TriangleMesh read_ply_mesh(const std::filesystem::path& path) {
  internal::PointTable table = internal::read_points(path);
  const std::vector<double>&x = table.columns.at("x"), &y = table.columns.at("y"), &z = table.columns.at("z");
  TriangleMesh mesh;
  for (size_t i = 0; i < x.size(); ++i)
    mesh.vertices.push_back(Eigen::Vector3d(x[i], y[i], z[i]).cast<float>());
  mesh.triangles = std::move(table.triangles);
  return mesh;
}

bool is_step(const std::string& extension) {
  return extension == ".step" || extension == ".stp";
}

/// What people end up with instead of a mesh, said plainly rather than by the parser that trips over it.
void refuse_other_content(const std::filesystem::path& path) {
  std::string head(256, '\0');
  std::ifstream file(path, std::ios::binary);
  file.read(head.data(), static_cast<std::streamsize>(head.size()));
  head.resize(static_cast<size_t>(file.gcount()));
  if (head.empty()) throw InputError(path.string() + ": the file is empty");
  for (char& c : head) c = static_cast<char>(std::tolower(static_cast<unsigned char>(c)));
  const size_t begin = std::min(head.find_first_not_of(" \t\r\n\xef\xbb\xbf"), head.size());
  for (const char* start : {"<!doctype html", "<html"})
    if (head.compare(begin, std::string_view(start).size(), start) == 0)
      throw InputError(path.string() + ": is a web page, not a mesh: download the file itself");
}

}  // namespace

TriangleMesh read_mesh(const std::filesystem::path& path, double unit_mm, MeshReading* reading,
                       const TessellationOptions& tessellation) {
  const std::string name = path.string();
  internal::require_file(path);
  const std::string extension = internal::lower_extension(path);
  // Assimp knows dozens of formats; none but these has been tried on broken files.
  if (extension != ".stl" && extension != ".obj" && extension != ".ply" && !is_step(extension))
    throw InputError(name + ": meshes are read from .stl, .ply, .obj or .step, not '" + extension + "'");
  if (is_step(extension) && unit_mm != 1)
    throw InputError(name + ": a STEP file states its own unit: give none for it");
  refuse_other_content(path);
  MeshReading ignored;
  MeshReading& info = reading ? *reading : ignored;
  info = {};
  TriangleMesh soup = is_step(extension)    ? internal::read_step(path, tessellation, info.tessellation)
                      : extension == ".ply" ? read_ply_mesh(path)
                      : extension == ".stl" && internal::is_ascii_stl(path) ? internal::read_ascii_stl(path)
                                                                            : read_by_assimp(path);
  for (size_t i = 0; i < soup.vertices.size(); ++i) {
    Eigen::Vector3f& v = soup.vertices[i];
    v = (v.cast<double>() * unit_mm).cast<float>();
    if (!v.allFinite())
      throw InputError(name + ": vertex " + std::to_string(i) +
                       " has a coordinate that is not a finite number");
  }
  for (size_t t = 0; t < soup.triangles.size(); ++t) {
    const Eigen::Vector3i& tri = soup.triangles[t];
    if (tri.minCoeff() < 0 || tri.maxCoeff() >= static_cast<int>(soup.vertices.size()))
      throw InputError(name + ": triangle " + std::to_string(t) + " refers to a vertex that does not exist");
  }
  TriangleMesh mesh = joined(soup, info.collapsed_triangles);
  if (mesh.triangles.empty())
    throw InputError(name + (soup.triangles.empty()
                                 ? ": holds no triangles"
                                 : ": all of its triangles are degenerate: two corners of each "
                                   "are at the same place"));
  return mesh;
}

bool holds_triangles(const std::filesystem::path& path) {
  internal::require_file(path);
  const std::string extension = internal::lower_extension(path);
  if (extension == ".ply") return !internal::read_points(path).triangles.empty();
  return extension == ".stl" || extension == ".obj" || is_step(extension);
}

void write_mesh(const std::filesystem::path& path, const TriangleMesh& mesh) {
  const std::string extension = path.extension().string();
  if (extension != ".stl" && extension != ".ply")
    throw InputError(path.string() + ": meshes are written as .stl or .ply");
  aiScene scene;
  scene.mRootNode = new aiNode();
  scene.mNumMeshes = 1;
  scene.mMeshes = new aiMesh* [1] { new aiMesh() };
  scene.mRootNode->mNumMeshes = 1;
  scene.mRootNode->mMeshes = new unsigned[1]{0};
  scene.mNumMaterials = 1;
  scene.mMaterials = new aiMaterial* [1] { new aiMaterial() };
  aiMesh& out = *scene.mMeshes[0];
  out.mPrimitiveTypes = aiPrimitiveType_TRIANGLE;
  out.mNumVertices = static_cast<unsigned>(mesh.vertices.size());
  out.mVertices = new aiVector3D[mesh.vertices.size()];
  for (size_t i = 0; i < mesh.vertices.size(); ++i)
    out.mVertices[i] = aiVector3D(mesh.vertices[i].x(), mesh.vertices[i].y(), mesh.vertices[i].z());
  out.mNumFaces = static_cast<unsigned>(mesh.triangles.size());
  out.mFaces = new aiFace[mesh.triangles.size()];
  for (size_t t = 0; t < mesh.triangles.size(); ++t) {
    out.mFaces[t].mNumIndices = 3;
    out.mFaces[t].mIndices = new unsigned[3]{static_cast<unsigned>(mesh.triangles[t][0]),
                                             static_cast<unsigned>(mesh.triangles[t][1]),
                                             static_cast<unsigned>(mesh.triangles[t][2])};
  }
  std::filesystem::path partial = path;
  partial += ".partial";
  Assimp::Exporter exporter;
  const char* format = extension == ".stl" ? "stlb" : "plyb";
  if (exporter.Export(&scene, format, partial.string()) != AI_SUCCESS)
    throw InputError(path.string() + ": cannot be written: " + exporter.GetErrorString());
  internal::publish(partial, path);
}

}  // namespace gantry
