#pragma once

#include <string>
#include <vector>

#include "gantry/inspection/inspection.h"
#include "gantry/inspection/report.h"
#include "report/picture.h"
#include "report/report_facts.h"

namespace gantry::report {

/// All that the page shows.
struct PageContent {
  const InspectionResult& result;
  const InspectionOptions& options;
  const Traceability& traceability;
  const ReportFacts& facts;
  const std::vector<Picture>& overviews;
  const std::vector<Picture>& coverage_views;
  const std::vector<Picture>& close_ups;  ///< Of the first defects, in their order.
  const std::string& viewer_data;         ///< See viewer_data().
  double seen_reach_mm;                   ///< See MeasuredSurface::reach_mm.
};

/// The whole of report.html.
std::string page(const PageContent& content);

}  // namespace gantry::report
