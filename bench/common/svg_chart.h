#pragma once

#include <filesystem>
#include <string>
#include <vector>

namespace gantry::bench {

/// The few shapes that the charts need; coordinates in px.
class Svg {
 public:
  Svg(double width, double height);
  void line(double x1, double y1, double x2, double y2, const std::string& colour, double width = 1,
            const std::string& dashes = {});
  void rect(double x, double y, double width, double height, const std::string& colour,
            const std::string& tip = {});
  void circle(double x, double y, double radius, const std::string& colour, const std::string& tip = {});
  /// `anchor`: start, middle or end.
  void text(double x, double y, const std::string& text, const std::string& anchor = "start",
            double size = 12, const std::string& colour = "#333");
  void save(const std::filesystem::path& path) const;

 private:
  std::string body_;
  double width_, height_;
};

std::string colour_of(size_t series);

/// Lines over named positions, logarithmic: one panel for each title side by side, the same series in all.
struct LinePanels {
  std::string title, unit;
  double threshold = 0;  ///< Drawn as a dashed line; 0: none.
  std::vector<std::string> positions, series;
  struct Point {
    size_t position = 0;
    double median = 0, worst = 0;  ///< The worst as a thin stroke above.
  };
  struct Panel {
    std::string title;
    std::vector<std::vector<Point>> lines;  ///< One for each series.
  };
  std::vector<Panel> panels;
};
void save_line_panels(const std::filesystem::path& path, const LinePanels& chart);

/// Horizontal bars in segments: a row for each name, a column of bars for each group.
struct BarGrid {
  std::string title;
  std::vector<std::string> rows, groups, segments, colours;
  bool share = false;  ///< Bars as parts of a whole; otherwise lengths, on one scale for all bars.
  std::string unit;
  std::vector<std::vector<std::vector<double>>> values;  ///< [row][group][segment]; empty: not run.
};
void save_bar_grid(const std::filesystem::path& path, const BarGrid& chart);

}  // namespace gantry::bench
