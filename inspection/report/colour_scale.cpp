#include "report/colour_scale.h"

#include <Eigen/LU>
#include <algorithm>
#include <array>
#include <cmath>

namespace gantry::report {
namespace {

constexpr int kSteps = 512;

Eigen::Vector3f rgb(unsigned hex) {
  return Eigen::Vector3f(static_cast<float>(hex >> 16 & 255), static_cast<float>(hex >> 8 & 255),
                         static_cast<float>(hex & 255)) /
         255.0f;
}

float to_linear(float c) {
  return c <= 0.04045f ? c / 12.92f : std::pow((c + 0.055f) / 1.055f, 2.4f);
}
float to_srgb(float c) {
  c = std::clamp(c, 0.0f, 1.0f);
  return c <= 0.0031308f ? 12.92f * c : 1.055f * std::pow(c, 1 / 2.4f) - 0.055f;
}

Eigen::Matrix3f lms_from_rgb() {
  Eigen::Matrix3f m;
  m << 0.4122214708f, 0.5363325363f, 0.0514459929f,  //
      0.2119034982f, 0.6806995451f, 0.1073969566f,   //
      0.0883024619f, 0.2817188376f, 0.6299787005f;
  return m;
}

Eigen::Matrix3f lab_from_lms() {
  Eigen::Matrix3f m;
  m << 0.2104542553f, 0.7936177850f, -0.0040720468f,  //
      1.9779984951f, -2.4285922050f, 0.4505937099f,   //
      0.0259040371f, 0.7827717662f, -0.8086757660f;
  return m;
}

Eigen::Vector3f to_oklab(const Eigen::Vector3f& srgb) {
  const Eigen::Vector3f lms = lms_from_rgb() * srgb.unaryExpr(&to_linear);
  return lab_from_lms() * lms.unaryExpr([](float c) { return std::cbrt(c); });
}

Eigen::Vector3f from_oklab(const Eigen::Vector3f& lab) {
  const Eigen::Vector3f lms = (lab_from_lms().inverse() * lab).array().cube();
  return (lms_from_rgb().inverse() * lms).unaryExpr(&to_srgb);
}

}  // namespace

ColourScale::ColourScale(double tolerance_mm) : tolerance_mm_(tolerance_mm) {
  const std::array<Eigen::Vector3f, 9> stops = {
      to_oklab(rgb(0x2033a6)), to_oklab(rgb(0x2868d8)), to_oklab(rgb(0x35aee0)),
      to_oklab(rgb(0x57c4a6)), to_oklab(rgb(0x5fb85c)), to_oklab(rgb(0xb3cc4b)),
      to_oklab(rgb(0xf4c430)), to_oklab(rgb(0xec7426)), to_oklab(rgb(0xc3151d))};
  for (int i = 0; i <= kSteps; ++i) {
    const float at = static_cast<float>(i) / kSteps * (stops.size() - 1);
    const size_t stop = std::min<size_t>(static_cast<size_t>(at), stops.size() - 2);
    const float t = at - static_cast<float>(stop);
    table_.push_back(from_oklab((1 - t) * stops[stop] + t * stops[stop + 1]));
  }
}

const Eigen::Vector3f& ColourScale::operator()(double deviation_mm) const {
  const double t = std::clamp(0.5 + 0.5 * deviation_mm / limit_mm(), 0.0, 1.0);
  return table_[static_cast<size_t>(std::lround(t * kSteps))];
}

std::string hex(const Eigen::Vector3f& srgb) {
  static constexpr char kDigits[] = "0123456789abcdef";
  std::string text = "#";
  for (int k = 0; k < 3; ++k) {
    const auto byte = static_cast<unsigned>(std::lround(std::clamp(srgb[k], 0.0f, 1.0f) * 255));
    text += kDigits[byte >> 4];
    text += kDigits[byte & 15];
  }
  return text;
}

}  // namespace gantry::report
