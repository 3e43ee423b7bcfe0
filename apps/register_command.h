#pragma once

#include <memory>

#include "app.h"

namespace gantry {

/// `gantry-fusion register`: scans and initial poses in; poses.txt, merged.ply and registration.json out.
class RegisterCommand {
 public:
  explicit RegisterCommand(CLI::App& app);
  ~RegisterCommand();

  bool parsed() const;
  /// Throws InputError when files or options are wrong. kUndecided when the result is not to be believed;
  /// the files are written all the same.
  ExitCode run() const;

 private:
  struct Impl;
  std::unique_ptr<Impl> impl_;
};

}  // namespace gantry
