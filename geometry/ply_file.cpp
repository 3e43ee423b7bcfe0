// PLY, as Greg Turk's "The PLY Polygon File Format" (Stanford, 1994) has it: a header that lists elements
// and their properties, then the elements. Two additions: a range_grid with num_cols and num_rows in
// obj_info (Stanford's range scans: each cell holds the index of its vertex, or none), and an element
// camera (PCL's: pose and size of the grid).

#include <algorithm>
#include <cmath>
#include <limits>
#include <optional>

#include "gantry/foundation/error.h"
#include "number_reader.h"
#include "point_table.h"

namespace gantry::internal {
namespace {

struct Property {
  std::string name;
  NumberType type;
  std::optional<NumberType> length;  ///< Of a list; none: one number.
};

struct Element {
  std::string name;
  size_t count = 0;
  std::vector<Property> properties;
};

struct Header {
  Encoding encoding = Encoding::kAscii;
  std::vector<Element> elements;
  size_t columns = 0, rows = 0;    ///< Of the range grid.
  std::vector<std::string> scans;  ///< Names, of RawSources.
  std::string doubt;               ///< Of RawSources, too.
};

NumberType number_type(const HeaderReader& header, const std::string& word) {
  static const std::map<std::string, NumberType> kTypes = {
      {"char", {NumberKind::kSigned, 1}},     {"int8", {NumberKind::kSigned, 1}},
      {"uchar", {NumberKind::kUnsigned, 1}},  {"uint8", {NumberKind::kUnsigned, 1}},
      {"short", {NumberKind::kSigned, 2}},    {"int16", {NumberKind::kSigned, 2}},
      {"ushort", {NumberKind::kUnsigned, 2}}, {"uint16", {NumberKind::kUnsigned, 2}},
      {"int", {NumberKind::kSigned, 4}},      {"int32", {NumberKind::kSigned, 4}},
      {"uint", {NumberKind::kUnsigned, 4}},   {"uint32", {NumberKind::kUnsigned, 4}},
      {"float", {NumberKind::kFloat, 4}},     {"float32", {NumberKind::kFloat, 4}},
      {"double", {NumberKind::kFloat, 8}},    {"float64", {NumberKind::kFloat, 8}}};
  const auto found = kTypes.find(word);
  if (found == kTypes.end()) header.fail("unknown type '" + word + "'");
  return found->second;
}

Property read_property(const HeaderReader& header, const std::vector<std::string>& words) {
  if (words.size() == 5 && words[1] == "list")
    return {words[4], number_type(header, words[3]), number_type(header, words[2])};
  if (words.size() != 3) header.fail("expected 'property TYPE NAME' or 'property list TYPE TYPE NAME'");
  return {words[2], number_type(header, words[1]), std::nullopt};
}

Encoding read_encoding(const HeaderReader& header, const std::vector<std::string>& words) {
  const std::string format = words.size() > 1 ? words[1] : "";
  if (format == "ascii") return Encoding::kAscii;
  if (format == "binary_little_endian") return Encoding::kLittleEndian;
  if (format == "binary_big_endian") return Encoding::kBigEndian;
  header.fail("expected format ascii, binary_little_endian or binary_big_endian, found '" + format + "'");
}

/// The words from `first` on as one.
std::string joined(const std::vector<std::string>& words, size_t first) {
  std::string all = words[first];
  for (size_t k = first + 1; k < words.size(); ++k) all += " " + words[k];
  return all;
}

Header read_header(HeaderReader& reader) {
  if (reader.next_line()[0] != "ply") reader.fail("is no PLY file: it does not begin with 'ply'");
  Header header;
  bool format_known = false;
  for (auto words = reader.next_line(); words[0] != "end_header"; words = reader.next_line()) {
    if (words[0] == "format") {
      header.encoding = read_encoding(reader, words);
      format_known = true;
    } else if (words[0] == "element") {
      if (words.size() != 3) reader.fail("expected 'element NAME COUNT'");
      header.elements.push_back({words[1], reader.count(words, 2), {}});
    } else if (words[0] == "property") {
      if (header.elements.empty()) reader.fail("a property before the first element");
      header.elements.back().properties.push_back(read_property(reader, words));
    } else if (words[0] == "obj_info") {
      if (words.size() > 1 && words[1] == "num_cols") header.columns = reader.count(words, 2);
      if (words.size() > 1 && words[1] == "num_rows") header.rows = reader.count(words, 2);
    } else if (words[0] == "comment") {
      if (words.size() > 3 && words[1] == "gantry" && words[2] == "scan")
        header.scans.push_back(joined(words, 3));
      if (words.size() > 3 && words[1] == "gantry" && words[2] == "doubt") header.doubt = joined(words, 3);
    } else {
      reader.fail("its header is broken: unknown word '" + words[0] + "'");
    }
  }
  if (!format_known) reader.fail("its header has no line 'format'");
  return header;
}

/// Reads the elements one after the other into a PointTable.
class Body {
 public:
  Body(const Header& header, std::string_view bytes, const std::filesystem::path& path)
      : header_(header), numbers_(bytes, header.encoding, path), path_(path) {}

