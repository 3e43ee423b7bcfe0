#pragma once

#include <string>
#include <vector>

namespace gantry::bench {

/// printf into a string.
[[gnu::format(printf, 1, 2)]] std::string text(const char* format, ...);

/// A table in Markdown, columns padded so that the source reads as a table too.
class Table {
 public:
  explicit Table(std::vector<std::string> header) { rows_.push_back(std::move(header)); }
  void add(std::vector<std::string> row) { rows_.push_back(std::move(row)); }
  std::string str() const;

 private:
  std::vector<std::vector<std::string>> rows_;
};

/// Two significant digits: 1.3e-4 for small numbers, 0.0042, 0.38, 12.
std::string short_number(double value);

}  // namespace gantry::bench
