#pragma once

#include <cstdint>
#include <filesystem>
#include <memory>
#include <optional>
#include <vector>

#include "gantry/foundation/clock.h"
#include "gantry/foundation/strict_yaml.h"
#include "gantry/geometry/ray_scene.h"
#include "gantry/kinematics/chain.h"
#include "gantry/sim/sensor.h"
#include "gantry/sim/stage.h"

namespace gantry {

/// The `simulation:` section of CELL.yaml: everything that only the simulated cell knows.
struct SimulationSettings {
  SensorModel sensor;
  std::vector<StageDynamics> stages;  ///< One per axis, in the order of the chain.
  /// How far the part stands from where the CAD model says (one sigma per axis, drawn once a run).
  double placement_sigma_mm = 0.3;
  double placement_sigma_rad = 0.0035;
  std::filesystem::path part;    ///< Mesh that stands in the cell unless another is named.
  std::filesystem::path holder;  ///< Mesh that carries it; not in the CAD model.
};

SimulationSettings read_simulation(StrictYaml simulation, const Chain& chain);

/// The simulated cell's physics: stages, the true kinematics, the part on its holder, the sensor.
/// The truth differs from the nominal chain by errors drawn from the uncertainties that the chain
/// itself states (axis directions and positions, sensor mounting), so that forward kinematics is good
/// but not perfect. Thread-safe; protocols and devices stand in front of it and share it.
class SimulatedWorld {
 public:
  /// `holder` may be empty. Meshes are in the part frame.
  SimulatedWorld(const Chain& nominal, const SimulationSettings& settings, const TriangleMesh& part,
                 const std::optional<TriangleMesh>& holder, uint64_t seed, Clock& clock);

  size_t axis_count() const { return stages_.size(); }
  SimulatedStage& stage(size_t axis) { return *stages_[axis]; }
  const SensorModel& sensor() const { return settings_.sensor; }
  Clock& clock() { return clock_; }

  /// Exposes for the given time, from now; returns when the exposure has ended.
  Scan expose(double exposure_s);

  // The truth, for tests and benchmarks only.
  /// Where the sensor really is relative to the part frame (the stage's, not the CAD's).
  Pose true_part_from_sensor(double now_s) const;
  /// The same if the stages stood exactly at q.
  Pose true_part_from_sensor_at(std::span<const double> q) const { return truth_.part_from_sensor(q); }
  /// Where the CAD model's frame really is on the stage.
  const Pose& true_part_from_cad() const { return part_from_cad_; }

 private:
  SimulationSettings settings_;
  Chain truth_;
  Pose part_from_cad_;
  std::unique_ptr<RayScene> scene_;  ///< Part and holder in the part frame.
  std::vector<std::unique_ptr<SimulatedStage>> stages_;
  uint64_t seed_;
  std::mutex exposing_;
  uint64_t scan_number_ = 0;
  Clock& clock_;
};

}  // namespace gantry
