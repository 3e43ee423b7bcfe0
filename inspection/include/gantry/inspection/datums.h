#pragma once

#include <Eigen/Core>
#include <filesystem>
#include <optional>
#include <string>
#include <vector>

#include "gantry/inspection/alignment.h"

namespace gantry {

enum class DatumKind {
  kPlane,     ///< Direction of its normal and position along it.
  kCylinder,  ///< Direction and position of its axis; the radius does not matter.
  kPoint      ///< Position of a small piece of surface along its normal (a datum target).
};

/// A feature of the part that locates it, picked on the CAD model. Millimetres, CAD frame.
struct Datum {
  std::string name;
  DatumKind kind = DatumKind::kPlane;
  Eigen::Vector3d position_mm = Eigen::Vector3d::Zero();  ///< The closest CAD surface is the feature's.
  double radius_mm = 0;  ///< CAD surface and points within this of the position belong to it ...
  std::optional<Eigen::Vector3d> box_mm;  ///< ... or within a box of this size about it.
  std::optional<Eigen::Vector3d> normal;  ///< Only surface facing this way (within 60 degrees) is looked for.
};

/// A datum reference frame: datums in order of precedence.
struct DatumSet {
  std::string name;
  std::vector<Datum> datums;
};

/// Reads DATUMS.yaml (docs/files.md). Throws InputError naming file, line and key.
DatumSet read_datums(const std::filesystem::path& file);

/// Lays the cloud onto the model by its datums alone. Each is fitted robustly to the cloud's points that
/// face the CAD's feature; then the pose is built in order of precedence: every datum fixes what the ones
/// before it left open (a primary plane 3 freedoms, a secondary plane 2, a tertiary one 1) and nothing else.
/// `start` is a rough alignment of the same cloud, such as a best fit. The covariance follows from the
/// features' fits (a sandwich over patches of each).
///
/// Throws InputError when there is no such feature on the CAD model or too few points lie on it, when a datum
/// fixes nothing, or when a motion is left open: it is named.
AlignmentResult align_to_datums(const PointCloud& cloud, const SignedDistance& model, const DatumSet& set,
                                const AlignmentResult& start, const AlignmentOptions& options);

}  // namespace gantry
