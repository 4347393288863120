#include "tools/draw/bal_picture.h"

#include <algorithm>
#include <cmath>

#include <Eigen/Core>
#include <Eigen/Eigenvalues>
#include <Eigen/Geometry>
#include <ceres/rotation.h>

#include "tools/draw/cost_curve_svg.h"
#include "tools/draw/svg_text.h"
#include "tools/problems/bal_ceres_problem.h"
#include "tools/problems/gauge.h"

namespace inceres::tools {
namespace {

using Eigen::Vector2d;
using Eigen::Vector3d;

constexpr double kPanel = 580.0;  // side of a view
constexpr double kMargin = 20.0;
constexpr double kTop = 70.0;  // below the title
constexpr double kCurveTop = kTop + kPanel + 60.0;
constexpr double kCurveHeight = 220.0;
constexpr double kCurveLeft = 110.0;
constexpr double kWidth = 2.0 * kPanel + 3.0 * kMargin;
constexpr double kHeight = kCurveTop + kCurveHeight + 50.0;
constexpr std::size_t kMaxPoints = 20000;

// A direction of the camera's frame in the world: Rᵀ d.
Vector3d InWorld(const BalProblem& bal, int camera, const Vector3d& direction) {
  const double* a = bal.CameraData(camera);
  const double inverse_rotation[3] = {-a[0], -a[1], -a[2]};
  Vector3d result;
  ceres::AngleAxisRotatePoint(inverse_rotation, direction.data(), result.data());
  return result;
}

// From the world to picture coordinates of a panel.
struct View {
  Eigen::Matrix<double, 2, 3> axes;  // rows: to the right and up in the picture
  Vector2d middle;
  double scale = 1.0;  // picture units per world unit

