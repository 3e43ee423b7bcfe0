#include <set>

#include "gantry/foundation/strict_yaml.h"
#include "gantry/inspection/datums.h"

namespace gantry {
namespace {

constexpr NumberRange kSize_mm{1e-3, 1e5};

Datum read_datum(StrictYaml& yaml) {
  Datum datum;
  datum.name = yaml.text("name");
  const std::string kind = yaml.choice("feature", {"plane", "cylinder", "point"});
  datum.kind = kind == "plane"      ? DatumKind::kPlane
               : kind == "cylinder" ? DatumKind::kCylinder
                                    : DatumKind::kPoint;
  datum.position_mm = yaml.vector3("position_mm");
  if (yaml.has("box_mm")) {
    if (yaml.has("radius_mm")) yaml.fail("box_mm", "give radius_mm or box_mm, not both");
    datum.box_mm = yaml.vector3("box_mm");
    if (!(datum.box_mm->minCoeff() >= kSize_mm.min)) yaml.fail("box_mm", "every size must be positive");
  } else {
    datum.radius_mm = yaml.number("radius_mm", kSize_mm);
  }
  if (yaml.has("normal")) {
    const Eigen::Vector3d normal = yaml.vector3("normal");
    if (normal.norm() < 1e-6) yaml.fail("normal", "expected a direction, found no length");
    datum.normal = normal.normalized();
  }
  yaml.finish();
  return datum;
}

}  // namespace

DatumSet read_datums(const std::filesystem::path& file) {
  StrictYaml yaml = StrictYaml::load(file);
  DatumSet set;
  set.name = yaml.text_or("name", file.stem().string());
  std::set<std::string> names;
  for (StrictYaml& entry : yaml.maps("datums")) {
    set.datums.push_back(read_datum(entry));
    if (!names.insert(set.datums.back().name).second) entry.fail("name", "another datum has this name");
  }
  yaml.finish();
  return set;
}

}  // namespace gantry
