#include "load.h"

#include <algorithm>
#include <fstream>
#include <map>
#include <random>

#include "gantry/foundation/error.h"
#include "gantry/geometry/surface_samples.h"

namespace gantry::bench {
namespace {

template <class T>
void write_all(std::ofstream& file, const std::vector<T>& values) {
  const uint64_t count = values.size();
  file.write(reinterpret_cast<const char*>(&count), sizeof count);
  file.write(reinterpret_cast<const char*>(values.data()), static_cast<std::streamsize>(count * sizeof(T)));
}

template <class T>
void read_all(std::ifstream& file, std::vector<T>& values) {
  uint64_t count = 0;
  if (file.read(reinterpret_cast<char*>(&count), sizeof count)) values.resize(count);
  file.read(reinterpret_cast<char*>(values.data()), static_cast<std::streamsize>(count * sizeof(T)));
}

void require(const std::ios& file, const std::filesystem::path& path, const char* what) {
  if (!file) throw InputError(path.string() + ": cannot be " + what);
}

}  // namespace

TriangleMesh subdivided(const TriangleMesh& mesh) {
  TriangleMesh fine;
  fine.vertices = mesh.vertices;
  std::map<std::pair<int, int>, int> middles;
  const auto middle = [&](int a, int b) {
    const auto [at, is_new] =
        middles.try_emplace({std::min(a, b), std::max(a, b)}, static_cast<int>(fine.vertices.size()));
    if (is_new) fine.vertices.push_back(0.5f * (mesh.vertices[a] + mesh.vertices[b]));
    return at->second;
  };
  for (const Eigen::Vector3i& t : mesh.triangles) {
    const int ab = middle(t[0], t[1]), bc = middle(t[1], t[2]), ca = middle(t[2], t[0]);
    for (const Eigen::Vector3i& part :
         {Eigen::Vector3i(t[0], ab, ca), {ab, t[1], bc}, {ca, bc, t[2]}, {ab, bc, ca}})
      fine.triangles.push_back(part);
  }
  return fine;
}

PointCloud points_near(const TriangleMesh& mesh, size_t count, uint64_t seed) {
  PointCloud cloud = sample_surface(mesh, count, seed);
  std::mt19937_64 random(seed + 1000);
  std::uniform_real_distribution<float> uniform(-1, 1);
  for (size_t i = 0; i < cloud.size(); ++i) cloud.points[i] += uniform(random) * cloud.normals[i];
  cloud.normals.clear();
  return cloud;
}

void write_raw(const std::filesystem::path& path, const PointCloud& cloud) {
  std::ofstream file(path, std::ios::binary);
  write_all(file, cloud.points);
  require(file.flush(), path, "written");
}

void write_raw(const std::filesystem::path& path, const TriangleMesh& mesh) {
  std::ofstream file(path, std::ios::binary);
  write_all(file, mesh.vertices);
  write_all(file, mesh.triangles);
  require(file.flush(), path, "written");
}

void write_raw(const std::filesystem::path& path, const std::vector<float>& distances) {
  std::ofstream file(path, std::ios::binary);
  write_all(file, distances);
  require(file.flush(), path, "written");
}

std::vector<float> read_raw_distances(const std::filesystem::path& path) {
  std::ifstream file(path, std::ios::binary);
  std::vector<float> distances;
  read_all(file, distances);
  require(file, path, "read");
  return distances;
}

PointCloud read_raw_cloud(const std::filesystem::path& path) {
  std::ifstream file(path, std::ios::binary);
  PointCloud cloud;
  read_all(file, cloud.points);
  require(file, path, "read");
  return cloud;
}

TriangleMesh read_raw_mesh(const std::filesystem::path& path) {
  std::ifstream file(path, std::ios::binary);
  TriangleMesh mesh;
  read_all(file, mesh.vertices);
  read_all(file, mesh.triangles);
  require(file, path, "read");
  return mesh;
}

}  // namespace gantry::bench
