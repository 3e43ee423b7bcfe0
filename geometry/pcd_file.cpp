// PCD, as the Point Cloud Library documents it ("The PCD (Point Cloud Data) file format", version 0.7):
// ascii, binary, and binary_compressed (LZF, one field after the other).

#include <cmath>
#include <optional>

#include "gantry/foundation/error.h"
#include "number_reader.h"
#include "point_table.h"

namespace gantry::internal {
namespace {

struct Field {
  std::string name;
  NumberType type;
  size_t count = 1;  ///< Numbers of this field in each point.

  size_t bytes() const { return type.bytes * count; }
};

struct Header {
  std::vector<Field> fields;
  size_t width = 0, height = 1;
  std::optional<size_t> points;
  std::string data;
};

constexpr size_t kMostFields = 1000, kMostCount = 100'000;

void read_sizes(const HeaderReader& reader, const std::vector<std::string>& words, Header& header) {
  if (words.size() != header.fields.size() + 1)
    reader.fail("expected " + std::to_string(header.fields.size()) + " entries behind '" + words[0] +
                "', one for each of FIELDS, found " + std::to_string(words.size() - 1));
  for (size_t i = 0; i < header.fields.size(); ++i) {
    Field& field = header.fields[i];
    if (words[0] == "SIZE") {
      field.type.bytes = reader.count(words, i + 1);
    } else if (words[0] == "COUNT") {
      field.count = reader.count(words, i + 1);
    } else if (words[i + 1] == "F" || words[i + 1] == "I" || words[i + 1] == "U") {
      field.type.kind = words[i + 1] == "F"   ? NumberKind::kFloat
                        : words[i + 1] == "I" ? NumberKind::kSigned
                                              : NumberKind::kUnsigned;
    } else {
      reader.fail("expected TYPE F, I or U, found '" + words[i + 1] + "'");
    }
  }
}

void check(const HeaderReader& reader, const Header& header) {
  if (header.fields.empty()) reader.fail("its header has no FIELDS");
  for (const Field& field : header.fields) {
    const size_t size = field.type.bytes;
    const bool known =
        size == 4 || size == 8 || (field.type.kind != NumberKind::kFloat && (size == 1 || size == 2));
    if (!known) reader.fail("field '" + field.name + "' has an impossible SIZE " + std::to_string(size));
    if (field.count < 1 || field.count > kMostCount)
      reader.fail("field '" + field.name + "' has an impossible COUNT " + std::to_string(field.count));
  }
  if (header.height != 0 && header.width > SIZE_MAX / header.height)
    reader.fail("WIDTH times HEIGHT is too large");
  if (header.points && *header.points != header.width * header.height)
    reader.fail("POINTS is " + std::to_string(*header.points) + ", but WIDTH times HEIGHT is " +
                std::to_string(header.width * header.height));
}

Header read_header(HeaderReader& reader, PointTable& table) {
  Header header;
  while (header.data.empty()) {
    const std::vector<std::string> words = reader.next_line();
    if (words[0] == "FIELDS" || words[0] == "COLUMNS") {
      if (words.size() > kMostFields) reader.fail("more than " + std::to_string(kMostFields) + " fields");
      header.fields.clear();
      for (size_t i = 1; i < words.size(); ++i) header.fields.push_back({words[i], {}, 1});
    } else if (words[0] == "SIZE" || words[0] == "TYPE" || words[0] == "COUNT") {
      read_sizes(reader, words, header);
    } else if (words[0] == "WIDTH") {
      header.width = reader.count(words, 1);
    } else if (words[0] == "HEIGHT") {
      header.height = reader.count(words, 1);
    } else if (words[0] == "POINTS") {
      header.points = reader.count(words, 1);
    } else if (words[0] == "VIEWPOINT") {
      for (int k = 0; k < 3; ++k) table.sensor_position[k] = reader.number(words, static_cast<size_t>(k) + 1);
      const Eigen::Quaterniond q(reader.number(words, 4), reader.number(words, 5), reader.number(words, 6),
                                 reader.number(words, 7));
      if (!(std::abs(q.norm() - 1) < 1e-3)) reader.fail("its VIEWPOINT is not a rigid pose");
      table.sensor_axes = q.toRotationMatrix();
    } else if (words[0] == "DATA") {
      header.data = words.size() > 1 ? words[1] : "nothing";
    } else if (words[0] != "VERSION") {
      reader.fail("is no PCD file, or its header is broken: unknown word '" + words[0] + "'");
    }
  }
  check(reader, header);
  return header;
}

/// LZF (Marc Lehmann's LibLZF): a byte below 32 announces that many literal bytes and one more; any other
/// one a copy of 3 to 264 bytes from up to 8192 bytes before.
std::string decompressed(std::string_view packed, size_t size, const std::filesystem::path& path) {
  const auto broken = [&]() -> InputError {
    return InputError(path.string() + ": its compressed data is broken");
  };
  std::string out;
  size_t at = 0;
  const auto next = [&] {
    if (at == packed.size()) throw broken();
    return static_cast<size_t>(static_cast<uint8_t>(packed[at++]));
  };
  while (at < packed.size() && out.size() <= size) {
    const size_t control = next();
    if (control < 32) {
      if (packed.size() - at < control + 1) throw broken();
      out.append(packed.substr(at, control + 1));
      at += control + 1;
      continue;
    }
    size_t length = control >> 5;
    if (length == 7) length += next();
    const size_t distance = ((control & 0x1f) << 8 | next()) + 1;
    if (distance > out.size()) throw broken();
    for (length += 2; length > 0; --length) out.push_back(out[out.size() - distance]);  // may overlap
  }
  if (out.size() != size) throw broken();
  return out;
}

class Body {
 public:
  Body(const Header& header, std::string_view bytes, PointTable& table, const std::filesystem::path& path)
      : header_(header), bytes_(bytes), table_(table), path_(path), count_(header.width * header.height) {
    for (const Field& field : header.fields) {
      columns_.push_back(column_for(table_, field.name));
      if (columns_.back() && field.count != 1)
        throw InputError(path.string() + ": field '" + field.name + "' has COUNT " +
                         std::to_string(field.count));
      for (size_t i = 0; columns_.back() && i + 1 < columns_.size(); ++i)
        if (columns_[i] == columns_.back())
          throw InputError(path.string() + ": field '" + field.name + "' is given twice");
      point_bytes_ += field.bytes();
      numbers_ += field.count;
    }
  }

