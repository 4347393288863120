#include "tools/draw/cost_curve_svg.h"

#include <algorithm>
#include <cmath>
#include <cstddef>

#include "src/base/formatted.h"

namespace inceres::tools {
namespace {

using internal::Formatted;

// Positions in the cost curve: iterations to the right, logarithm of the cost upward.
struct CurveScale {
  SvgFrame frame;
  double low;   // log10
  double high;  // log10
  std::size_t last_iteration;

  double X(std::size_t iteration) const {
    return frame.left + frame.width * static_cast<double>(iteration) /
                            static_cast<double>(std::max<std::size_t>(1, last_iteration));
  }
  double Y(double cost) const {
    const double clamped = std::clamp(std::log10(std::max(cost, 1e-300)), low, high);
    return frame.top + frame.height * (high - clamped) / (high - low);
  }
};

CurveScale ChooseScale(const std::vector<CostSample>& trace, const SvgFrame& frame) {
  double low = 300.0;
  double high = -300.0;
  for (const CostSample& sample : trace) {
    if (sample.accepted) {
      const double exponent = std::log10(std::max(sample.cost, 1e-300));
      low = std::min(low, exponent);
      high = std::max(high, exponent);
    }
  }
  const double margin = std::max(0.05 * (high - low), 1e-3);
  return {frame, low - margin, high + margin, trace.empty() ? 0 : trace.size() - 1};
}

}  // namespace

std::string CostCurveShapes(const std::vector<CostSample>& trace, const SvgFrame& frame) {
  const CurveScale scale = ChooseScale(trace, frame);
  std::string svg;
  constexpr int kLines = 4;
  for (int k = 0; k <= kLines; ++k) {
    const double cost = std::pow(10.0, scale.low + (scale.high - scale.low) * k / kLines);
    svg += Formatted(
        "<path class=\"grid\" d=\"M%.0f %.1fH%.0f\"/><text class=\"tick\" x=\"%.0f\" "
        "y=\"%.1f\">%.4g</text>\n",
        frame.left, scale.Y(cost), frame.left + frame.width, frame.left - 8.0, scale.Y(cost) + 4.0,
        cost);
  }
  std::string line;
  std::string dots;
  for (std::size_t i = 0; i < trace.size(); ++i) {
    const double x = scale.X(i);
    const double y = scale.Y(trace[i].cost);
    if (trace[i].accepted) {
      line += Formatted("%s%.1f %.1f", line.empty() ? "M" : "L", x, y);
    }
    dots += Formatted("<circle class=\"%s\" cx=\"%.1f\" cy=\"%.1f\" r=\"3\"/>\n",
                      trace[i].accepted ? "accepted" : "rejected", x, y);
  }
  return svg + "<path class=\"curve\" d=\"" + line + "\"/>\n" + dots;
}

std::string CostCurveSvg(const std::vector<CostSample>& trace, const SvgFrame& frame) {
  std::string svg = "<g id=\"cost\">\n" + CostCurveShapes(trace, frame);
  svg += Formatted(
      "<text x=\"%.0f\" y=\"%.0f\">cost (logarithmic) over %zu iterations; hollow: "
      "rejected steps</text>\n</g>\n",
      frame.left, frame.top + frame.height + 30.0,
      trace.empty() ? std::size_t{0} : trace.size() - 1);
  return svg;
}

}  // namespace inceres::tools
