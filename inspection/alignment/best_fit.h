#pragma once

#include "alignment/normal_equations.h"
#include "gantry/inspection/alignment.h"

namespace gantry::internal {

/// Covariance of the held motions and size of the free ones, both as twists in the CAD frame.
void state_uncertainty(const AlignmentSamples& samples, const std::vector<Pair>& pairs,
                       const std::vector<unsigned char>& masked, const NormalEquations& equations,
                       const FitFrame& frame, double patch_mm, AlignmentResult& result);

/// Edge of the patches that count as independent: about a hundred cover the model, more of a part with many
/// narrow faces.
double patch_edge_mm(const TriangleMesh& mesh);

}  // namespace gantry::internal
