#include "tools/draw/bal_picture.h"

#include "src/base/formatted.h"
#include "tools/draw/cost_curve_svg.h"
#include "tools/draw/scene_view.h"
#include "tools/draw/svg_text.h"
#include "tools/problems/bal_ceres_problem.h"

namespace inceres::tools {
namespace {

using internal::Formatted;

constexpr double kPanel = 580.0;  // side of a view
constexpr double kMargin = 20.0;
constexpr double kTop = 70.0;  // below the title
constexpr double kCurveTop = kTop + kPanel + 60.0;
constexpr double kCurveHeight = 220.0;
constexpr double kCurveLeft = 110.0;
constexpr double kWidth = 2.0 * kPanel + 3.0 * kMargin;
constexpr double kHeight = kCurveTop + kCurveHeight + 50.0;

void AppendPanel(const char* id, double left, const SceneView& view, const BalProblem& bal,
                 std::string* svg) {
  *svg += Formatted(
      "<g id=\"%s\" transform=\"translate(%.0f %.0f)\">\n<rect class=\"frame\" "
      "width=\"%.0f\" height=\"%.0f\"/>\n",
      id, left, kTop, kPanel, kPanel);
  *svg += "<g clip-path=\"url(#panel)\">\n";
  *svg += SceneSvg(view, bal, SceneLimits());
  *svg += Formatted("</g>\n<text x=\"12\" y=\"26\">%s: %.4g px RMS</text>\n</g>\n", id,
                    RmsReprojectionError(bal));
}

}  // namespace

std::string BalPictureSvg(const std::string& title, const BalProblem& before,
                          const BalProblem& after, const std::vector<CostSample>& trace) {
  std::string svg = "<?xml version=\"1.0\" encoding=\"UTF-8\"?>\n";
  svg += Formatted(
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
  svg += Formatted("<clipPath id=\"panel\"><rect width=\"%.0f\" height=\"%.0f\"/></clipPath>\n",
                   kPanel, kPanel);
  svg += Formatted("<rect width=\"%.0f\" height=\"%.0f\" fill=\"#fff\"/>\n", kWidth, kHeight);
  svg += "<text class=\"title\" x=\"20\" y=\"42\">" + EscapeXml(title) + "</text>\n";
  const SceneView view = ChooseTopView(after, {kPanel, kPanel});
  AppendPanel("before", kMargin, view, before, &svg);
  AppendPanel("after", kPanel + 2.0 * kMargin, view, after, &svg);
  svg += CostCurveSvg(trace, {kCurveLeft, kCurveTop, kWidth - kMargin - kCurveLeft, kCurveHeight});
  return svg + "</svg>\n";
}

}  // namespace inceres::tools
