#pragma once

#include <filesystem>
#include <functional>
#include <map>
#include <string>

#include "gantry/acquisition/cell.h"
#include "gantry/acquisition/journal.h"
#include "gantry/acquisition/motion.h"
#include "gantry/acquisition/plan.h"
#include "gantry/geometry/scan.h"
#include "gantry/hal/scanner.h"

namespace gantry {

/// What a run tells while it goes on.
struct RunObserver {
  /// A complete, journalled scan; in the order of the plan within one session. May block (back-pressure).
  std::function<void(TaggedScan)> scan;
  /// "moving", "capturing", ... at viewpoint k (from 0) of n.
  std::function<void(const std::string& stage, size_t k, size_t n)> stage = [](const std::string&, size_t,
                                                                               size_t) {};
};

/// A folder that holds a run: `journal.sqlite`, `scans/NNN.pcd`, `registration/`, `inspection/`.
class RunFolder {
 public:
  /// A new run: the folder must not exist or be empty. A resumed one: it must hold a journal whose
  /// facts equal `facts` (same cell, plan and CAD model, by hash). Throws InputError otherwise.
  RunFolder(const std::filesystem::path& path, const std::map<std::string, std::string>& facts, bool resume);

  const std::filesystem::path& path() const { return path_; }
  Journal& journal() { return *journal_; }

 private:
  std::filesystem::path path_;
  std::unique_ptr<Journal> journal_;
};

/// Executes a plan: for each viewpoint that has no scan yet, move and prove standstill, expose, tag with
/// forward kinematics, store, journal, hand on. Scans of an earlier session are read back and handed on
/// first. A scan that arrived incomplete is repeated twice; any other fault stops the stages and
/// ends the run, which can be resumed. The axes must be enabled and homed.
Result<void> execute_plan(const Cell& cell, const Plan& plan, Motion& motion, Scanner& scanner,
                          RunFolder& folder, Clock& clock, const RunObserver& observer);

}  // namespace gantry
