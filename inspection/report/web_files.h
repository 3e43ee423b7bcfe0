#pragma once

namespace gantry::report {

/// The files of web/, as the build embeds them: the page is one file and loads nothing.
extern const char* const kPageCss;
extern const char* const kThemeJs;   ///< The switch between dark and light.
extern const char* const kViewerJs;  ///< The interactive view.

}  // namespace gantry::report
