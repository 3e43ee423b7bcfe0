#pragma once

#include <string>

#include "gantry/inspection/inspection.h"
#include "gantry/inspection/report.h"
#include "report/report_facts.h"

namespace gantry::report {

/// The text of report.json. Numbers that do not exist (statistics of no points) are null.
std::string report_json(const InspectionResult& result, const InspectionOptions& options,
                        const Traceability& traceability, const ReportFacts& facts);

}  // namespace gantry::report
