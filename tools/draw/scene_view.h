#pragma once

#include <cstddef>
#include <string>

#include <Eigen/Core>

#include "inceres/io/bal.h"

namespace inceres::tools {

/// From the world to the coordinates of a panel, x to the right and y down.
struct SceneView {
  Eigen::Matrix<double, 2, 3> axes;  ///< rows: to the right and up in the picture
  Eigen::Vector2d middle;            ///< of the panel, in units of the world
  double scale = 1.0;                ///< picture units per world unit
  Eigen::Vector2d panel;             ///< width and height

  Eigen::Vector2d Apply(const Eigen::Vector3d& X) const;
};

/// A scene from above and from the side: the same scale, the same coordinate to the right.
struct SceneViews {
  SceneView top;
  SceneView side;
};

/// The views of a scene that show most of it: all cameras, nine tenths of the points. "Above" is
/// the mean of the cameras' own up directions; to the right is the long side of the cameras' path.
/// Give both panels the same width. Requires bal.Validate().ok(), cameras and points.
SceneViews ChooseViews(const BalProblem& bal, const Eigen::Vector2d& top_panel,
                       const Eigen::Vector2d& side_panel);

/// The view from above alone, as large as its panel allows.
SceneView ChooseTopView(const BalProblem& bal, const Eigen::Vector2d& panel);

/// Of more points and cameras than this every so many-th is drawn.
struct SceneLimits {
  std::size_t points = 20000;
  std::size_t cameras = static_cast<std::size_t>(-1);
};

/// 1, or the step from one drawn to the next that keeps to the limit.
std::size_t DrawnStride(std::size_t count, std::size_t limit);

/// The scene in a panel whose upper left corner is the origin: a <path class="points">, which
/// leaves out those outside, and for each camera a <path class="camera">, a wedge that opens in the
/// direction it looks. Clip it.
std::string SceneSvg(const SceneView& view, const BalProblem& bal, const SceneLimits& limits);

}  // namespace inceres::tools
