#include "gantry/acquisition/plan_check.h"

#include <cstdio>
#include <numbers>

#include "gantry/acquisition/collision_settings.h"

namespace gantry {
namespace {

/// "'part' would come within 3.20 mm of 'frame', where 10.05 mm are needed, at linear 290.00 mm, ...".
std::string text(const Collision& collision, const Cell& cell) {
  char number[80];
  std::string result = "'" + collision.first + "' would hit '" + collision.second + "'";
  if (collision.clearance_mm > 0) {
    std::snprintf(number, sizeof number, "%.2f mm of '", collision.clearance_mm);
    result = "'" + collision.first + "' would come within " + number + collision.second + "'";
    std::snprintf(number, sizeof number, ", where %.2f mm are needed,", collision.demanded_mm);
    result += collision.clearance_mm > collision.demanded_mm ? " for too long to be proved free," : number;
  }
  for (size_t i = 0; i < cell.axes.size(); ++i) {
    const bool linear = cell.axes[i].kind == AxisKind::kLinear;
    std::snprintf(number, sizeof number, "%s %.2f %s",
                  (i == 0 ? " at " + cell.axes[i].name : ", " + cell.axes[i].name).c_str(),
                  linear ? collision.q[i] : collision.q[i] * 180 / std::numbers::pi, linear ? "mm" : "deg");
    result += number;
  }
  return result;
}

}  // namespace

std::vector<double> home_position(const Cell& cell) {
  std::vector<double> q;
  for (const AxisSettings& axis : cell.axes) q.push_back(axis.limits.position_at_home);
  return q;
}

std::set<int> viewpoints_done(const Journal& journal) {
  std::set<int> done;
  for (const ScanRecord& record : journal.scans()) done.insert(record.viewpoint);
  return done;
}

std::optional<PlanCollision> first_collision(const Cell& cell, const Plan& plan, const CollisionModel& model,
                                             const std::set<int>& done) {
  std::vector<double> from = home_position(cell);
  std::string from_name = "home";
  for (size_t k = 0; k < plan.viewpoints.size(); ++k) {
    if (done.contains(static_cast<int>(k))) continue;
    const Viewpoint& view = plan.viewpoints[k];
    if (auto collision = model.first_on_path(from, view.q))
      return PlanCollision{from_name, view.name, std::move(*collision)};
    from = view.q;
    from_name = view.name;
  }
  return std::nullopt;
}

void require_collision_free(const Cell& cell, const Plan& plan, const TriangleMesh* part,
                            const TriangleMesh* fixture, const std::set<int>& done) {
  if (!cell.collision) return;
  const CollisionModel model = make_collision_model(cell, part, fixture);
  const auto found = first_collision(cell, plan, model, done);
  if (!found) return;
  const std::string way = found->collision.at >= 1 ? "there, " : "on the way from '" + found->from + "', ";
  throw InputError(plan.file.string() + ": viewpoint '" + found->to + "' is refused: " + way +
                   text(found->collision, cell) + "; nothing has moved");
}

std::function<Result<void>(std::span<const double>, std::span<const double>)> make_path_check(
    const Cell& cell, const CollisionModel& model) {
  return [&cell, &model](std::span<const double> from, std::span<const double> to) -> Result<void> {
    if (const auto collision = model.first_on_path(from, to))
      return fault(FaultKind::kRefused, "collision check", "move refused: " + text(*collision, cell));
    return {};
  };
}

}  // namespace gantry
