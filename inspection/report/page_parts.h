#pragma once

#include <string>

#include "report/page.h"

namespace gantry::report {

/// Cut, not rounded: 100 % means all.
std::string percent(double fraction, int decimals = 2);
std::string mm(double value, int decimals = 3);
std::string signed_mm(double value);
/// A row of a table with a name and a value; both are HTML.
std::string row(const std::string& name, const std::string& value, const std::string& style = "n");
size_t count_of(const InspectionResult& result, PointClass point_class);

/// Sections of the page, as HTML.
std::string viewer_section(const PageContent& content);
std::string cuts_section(const PageContent& content, const ColourScale& colours);
std::string coverage_section(const PageContent& content);
std::string distribution_section(const PageContent& content, const ColourScale& colours);

}  // namespace gantry::report
