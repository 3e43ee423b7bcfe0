#pragma once

#include <cstdint>
#include <memory>
#include <optional>
#include <span>
#include <string>
#include <string_view>
#include <vector>

#include "gantry/geometry/point_cloud.h"
#include "gantry/geometry/point_index.h"
#include "gantry/geometry/signed_distance.h"

namespace gantry {

/// How far two surfaces are apart, by the metrics that the paper compares (section "Distance metrics") and
/// two more. A is the compared cloud, B the reference; d(a, B) is the distance from a to the nearest point of
/// B. Every metric is one number, `value`; those that give each point of A a distance have it besides.
///
/// None of these is *the* distance. Most measure to whatever is nearest: between a slope of angle t and its
/// copy d higher they find d cos t. kEarthMovers alone keeps together what belongs together, if the clouds
/// have the same number of points. docs/results/distances.md shows what each is worth.
enum class Metric {
  /// "CD1", mm: (mean of d(a, B) + mean of d(b, A)) / 2. Points that are sparse or noisy change it.
  kChamfer,
  /// "CD2", mm^2: mean of d(a, B)^2 + mean of d(b, A)^2.
  kChamferSquared,
  /// mm: the largest d(a, B) or d(b, A). One stray point, or a hole, decides it.
  kHausdorff,
  /// mm: the larger of the percentiles of d(a, B) and of d(b, A) (Huttenlocher et al., 1993, partial
  /// distance). 100 is kHausdorff.
  kPercentileHausdorff,
  /// Earth Mover's, mm: the mean distance of partners, each point of the smaller cloud having another
  /// partner in the larger one, chosen for the least mean. Exact for two clouds of up to
  /// `exact_assignment_points`; beyond, groups of equally many neighbours stand for their points and
  /// `error_bound_mm` says by how much the result can be wrong at most. Clouds of different sizes are thus
  /// matched in part: a hole costs nothing by itself.
  kEarthMovers,
  /// Local models, mm: the mean over A of the distance to a surface through the `neighbours` points of B that
  /// are nearest to the nearest point of a (itself one of them), or to that nearest point if it is nearer:
  /// far from its points a model is guesswork. As CloudCompare does. Least-squares plane; unbounded.
  kPlane,
  /// ... height above the quadratic z = c0 + c1 x + ... + c5 y^2 in the frame of that plane; 6 points at
  /// least.
  kQuadric,
  /// ... the nearest triangle of the neighbours' Delaunay triangulation in that plane (2.5D).
  kTriangulation,
  /// mm: the mean over A of the distance to the reference mesh; of each point with its sign, positive outside
  /// of the material (see SignedDistance). Only where the reference is a mesh.
  kCloudToMesh,
  /// M3C2, mm (Lague, Brodu and Leroux, 2013): the mean over A of |distance between the mean positions of A
  /// and B in a cylinder along the local normal|; of each point with its sign, positive where A lies on the
  /// side that the normal points to, and with its level of detection.
  kM3c2
};

std::span<const Metric> all_metrics();
std::string_view to_string(Metric metric);             ///< "chamfer", "emd", "cloud-to-mesh", ...
std::optional<Metric> metric_named(std::string_view);  ///< The inverse.
std::string_view unit_of(Metric metric);               ///< "mm" or "mm2"

struct DistanceOptions {
  size_t neighbours = 6;                  ///< k of the local models: from 3 (quadric: 6) to 64.
  double percentile = 95;                 ///< Of kPercentileHausdorff, in (0, 100].
  size_t exact_assignment_points = 2048;  ///< kEarthMovers; time grows with the cube, memory with the square.
  /// M3C2, mm; 0: chosen from the spacing of the points and said in the result's note.
  double m3c2_normal_diameter_mm = 0;    ///< Scale D of the normals.
  double m3c2_cylinder_diameter_mm = 0;  ///< d
  double m3c2_depth_mm = 0;              ///< The cylinder reaches so far to either side.
  double registration_mm = 0;            ///< M3C2: standard uncertainty of A's place relative to B.
};

/// What the distances are measured to: a cloud, or a mesh, of which points are sampled for the metrics
/// between clouds. Holds the search structures, so that one reference serves many clouds. Throws InputError
/// for one without points or triangles, or with a coordinate that is not finite.
class DistanceReference {
 public:
  explicit DistanceReference(PointCloud cloud);
  /// `samples` points, evenly at random over the area.
  DistanceReference(TriangleMesh mesh, size_t samples, uint64_t seed = 1);
  ~DistanceReference();
  DistanceReference(DistanceReference&&) noexcept;
  DistanceReference& operator=(DistanceReference&&) noexcept;

  const PointCloud& cloud() const;     ///< In another order than given: along a space-filling curve.
  const PointIndex& index() const;     ///< Of that cloud.
  const SignedDistance* mesh() const;  ///< Null when the reference is a cloud.

 private:
  struct Impl;
  std::unique_ptr<Impl> impl_;
};

/// Of the points' distances, with their sign where they have one.
struct DistanceSummary {
  size_t count = 0;  ///< Points with a distance.
  double mean = 0, sigma = 0, rms = 0, min = 0, max = 0;
  double p05 = 0, p50 = 0, p95 = 0;
};

struct DistanceResult {
  Metric metric = Metric::kChamfer;
  double value = 0;  ///< In unit_of(metric).
  /// Of each point of A, in its order; NaN where the metric gives it none. Of kChamfer, kChamferSquared and
  /// both Hausdorff: d(a, B). Of kEarthMovers: to the partner.
  std::vector<float> distance_mm;
  std::vector<float> lod95_mm;  ///< kM3c2 only: see below.
  DistanceSummary summary;
  double error_bound_mm = 0;  ///< kEarthMovers: |value - exact value| is at most this; 0: exact.
  size_t beside_border =
      0;             ///< kCloudToMesh: points closest to the border of an open mesh; their sign means little.
  std::string note;  ///< What a reader should know: what was chosen or approximated.
};

/// By what a distance of M3C2 must exceed 0 to be a change with 95 % confidence:
/// 1.96 (sqrt(s1^2 / n1 + s2^2 / n2) + registration), s the standard deviation of the n points of a cloud in
/// the cylinder along its axis.
double level_of_detection_95(double s1_mm, size_t n1, double s2_mm, size_t n2, double registration_mm);

/// Throws InputError when an option is out of range, the cloud is empty or holds a coordinate that is not
/// finite, or the metric asks for more than there is (neighbours, a mesh, four points for M3C2). The same to
/// the last bit for any number of threads.
DistanceResult compare(const PointCloud& compared, const DistanceReference& reference, Metric metric,
                       const DistanceOptions& options = {});

/// Several at once, which share their nearest neighbours.
std::vector<DistanceResult> compare(const PointCloud& compared, const DistanceReference& reference,
                                    std::span<const Metric> metrics, const DistanceOptions& options = {});

}  // namespace gantry
