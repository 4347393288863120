#include "tools/draw/scene_view.h"

#include <algorithm>
#include <cmath>
#include <utility>
#include <vector>

#include <Eigen/Eigenvalues>
#include <Eigen/Geometry>
#include <ceres/rotation.h>

#include "src/base/formatted.h"
#include "tools/problems/bal_ceres_problem.h"
#include "tools/problems/gauge.h"

namespace inceres::tools {
namespace {

using internal::Formatted;

using Eigen::Vector2d;
using Eigen::Vector3d;

// A direction of the camera's frame in the world: Rᵀ d.
Vector3d InWorld(const BalProblem& bal, int camera, const Vector3d& direction) {
  const double* a = bal.CameraData(camera);
  const double inverse_rotation[3] = {-a[0], -a[1], -a[2]};
  Vector3d result;
  ceres::AngleAxisRotatePoint(inverse_rotation, direction.data(), result.data());
  return result;
}

Vector3d UpDirection(const BalProblem& bal) {
  Vector3d up = Vector3d::Zero();
  for (int i = 0; i < bal.num_cameras; ++i) {
    up += InWorld(bal, i, Vector3d::UnitY());
  }
  return up.norm() > 0.0 ? Vector3d(up.normalized()) : Vector3d(Vector3d::UnitY());
}

// The long side of the cameras' path, seen from above.
Vector3d RightDirection(const SceneGeometry& scene, const Vector3d& up) {
  Vector3d mean = Vector3d::Zero();
  for (const Vector3d& C : scene.centers) {
    mean += C / static_cast<double>(scene.centers.size());
  }
  Eigen::Matrix3d spread = Eigen::Matrix3d::Zero();
  const Eigen::Matrix3d flatten = Eigen::Matrix3d::Identity() - up * up.transpose();
  for (const Vector3d& C : scene.centers) {
    const Vector3d flat = flatten * (C - mean);
    spread += flat * flat.transpose();
  }
  Vector3d right =
      flatten * Eigen::SelfAdjointEigenSolver<Eigen::Matrix3d>(spread).eigenvectors().col(2);
  return right.norm() > 1e-6 ? Vector3d(right.normalized()) : up.unitOrthogonal();
}

// Coordinates along one axis between which most of the scene lies: all cameras, nine tenths of the
// points.
std::pair<double, double> Range(const SceneGeometry& scene, const Vector3d& axis) {
  std::vector<double> values;
  for (const Vector3d& X : scene.points) {
    values.push_back(axis.dot(X));
  }
  std::sort(values.begin(), values.end());
  const std::size_t cut = values.size() / 20;
  double low = values[cut];
  double high = values[values.size() - 1 - cut];
  for (const Vector3d& C : scene.centers) {
    low = std::min(low, axis.dot(C));
    high = std::max(high, axis.dot(C));
  }
  return {low, high};
}

// A view along two axes; its scale is for others to choose.
SceneView LookAlong(const SceneGeometry& scene, const Vector3d& right, const Vector3d& up,
                    const Vector2d& panel) {
  SceneView view;
  view.axes << right.transpose(), up.transpose();
  view.panel = panel;
  Vector2d size;
  for (int k = 0; k < 2; ++k) {
    const auto [low, high] = Range(scene, view.axes.row(k).transpose());
    view.middle[k] = 0.5 * (low + high);
    size[k] = std::max(high - low, 1e-12);
  }
  view.scale = 0.92 * panel.cwiseQuotient(size).minCoeff();
  return view;
}

bool IsVisible(const SceneView& view, const Vector2d& p) {
  return p.minCoeff() >= 0.0 && (view.panel - p).minCoeff() >= 0.0;
}

// A camera is a small wedge that opens in the direction it looks.
void AppendCamera(const SceneView& view, const BalProblem& bal, int camera, const Vector3d& center,
                  std::string* svg) {
  const Vector2d apex = view.Apply(center).cwiseMax(-1e4).cwiseMin(1e4);
  Vector2d forward = view.axes * InWorld(bal, camera, -Vector3d::UnitZ());
  forward = forward.norm() > 1e-9 ? Vector2d(forward.normalized()) : Vector2d(0.0, 1.0);
  const Vector2d along(9.0 * forward.x(), -9.0 * forward.y());
  const Vector2d across(-0.45 * along.y(), 0.45 * along.x());
  const Vector2d a = apex + along + across;
  const Vector2d b = apex + along - across;
  *svg += Formatted("<path class=\"camera\" d=\"M%.1f %.1fL%.1f %.1fL%.1f %.1fz\"/>\n", apex.x(),
                    apex.y(), a.x(), a.y(), b.x(), b.y());
}

}  // namespace

Vector2d SceneView::Apply(const Vector3d& X) const {
  const Vector2d p = scale * (axes * X - middle);
  return {0.5 * panel.x() + p.x(), 0.5 * panel.y() - p.y()};
}

SceneViews ChooseViews(const BalProblem& bal, const Vector2d& top_panel,
                       const Vector2d& side_panel) {
  const SceneGeometry scene = GeometryOf(bal);
  const Vector3d up = UpDirection(bal);
  const Vector3d right = RightDirection(scene, up);
  SceneViews views{LookAlong(scene, right, up.cross(right), top_panel),
                   LookAlong(scene, right, up, side_panel)};
  views.top.scale = views.side.scale = std::min(views.top.scale, views.side.scale);
  return views;
}

SceneView ChooseTopView(const BalProblem& bal, const Vector2d& panel) {
  const SceneGeometry scene = GeometryOf(bal);
  const Vector3d up = UpDirection(bal);
  const Vector3d right = RightDirection(scene, up);
  return LookAlong(scene, right, up.cross(right), panel);
}

std::size_t DrawnStride(std::size_t count, std::size_t limit) {
  return std::max<std::size_t>(1, count / limit + (count % limit > 0 ? 1 : 0));
}

std::string SceneSvg(const SceneView& view, const BalProblem& bal, const SceneLimits& limits) {
  const SceneGeometry scene = GeometryOf(bal);
  std::string svg = "<path class=\"points\" d=\"";
  const std::size_t point_stride = DrawnStride(scene.points.size(), limits.points);
  for (std::size_t i = 0; i < scene.points.size(); i += point_stride) {
    const Vector2d p = view.Apply(scene.points[i]);
    if (IsVisible(view, p)) {
      svg += Formatted("M%.1f %.1fh0", p.x(), p.y());
    }
  }
  svg += "\"/>\n";
  const std::size_t camera_stride = DrawnStride(scene.centers.size(), limits.cameras);
  for (std::size_t i = 0; i < scene.centers.size(); i += camera_stride) {
    AppendCamera(view, bal, static_cast<int>(i), scene.centers[i], &svg);
  }
  return svg;
}

}  // namespace inceres::tools
