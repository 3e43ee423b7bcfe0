#pragma once

#include <filesystem>
#include <nlohmann/json.hpp>

#include "gantry/foundation/error.h"
#include "gantry/inspection/inspection.h"
#include "gantry/inspection/report.h"

namespace gantry {

/// Inspects, writes the report into `folder`, prints the summary on stdout (or one JSON object) and
/// returns the exit code that the verdict stands for.
ExitCode inspect_and_report(const PointCloud& cloud, const TriangleMesh& reference,
                            const InspectionOptions& options, const Traceability& traceability,
                            const std::filesystem::path& folder, bool json);

}  // namespace gantry
