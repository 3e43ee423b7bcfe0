#pragma once

#include <vector>

#include "defects/region_points.h"

namespace gantry::internal {

/// Sets `kind`, `words`, `face` and `face_words` of a defect whose figures are known, by the criteria that
/// DefectClass states (residue apart); of a hole that was not made also `extra_mm3`.
void classify(Defect& defect, const DefectScene& scene, const std::vector<size_t>& members);

}  // namespace gantry::internal