  void read() {
    if (count_ == 0) throw InputError(path_.string() + ": holds no points");
    if (header_.data == "ascii") {
      NumberReader reader(bytes_, Encoding::kAscii, path_);
      reader.require_room(count_, 2 * numbers_, "points");
      set_aside();
      read_ascii(reader);
    } else if (header_.data == "binary") {
      NumberReader(bytes_, Encoding::kLittleEndian, path_).require_room(count_, point_bytes_, "points");
      set_aside();
      read_binary(bytes_);
    } else if (header_.data == "binary_compressed") {
      read_compressed();
    } else {
      throw InputError(path_.string() + ": expected DATA ascii, binary or binary_compressed, found '" +
                       header_.data + "'");
    }
    table_.width = header_.width;
    table_.height = header_.height;
  }

 private:
  /// Only once the body was found to be long enough.
  void set_aside() {
    for (std::vector<double>* column : columns_)
      if (column) column->resize(count_);
  }

  void read_ascii(NumberReader& reader) {
    for (size_t i = 0; i < count_; ++i)
      for (size_t f = 0; f < columns_.size(); ++f)
        for (size_t k = 0; k < header_.fields[f].count; ++k) {
          const double value = reader.next(header_.fields[f].type);
          if (columns_[f]) (*columns_[f])[i] = value;
        }
  }

  void read_binary(std::string_view bytes) {
    size_t offset = 0;
    for (size_t f = 0; f < columns_.size(); ++f) {
      read_column(f, bytes.substr(offset), point_bytes_);
      offset += header_.fields[f].bytes();
    }
  }

  void read_compressed() {
    if (bytes_.size() < 8) throw InputError(path_.string() + ": is truncated");
    const NumberType size_type{NumberKind::kUnsigned, 4};
    const auto packed_size = static_cast<size_t>(decode_number(bytes_.data(), size_type, false));
    const auto size = static_cast<size_t>(decode_number(bytes_.data() + 4, size_type, false));
    if (point_bytes_ == 0 || size % point_bytes_ != 0 || size / point_bytes_ != count_)
      throw InputError(path_.string() + ": " + std::to_string(count_) + " points of " +
                       std::to_string(point_bytes_) + " bytes announced, but its compressed data has " +
                       std::to_string(size) + " bytes");
    if (packed_size > bytes_.size() - 8)
      throw InputError(path_.string() + ": is truncated: " + std::to_string(packed_size) +
                       " compressed bytes announced, " + std::to_string(bytes_.size() - 8) + " there");
    const std::string bytes = decompressed(bytes_.substr(8, packed_size), size, path_);
    set_aside();
    size_t offset = 0;
    for (size_t f = 0; f < columns_.size(); ++f) {
      read_column(f, std::string_view(bytes).substr(offset), header_.fields[f].bytes());
      offset += header_.fields[f].bytes() * count_;
    }
  }

  void read_column(size_t field, std::string_view bytes, size_t step) {
    if (!columns_[field]) return;
    for (size_t i = 0; i < count_; ++i)
      (*columns_[field])[i] = decode_number(bytes.data() + i * step, header_.fields[field].type, false);
  }

  const Header& header_;
  std::string_view bytes_;
  PointTable& table_;
  const std::filesystem::path& path_;
  size_t count_;
  size_t point_bytes_ = 0, numbers_ = 0;
  std::vector<std::vector<double>*> columns_;  ///< For each field; null: not kept.
};

}  // namespace

PointTable read_pcd(const std::filesystem::path& path) {
  const std::string bytes = read_file(path);
  HeaderReader reader(bytes, path);
  PointTable table;
  const Header header = read_header(reader, table);
  Body(header, reader.rest(), table, path).read();
  return table;
}

}  // namespace gantry::internal
