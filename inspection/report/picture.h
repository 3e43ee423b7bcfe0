#pragma once

#include <string>
#include <vector>

#include "report/camera.h"
#include "report/renderer.h"

namespace gantry::report {

/// A rendered view with what is written on it.
struct Picture {
  /// The number of a defect at the end of a line from its place (pixels).
  struct Label {
    int defect;
    Eigen::Vector2f place, badge;
  };

  std::string name;
  Camera camera;
  std::string png;  ///< File bytes.
  std::vector<Label> labels;
  bool cross_hair = false;  ///< Marks the first label's place instead of a numbered badge.
};

/// Labels for the defects of which this view shows something, set apart from each other.
std::vector<Picture::Label> place_labels(const Camera& camera, const Rendering& rendering,
                                         const MeasuredSurface& measured, const std::vector<Defect>& defects);

/// The picture as inline SVG: image, labels, length bar and axes. `id` must be unique in the page.
std::string picture_svg(const Picture& picture, const std::string& id);

}  // namespace gantry::report
