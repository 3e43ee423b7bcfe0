#pragma once

#include <functional>
#include <optional>
#include <set>
#include <span>
#include <string>

#include "gantry/acquisition/cell.h"
#include "gantry/acquisition/journal.h"
#include "gantry/acquisition/plan.h"
#include "gantry/foundation/error.h"
#include "gantry/kinematics/collision.h"

namespace gantry {

/// Where a plan first leads to a collision.
struct PlanCollision {
  std::string from, to;  ///< Names of the viewpoints between which it happens; `from` may be "home".
  Collision collision;
};

/// Where homing leaves the axes.
std::vector<double> home_position(const Cell& cell);

/// Indices of the viewpoints that have their scan, which a resumed run leaves out.
std::set<int> viewpoints_done(const Journal& journal);

/// Checks every move of the plan, from the home position to the first viewpoint and from each to the next.
/// Viewpoints in `done` are left out. Moves are straight in joint space. Homing itself is not checked: where
/// the axes stand before it is unknown.
std::optional<PlanCollision> first_collision(const Cell& cell, const Plan& plan, const CollisionModel& model,
                                             const std::set<int>& done = {});

/// The same for a cell with a collision section, with the part's CAD mesh and the fixture where they are
/// given; a cell without that section is not checked. Throws InputError that names the plan, the viewpoint,
/// the two bodies, how near they come and where.
void require_collision_free(const Cell& cell, const Plan& plan, const TriangleMesh* part,
                            const TriangleMesh* fixture, const std::set<int>& done = {});

/// One move, for whoever is about to make it: a kRefused fault that names the two bodies, or nothing.
/// `model` and `cell` must outlive the function.
std::function<Result<void>(std::span<const double> from, std::span<const double> to)> make_path_check(
    const Cell& cell, const CollisionModel& model);

}  // namespace gantry
