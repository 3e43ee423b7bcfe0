#pragma once

#include <cstdint>
#include <string>
#include <string_view>
#include <vector>

namespace gantry::report {

/// A picture with straight (not premultiplied) alpha, 8 bits a channel, row by row from the top.
struct Image {
  int width = 0;
  int height = 0;
  std::vector<uint8_t> rgba;  ///< 4 * width * height bytes.
};

/// The picture as the bytes of a PNG file.
std::string png(const Image& image);
/// RFC 4648, with padding.
std::string base64(std::string_view bytes);

}  // namespace gantry::report
