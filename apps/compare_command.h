#pragma once

#include <memory>

#include "app.h"

namespace gantry {

/// `gantry-fusion compare`: how far a cloud is from another cloud or a mesh, by any of the metrics of
/// inspection/distances.h; as a table, JSON and a PLY with a distance for each point.
class CompareCommand {
 public:
  explicit CompareCommand(CLI::App& app);
  ~CompareCommand();

  bool parsed() const;
  /// Throws InputError when files or options are wrong. There is no verdict: kPass when it is done.
  ExitCode run() const;

 private:
  struct Impl;
  std::unique_ptr<Impl> impl_;
};

}  // namespace gantry
