#include "report/viewer.h"

#include <algorithm>
#include <bit>
#include <cmath>
#include <cstring>
#include <nlohmann/json.hpp>

#include "report/image.h"

namespace gantry::report {
namespace {

using Json = nlohmann::ordered_json;

static_assert(std::endian::native == std::endian::little, "the view reads little-endian arrays");

constexpr int16_t kUnseen = -32768;
constexpr size_t kMostDiscs = 40000;
constexpr size_t kMostLabels = 24;  // more than this hide the part
constexpr int kColours = 256;

template <typename Number>
std::string packed(const std::vector<Number>& numbers) {
  return base64({reinterpret_cast<const char*>(numbers.data()), numbers.size() * sizeof(Number)});
}

Json vector3(const Eigen::Vector3f& v) {
  return Json{v.x(), v.y(), v.z()};
}

/// Numbers of both signs, the small ones in one byte: 7 bits a byte, the lowest first, the sign in bit 0.
void append_varint(std::vector<uint8_t>& bytes, int value) {
  auto rest = static_cast<uint32_t>(value) << 1 ^ static_cast<uint32_t>(value >> 31);
  for (; rest > 127; rest >>= 7) bytes.push_back(static_cast<uint8_t>(rest | 128));
  bytes.push_back(static_cast<uint8_t>(rest));
}

/// Values by whole steps, each list with a step of its own so that the largest value just fits.
class Steps {
 public:
  void include(float value) { largest_ = std::max(largest_, std::abs(value)); }
  double step(double most) const { return std::max(static_cast<double>(largest_), 1e-6) / most; }

 private:
  float largest_ = 0;
};

class Packer {
 public:
  Packer(const SurfaceModel& model, const MeasuredSurface& measured, const std::vector<Section>& sections) {
    for (const auto& v : model.vertices) include(v.position, v.deviation_mm, v.uncertainty_mm);
    for (const auto& s : measured.off_cad) include(s.position, s.deviation_mm, s.uncertainty_mm);
    for (const Section& section : sections)
      for (const auto& line : section.outline)
        for (const auto& p : line.points) box_.extend(section.in_space(p));
    if (box_.isEmpty()) box_.extend(Eigen::Vector3f::Zero());
    size_ = box_.sizes().cwiseMax(1e-3f);
    deviation_step_ = deviations_.step(32767);
    uncertainty_step_ = uncertainties_.step(65535);
  }

  void head(Json& json) const {
    json["low"] = vector3(box_.min());
    json["size"] = vector3(size_);
    json["deviation_step_mm"] = deviation_step_;
    json["uncertainty_step_mm"] = uncertainty_step_;
  }

  void append(std::vector<uint16_t>& out, const Eigen::Vector3f& position) const {
    for (int k = 0; k < 3; ++k)
      out.push_back(static_cast<uint16_t>(
          std::lround(std::clamp((position[k] - box_.min()[k]) / size_[k], 0.0f, 1.0f) * 65535)));
  }
  int16_t deviation(float mm) const { return static_cast<int16_t>(std::lround(mm / deviation_step_)); }
  uint16_t uncertainty(float mm) const {
    return std::isfinite(mm) ? static_cast<uint16_t>(std::lround(mm / uncertainty_step_)) : uint16_t{0};
  }

 private:
  void include(const Eigen::Vector3f& position, float deviation, float uncertainty) {
    box_.extend(position);
    deviations_.include(deviation);
    if (std::isfinite(uncertainty)) uncertainties_.include(uncertainty);
  }

