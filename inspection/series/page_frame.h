#pragma once

#include <string>

#include "gantry/inspection/series.h"

namespace gantry::series {

extern const char* const kTrendCss;

/// The verdict of a page, large, with the style "pass", "fail" or "undecided".
struct Banner {
  std::string style, word, reason;
};

/// A whole page in the style of the inspection report. `title` and `kicker` are text, `date_note` and `body`
/// HTML.
std::string page(const std::string& kicker, const std::string& title, const std::string& date_note,
                 const Banner& banner, const std::string& body);

/// A cell of a table with a number; HTML.
std::string cell(const std::string& value, const std::string& style = "n");
/// "1.67" with its interval in small, "–" when there is none.
std::string estimate_text(const Estimate& estimate, int decimals);
/// A cell with what a row is about: its name, and smaller what that is.
std::string feature_cell(const std::string& name, const std::string& words);
/// One of the figures below the banner.
std::string figure(const std::string& name, const std::string& value, const std::string& note);

/// Writes page and JSON; returns where the page is.
std::filesystem::path write_both(const std::filesystem::path& folder, const std::string& name,
                                 const std::string& html, const std::string& json);

}  // namespace gantry::series
