#pragma once

namespace gantry::report {

/// The style sheet of report.html: light, dark and print.
extern const char* const kPageStyle;

}  // namespace gantry::report