  PointTable read() {
    const auto is_vertex = [](const Element& element) { return element.name == "vertex"; };
    if (std::count_if(header_.elements.begin(), header_.elements.end(), is_vertex) != 1)
      fail("expected one element 'vertex'");
    for (const Element& element : header_.elements) read_element(element);
    table_.sources.scans = header_.scans;
    table_.sources.doubt = header_.doubt;
    if (grid_)
      spread_over_grid();
    else if (is_grid_of_vertices(camera_size_)) {
      table_.width = static_cast<size_t>(camera_size_[0]);
      table_.height = static_cast<size_t>(camera_size_[1]);
    }
    return std::move(table_);
  }

 private:
  [[noreturn]] void fail(const std::string& message) const {
    throw InputError(path_.string() + ": " + message);
  }

  bool is_grid_of_vertices(const double (&size)[2]) const {
    return size[0] >= 1 && size[1] >= 1 && size[0] == std::floor(size[0]) && size[1] == std::floor(size[1]) &&
           size[0] * size[1] == static_cast<double>(vertices_);
  }

  void read_element(const Element& element) {
    size_t row_bytes = 0;
    for (const Property& property : element.properties)
      row_bytes += numbers_.least_bytes(property.length.value_or(property.type));
    if (element.count > 0)
      numbers_.require_room(element.count, row_bytes, "of element '" + element.name + "'");
    if (element.name == "vertex") return read_vertices(element);
    if (element.name == "face") return read_faces(element);
    if (element.name == "range_grid") return read_grid(element);
    if (element.name == "scan_share") return read_shares(element);
    if (element.name == "pose_covariance") return read_pose_covariance(element);
    for (size_t i = 0; i < element.count; ++i) read_other(element);
  }

  /// A list's numbers, or the one number.
  void read_property(const Property& property) {
    list_.clear();
    const double length = property.length ? numbers_.next(*property.length) : 1;
    if (!(length >= 0) || length != std::floor(length))
      fail("a list of " + std::to_string(length) + " numbers");
    for (double i = 0; i < length; ++i) list_.push_back(numbers_.next(property.type));
  }

  void read_vertices(const Element& element) {
    std::vector<std::vector<double>*> columns;
    for (const Property& property : element.properties) {
      columns.push_back(property.length ? nullptr : column_for(table_, property.name));
      if (!columns.back()) continue;
      if (columns.back()->capacity() > 0) fail("field '" + property.name + "' is given twice");
      columns.back()->reserve(std::max<size_t>(element.count, 1));
    }
    for (size_t i = 0; i < element.count; ++i)
      for (size_t k = 0; k < columns.size(); ++k) {
        read_property(element.properties[k]);
        if (columns[k]) columns[k]->push_back(list_[0]);
      }
    vertices_ = table_.width = element.count;
    table_.height = 1;
  }

  int vertex_index(double index, const Element& element, size_t i) const {
    if (index >= 0 && index < static_cast<double>(vertices_) && index <= std::numeric_limits<int>::max())
      return static_cast<int>(index);
    fail(element.name + " " + std::to_string(i) + " refers to a vertex that does not exist");
  }

