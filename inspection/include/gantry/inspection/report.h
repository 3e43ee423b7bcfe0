#pragma once

#include <filesystem>
#include <string>
#include <utility>
#include <vector>

#include "gantry/inspection/inspection.h"

namespace gantry {

/// What a reader must know to trust a verdict later: shown in the report as a table, in this order.
struct Traceability {
  std::string title;       ///< "bracket", for the heading.
  std::string created;     ///< ISO 8601 date and time.
  bool simulated = false;  ///< Shown prominently: no real part was measured.
  std::vector<std::pair<std::string, std::string>>
      entries;  ///< "CAD model" -> "bracket.stl, sha256 12ab...".
};

/// Writes `report.html` (one self-contained file), `report.json` (the same numbers) and
/// `deviations.ply` (the cloud in the CAD frame in the order given, fields deviation, uncertainty,
/// defect) into `folder`, which must exist. Returns the path of report.html.
std::filesystem::path write_report(const std::filesystem::path& folder, const InspectionResult& result,
                                   const SignedDistance& reference, const InspectionOptions& options,
                                   const Traceability& traceability);

}  // namespace gantry