  Eigen::AlignedBox3f box_;
  Eigen::Vector3f size_;
  Steps deviations_, uncertainties_;
  double deviation_step_, uncertainty_step_;
};

Json surface_json(const SurfaceModel& model, const Packer& packer) {
  std::vector<uint16_t> positions, uncertainties, defects, creases;
  std::vector<int16_t> deviations;
  std::vector<uint8_t> shares, corners;
  for (const auto& v : model.vertices) {
    packer.append(positions, v.position);
    deviations.push_back(packer.deviation(v.deviation_mm));
    uncertainties.push_back(packer.uncertainty(v.uncertainty_mm));
    defects.push_back(static_cast<uint16_t>(std::min(v.defect, 65535)));
    shares.push_back(static_cast<uint8_t>(v.seen ? std::lround(v.defect_share * 254) : 255));
  }
  int previous = 0;
  for (const auto& t : model.triangles)
    for (const int v : t) {
      append_varint(corners, v - previous);
      previous = v;
    }
  for (const auto& crease : model.creases)
    for (const auto& end : crease) packer.append(creases, end);
  return {{"vertices", model.vertices.size()},
          {"triangles", model.triangles.size()},
          {"positions", packed(positions)},
          {"deviations", packed(deviations)},
          {"uncertainties", packed(uncertainties)},
          {"defects", packed(defects)},
          {"shares", packed(shares)},
          {"corners", packed(corners)},
          {"creases", packed(creases)}};
}

/// Material beyond the CAD model.
Json discs_json(const MeasuredSurface& measured, const Packer& packer) {
  const size_t stride = measured.off_cad.size() / kMostDiscs + 1;
  std::vector<uint16_t> positions, uncertainties, defects;
  std::vector<int16_t> deviations;
  std::vector<int8_t> normals;
  for (size_t i = 0; i < measured.off_cad.size(); i += stride) {
    const Surfel& s = measured.off_cad[i];
    packer.append(positions, s.position);
    for (int k = 0; k < 3; ++k) normals.push_back(static_cast<int8_t>(std::lround(s.normal[k] * 127)));
    deviations.push_back(packer.deviation(s.deviation_mm));
    uncertainties.push_back(packer.uncertainty(s.uncertainty_mm));
    defects.push_back(static_cast<uint16_t>(std::min(s.defect, 65535)));
  }
  return {{"count", deviations.size()},
          {"radius_mm", measured.disc_mm * std::sqrt(static_cast<float>(stride))},
          {"positions", packed(positions)},
          {"normals", packed(normals)},
          {"deviations", packed(deviations)},
          {"uncertainties", packed(uncertainties)},
          {"defects", packed(defects)}};
}

Json section_json(const Section& section, const Packer& packer) {
  std::vector<uint16_t> ends;
  for (const auto& line : section.outline)
    for (size_t i = 1; i < line.points.size(); ++i) {
      packer.append(ends, section.in_space(line.points[i - 1]));
      packer.append(ends, section.in_space(line.points[i]));
    }
  return {{"name", std::string(1, section.letter)}, {"ends", packed(ends)}};
}

}  // namespace

std::string viewer_data(const SurfaceModel& model, const MeasuredSurface& measured,
                        const ColourScale& colours, const std::vector<Defect>& defects,
                        const std::vector<Section>& sections) {
  const Packer packer(model, measured, sections);
  Json json;
  packer.head(json);
  json["unseen"] = kUnseen;
  json["limit_mm"] = colours.limit_mm();
  std::vector<uint8_t> table;
  for (int i = 0; i < kColours; ++i) {
    const Eigen::Vector3f& colour = colours(colours.limit_mm() * (2.0 * i / (kColours - 1) - 1));
    for (int k = 0; k < 3; ++k) table.push_back(static_cast<uint8_t>(std::lround(colour[k] * 255)));
  }
  json["colours"] = packed(table);
  json["surface"] = surface_json(model, packer);
  json["discs"] = discs_json(measured, packer);
  json["sections"] = Json::array();
  for (const Section& section : sections) json["sections"].push_back(section_json(section, packer));
  json["defects"] = Json::array();
  for (size_t i = 0; i < std::min(defects.size(), kMostLabels); ++i)
    json["defects"].push_back({{"id", defects[i].id},
                               {"peak_mm", defects[i].peak_mm},
                               {"at", vector3(defects[i].peak_at_mm.cast<float>())},
                               {"normal", vector3(defects[i].normal.cast<float>())}});
  return json.dump();
}

}  // namespace gantry::report
