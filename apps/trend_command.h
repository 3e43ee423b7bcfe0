#pragma once

#include <memory>

#include "app.h"

namespace gantry {

/// `gantry-fusion trend`: control charts, capability and drift of the same part over many runs, or, with
/// --gauge, a gauge R&R study (inspection/series.h, inspection/gauge.h); as a table, JSON and a page.
class TrendCommand {
 public:
  explicit TrendCommand(CLI::App& app);
  ~TrendCommand();

  bool parsed() const;
  /// Throws InputError when files or options are wrong. There is no verdict on a part: kPass when it is done.
  ExitCode run() const;

 private:
  struct Impl;
  std::unique_ptr<Impl> impl_;
};

}  // namespace gantry
