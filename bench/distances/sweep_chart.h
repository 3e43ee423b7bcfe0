#pragma once

#include <filesystem>
#include <string>
#include <vector>

namespace gantry::bench {

/// Lines with a stroke of one spread to either side over named positions, linear: one panel for each title
/// side by side, the same series and the same scale in all.
struct SweepChart {
  std::string title, x_title, y_title;
  std::vector<std::string> positions, series;
  struct Point {
    double mean = 0, spread = 0;
  };
  struct Panel {
    std::string title;
    std::vector<std::vector<Point>> lines;  ///< [series][position]
  };
  std::vector<Panel> panels;
};
void save_sweep_chart(const std::filesystem::path& path, const SweepChart& chart);

}  // namespace gantry::bench