  void read_faces(const Element& element) {
    for (size_t i = 0; i < element.count; ++i)
      for (const Property& property : element.properties) {
        read_property(property);
        if (!property.length || (property.name != "vertex_indices" && property.name != "vertex_index"))
          continue;
        for (size_t k = 2; k < list_.size(); ++k)
          table_.triangles.emplace_back(vertex_index(list_[0], element, i),
                                        vertex_index(list_[k - 1], element, i),
                                        vertex_index(list_[k], element, i));
      }
  }

  void read_grid(const Element& element) {
    if (grid_) fail("has two elements 'range_grid'");
    if (header_.columns == 0 || header_.rows == 0 || element.count % header_.columns != 0 ||
        element.count / header_.columns != header_.rows)
      fail("its range_grid has " + std::to_string(element.count) + " cells, but obj_info says num_cols " +
           std::to_string(header_.columns) + ", num_rows " + std::to_string(header_.rows));
    grid_.emplace();
    for (size_t i = 0; i < element.count; ++i) {
      if (element.properties.size() != 1 || !element.properties[0].length)
        fail("expected one list as the property of range_grid");
      read_property(element.properties[0]);
      if (list_.size() > 1) fail("range_grid " + std::to_string(i) + " holds more than one vertex");
      grid_->push_back(list_.empty() ? -1 : vertex_index(list_[0], element, i));
    }
  }

  uint16_t short_number(const Property& property) {
    read_property(property);
    if (property.length || !(list_[0] >= 0 && list_[0] <= 65535) || list_[0] != std::floor(list_[0]))
      fail("scan_share: expected whole numbers from 0 to 65535");
    return static_cast<uint16_t>(list_[0]);
  }

  void read_shares(const Element& element) {
    if (element.properties.size() != 2 || element.properties[0].name != "scan" ||
        element.properties[1].name != "parts" || !table_.sources.shares.empty())
      fail("expected one element 'scan_share' with the properties scan and parts");
    table_.sources.shares.reserve(element.count);
    for (size_t i = 0; i < element.count; ++i) {
      const uint16_t scan = short_number(element.properties[0]);
      table_.sources.shares.push_back({scan, short_number(element.properties[1])});
    }
  }

  void read_pose_covariance(const Element& element) {
    if (element.properties.size() != 1 || element.properties[0].length ||
        !table_.sources.pose_covariance.empty())
      fail("expected one element 'pose_covariance' with one number as its property");
    for (size_t i = 0; i < element.count; ++i) {
      read_property(element.properties[0]);
      table_.sources.pose_covariance.push_back(list_[0]);
    }
  }

  void read_other(const Element& element) {
    for (const Property& property : element.properties) {
      read_property(property);
      if (element.name != "camera" || property.length) continue;
      for (int axis = 0; axis < 3; ++axis) {
        const char letter = "xyz"[axis];
        if (property.name == std::string("view_p") + letter) table_.sensor_position[axis] = list_[0];
        for (int k = 0; k < 3; ++k)
          if (property.name == std::string{letter} + "_axis" + "xyz"[k])
            table_.sensor_axes(axis, k) = list_[0];
      }
      if (property.name == "viewportx") camera_size_[0] = list_[0];
      if (property.name == "viewporty") camera_size_[1] = list_[0];
    }
  }

  void spread_over_grid() {
    for (auto& [name, column] : table_.columns) {
      std::vector<double> spread(grid_->size(), std::numeric_limits<double>::quiet_NaN());
      for (size_t i = 0; i < spread.size(); ++i)
        if ((*grid_)[i] >= 0) spread[i] = column[static_cast<size_t>((*grid_)[i])];
      column = std::move(spread);
    }
    table_.triangles.clear();  // their vertices stand elsewhere now
    table_.width = header_.columns;
    table_.height = header_.rows;
  }

  const Header& header_;
  NumberReader numbers_;
  const std::filesystem::path& path_;
  PointTable table_;
  size_t vertices_ = 0;
  std::vector<double> list_;  ///< Of the property that was read last.
  std::optional<std::vector<int>> grid_;
  double camera_size_[2] = {0, 0};
};

}  // namespace

PointTable read_ply(const std::filesystem::path& path) {
  const std::string bytes = read_file(path);
  HeaderReader reader(bytes, path);
  const Header header = read_header(reader);
  return Body(header, reader.rest(), path).read();
}

}  // namespace gantry::internal
