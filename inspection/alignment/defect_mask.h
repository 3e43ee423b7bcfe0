#pragma once

#include <vector>

#include "alignment/samples.h"

namespace gantry::internal {

/// Samples in regions that lie off the model by more than noise does.
struct DefectMask {
  std::vector<unsigned char> masked;
  int regions = 0;
};

/// Residuals are averaged over neighbours on the same face, which noise survives by a small part only; the
/// scatter of these averages where `before` does not mask, correlated noise included, says what is
/// significant. A region grows from its significant samples while they lie out to the same side, and is
/// widened by a margin. Samples without a partner count as significant.
DefectMask find_defect_mask(const AlignmentSamples& samples, const std::vector<Pair>& pairs,
                            const std::vector<unsigned char>& before);

}  // namespace gantry::internal
