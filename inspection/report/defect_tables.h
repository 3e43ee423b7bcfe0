#pragma once

#include <string>

#include "report/page.h"

namespace gantry::report {

/// Sections of the page, as HTML: the defects with their close-ups, and what was not judged.
std::string defect_table(const PageContent& content);
std::string unjudged_tables(const PageContent& content);

}  // namespace gantry::report
