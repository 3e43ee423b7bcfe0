#pragma once

#include <cstdint>
#include <string>
#include <vector>

#include "gantry/acquisition/cell.h"
#include "gantry/acquisition/plan.h"
#include "gantry/geometry/triangle_mesh.h"
#include "gantry/inspection/inspection.h"
#include "gantry/sim/bracket.h"

namespace gantry::bench {

/// One inspection of a bracket in the simulated cell, from the moving stages to the verdict.
struct Trial {
  BracketDefects defects;    ///< Of the part that is measured.
  uint64_t seed = 1;         ///< Of the cell's true geometry, the part's place, noise and distortion.
  int columns = 960;         ///< Of the sensor; rows in proportion.
  double distortion_mm = 0;  ///< See SensorModel.
  double systematic_mm = 0;  ///< What the inspection is told of that.
  double tolerance_mm = 0.2;
};

/// A judged point's deviation as measured, its truth and its stated standard uncertainty (mm).
struct Judged {
  float measured, truth, uncertainty;
  bool smooth;  ///< The true surface around is smooth: no edge within 1 mm.
};

struct Outcome {
  std::string trouble;  ///< Why there is no result: registration is not to be trusted. Empty: there is.
  InspectionResult inspection;
  std::vector<Judged> points;   ///< A few thousand, spread evenly.
  double largest_truth_mm = 0;  ///< Of |truth| over the part's whole surface.
};

/// Runs trials in one cell. Truth is the part's own mesh, against the CAD model, at the point nearest to the
/// measured one: nothing of the inspection's smoothing, alignment or registration enters it.
class SimulatedInspection {
 public:
  SimulatedInspection(const std::filesystem::path& cell, const std::filesystem::path& plan);
  Outcome run(const Trial& trial) const;

 private:
  Cell cell_;
  Plan plan_;
  TriangleMesh fixture_;
  SignedDistance cad_;
};

}  // namespace gantry::bench
