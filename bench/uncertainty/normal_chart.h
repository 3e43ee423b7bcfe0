#pragma once

#include <filesystem>
#include <string>
#include <vector>

namespace gantry::bench {

/// How samples are distributed beside the standard normal distribution that they should have.
struct NormalChart {
  std::string title;
  struct Series {
    std::string name;
    std::vector<double> values;
  };
  std::vector<Series> series;
};
void save_normal_chart(const std::filesystem::path& path, const NormalChart& chart);

}  // namespace gantry::bench
