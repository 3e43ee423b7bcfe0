#include "series/page_frame.h"

#include <cmath>

#include "report/text.h"
#include "report/web_files.h"

namespace gantry::series {

using report::escaped;
using report::fixed;

std::string page(const std::string& kicker, const std::string& title, const std::string& date_note,
                 const Banner& banner, const std::string& body) {
  const std::string icon = banner.style == "pass"   ? "<path d=\"M10 20l7 7 13-15\"/>"
                           : banner.style == "fail" ? "<path d=\"M20 10v13M20 29v.2\"/>"
                                                    : "<path d=\"M11 20h18\"/>";
  return "<!DOCTYPE html>\n<html lang=\"en\">\n<head>\n<meta charset=\"utf-8\">\n"
         "<meta name=\"viewport\" content=\"width=device-width, initial-scale=1\">\n<title>" +
         escaped(title) + " \u00b7 " + escaped(kicker) + "</title>\n<style>" + report::kPageCss + kTrendCss +
         "</style>\n</head>\n<body>\n<main>\n<header><div><div class=\"kicker\">" + escaped(kicker) +
         "</div><h1>" + escaped(title) +
         "</h1></div><div class=\"date\"><button id=\"theme\" type=\"button\" hidden>Dark</button>" +
         date_note + "</div></header>\n<section class=\"verdict card " + banner.style +
         "\"><div class=\"badge-box\"><svg viewBox=\"0 0 40 40\" aria-hidden=\"true\"><circle cx=\"20\" "
         "cy=\"20\" "
         "r=\"17.5\"/>" +
         icon + "</svg>" + escaped(banner.word) + "</div><div class=\"reason\">" + escaped(banner.reason) +
         "</div></section>\n" + body +
         "<footer>Gantry. One file, nothing is loaded from elsewhere.</footer>\n</main>\n<script>\n" +
         report::kThemeJs + "</script>\n</body>\n</html>\n";
}

std::string cell(const std::string& value, const std::string& style) {
  return "<td class=\"" + style + "\">" + value + "</td>";
}

std::string estimate_text(const Estimate& e, int decimals) {
  if (!std::isfinite(e.value)) return "\u2013";
  std::string text = "<b>" + fixed(e.value, decimals) + "</b>";
  if (std::isfinite(e.low) && std::isfinite(e.high))
    text += "<br><span class=\"soft\">" + fixed(e.low, decimals) + "\u2009\u2026\u2009" +
            fixed(e.high, decimals) + "</span>";
  return text;
}

std::string feature_cell(const std::string& name, const std::string& words) {
  return "<td class=\"feature\"><b>" + escaped(name) + "</b>" +
         (words.empty() ? "" : "<br><span class=\"soft\">" + escaped(words) + "</span>") + "</td>";
}

std::string figure(const std::string& name, const std::string& value, const std::string& note) {
  return "<div><span>" + name + "</span><b>" + value + "</b><span>" + note + "</span></div>";
}

std::filesystem::path write_both(const std::filesystem::path& folder, const std::string& name,
                                 const std::string& html, const std::string& json) {
  report::write_file(folder / (name + ".json"), json);
  const std::filesystem::path page = folder / (name + ".html");
  report::write_file(page, html);
  return page;
}

}  // namespace gantry::series