  Vector2d Apply(const Vector3d& X) const {
    const Vector2d p = scale * (axes * X - middle);
    return {0.5 * kPanel + p.x(), 0.5 * kPanel - p.y()};
  }
};

Vector3d UpDirection(const BalProblem& bal) {
  Vector3d up = Vector3d::Zero();
  for (int i = 0; i < bal.num_cameras; ++i) {
    up += InWorld(bal, i, Vector3d::UnitY());
  }
  return up.norm() > 0.0 ? Vector3d(up.normalized()) : Vector3d(Vector3d::UnitY());
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

// The frame of both panels: seen from above, the long side of the solved scene horizontal.
View ChooseView(const BalProblem& solved) {
  const SceneGeometry scene = GeometryOf(solved);
  const Vector3d up = UpDirection(solved);
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
  right = right.norm() > 1e-6 ? Vector3d(right.normalized()) : up.unitOrthogonal();

  View view;
  view.axes << right.transpose(), up.cross(right).transpose();
  const auto [left, right_end] = Range(scene, view.axes.row(0).transpose());
  const auto [bottom, top] = Range(scene, view.axes.row(1).transpose());
  view.middle = 0.5 * Vector2d(left + right_end, bottom + top);
  const double size = std::max({right_end - left, top - bottom, 1e-12});
  view.scale = 0.92 * kPanel / size;
  return view;
}

bool IsVisible(const Vector2d& p) {
  return p.minCoeff() >= 0.0 && p.maxCoeff() <= kPanel;
}

void AppendPoints(const View& view, const std::vector<Vector3d>& points, std::string* svg) {
  *svg += "<path class=\"points\" d=\"";
  const std::size_t stride =
      std::max<std::size_t>(1, (points.size() + kMaxPoints - 1) / kMaxPoints);
  for (std::size_t i = 0; i < points.size(); i += stride) {
    const Vector2d p = view.Apply(points[i]);
    if (IsVisible(p)) {
      AppendFormat(svg, "M%.1f %.1fh0", p.x(), p.y());
    }
  }
  *svg += "\"/>\n";
}

// A camera is a small wedge that opens in the direction it looks.
void AppendCamera(const View& view, const BalProblem& bal, int camera, const Vector3d& center,
                  std::string* svg) {
  const Vector2d apex = view.Apply(center).cwiseMax(-1e4).cwiseMin(1e4);
  Vector2d forward = view.axes * InWorld(bal, camera, -Vector3d::UnitZ());
  forward = forward.norm() > 1e-9 ? Vector2d(forward.normalized()) : Vector2d(0.0, 1.0);
  const Vector2d along(9.0 * forward.x(), -9.0 * forward.y());
  const Vector2d across(-0.45 * along.y(), 0.45 * along.x());
  const Vector2d a = apex + along + across;
  const Vector2d b = apex + along - across;
  AppendFormat(svg, "<path class=\"camera\" d=\"M%.1f %.1fL%.1f %.1fL%.1f %.1fz\"/>\n", apex.x(),
               apex.y(), a.x(), a.y(), b.x(), b.y());
}

void AppendPanel(const char* id, double left, const View& view, const BalProblem& bal,
                 std::string* svg) {
  const SceneGeometry scene = GeometryOf(bal);
  AppendFormat(svg,
               "<g id=\"%s\" transform=\"translate(%.0f %.0f)\">\n<rect class=\"frame\" "
               "width=\"%.0f\" height=\"%.0f\"/>\n",
               id, left, kTop, kPanel, kPanel);
  *svg += "<g clip-path=\"url(#panel)\">\n";
  AppendPoints(view, scene.points, svg);
  for (int i = 0; i < bal.num_cameras; ++i) {
    AppendCamera(view, bal, i, scene.centers[static_cast<std::size_t>(i)], svg);
  }
  AppendFormat(svg, "</g>\n<text x=\"12\" y=\"26\">%s: %.4g px RMS</text>\n</g>\n", id,
               RmsReprojectionError(bal));
}

}  // namespace

std::string BalPictureSvg(const std::string& title, const BalProblem& before,
                          const BalProblem& after, const std::vector<CostSample>& trace) {
  std::string svg = "<?xml version=\"1.0\" encoding=\"UTF-8\"?>\n";
  AppendFormat(&svg,
               "<svg xmlns=\"http://www.w3.org/2000/svg\" viewBox=\"0 0 %.0f %.0f\" width=\"%.0f\" "
               "height=\"%.0f\">\n",
               kWidth, kHeight, kWidth, kHeight);
  svg +=
      "<style>\n"
      "text{font:15px sans-serif;fill:#333} .title{font-size:20px} "
      ".tick{font-size:12px;text-anchor:end;fill:#666}\n"
      ".frame{fill:#fbfbf8;stroke:#ccc} "
      ".points{stroke:#5b7c99;stroke-width:1.4;stroke-linecap:round;stroke-opacity:.55;fill:none}\n"
      ".camera{fill:#d9541e;fill-opacity:.75;stroke:#8c3210;stroke-width:.6}\n"
      ".grid{stroke:#e4e4e0;fill:none} .curve{stroke:#d9541e;stroke-width:2;fill:none}\n"
      ".accepted{fill:#d9541e} .rejected{fill:#fff;stroke:#999}\n"
      "</style>\n";
  AppendFormat(&svg, "<clipPath id=\"panel\"><rect width=\"%.0f\" height=\"%.0f\"/></clipPath>\n",
               kPanel, kPanel);
  AppendFormat(&svg, "<rect width=\"%.0f\" height=\"%.0f\" fill=\"#fff\"/>\n", kWidth, kHeight);
  svg += "<text class=\"title\" x=\"20\" y=\"42\">" + EscapeXml(title) + "</text>\n";
  const View view = ChooseView(after);
  AppendPanel("before", kMargin, view, before, &svg);
  AppendPanel("after", kPanel + 2.0 * kMargin, view, after, &svg);
  svg += CostCurveSvg(trace, {kCurveLeft, kCurveTop, kWidth - kMargin - kCurveLeft, kCurveHeight});
  return svg + "</svg>\n";
}

}  // namespace inceres::tools
