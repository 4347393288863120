#include "tools/draw/gap_curves_svg.h"

#include <algorithm>
#include <array>
#include <cmath>

#include "src/base/formatted.h"
#include "tools/draw/svg_text.h"

namespace inceres::tools {
namespace {

using internal::Formatted;

constexpr double kPageWidth = 900.0;
constexpr double kPlotLeft = 90.0, kPlotTop = 60.0, kPlotWidth = 560.0, kPlotHeight = 380.0;
constexpr double kPageHeight = kPlotTop + kPlotHeight + 60.0;
constexpr double kLeastGap = 1e-6;  // what is closer is drawn there
constexpr std::array<double, 3> kGapLines = {1e-2, 1e-3, 1e-4};
constexpr std::array<const char*, 7> kCurveColors = {"#0b6e4f", "#c1440e", "#3a86c8", "#8d6e63",
                                                     "#7b2d8b", "#b58900", "#444444"};

// Logarithms of seconds to the right, of gaps upward.
struct GapScale {
  double first = 1e300, last = 0.0;  // seconds
  double largest = 1e-1;             // gap

  double X(double seconds) const {
    const double clamped = std::clamp(seconds, first, last);
    return kPlotLeft + kPlotWidth * std::log(clamped / first) / std::log(last / first);
  }
  double Y(double gap) const {
    const double clamped = std::clamp(gap, kLeastGap, largest);
    return kPlotTop + kPlotHeight * std::log(largest / clamped) / std::log(largest / kLeastGap);
  }
};

double GapOf(const CostSample& sample, double lowest_cost) {
  return (sample.cost - lowest_cost) / lowest_cost;
}

GapScale ChooseGapScale(double lowest_cost, const std::vector<GapCurve>& curves) {
  GapScale scale;
  for (const GapCurve& curve : curves) {
    for (const CostSample& sample : curve.trace) {
      if (sample.seconds > 0.0) {
        scale.first = std::min(scale.first, sample.seconds);
        scale.last = std::max(scale.last, sample.seconds);
      }
      if (sample.accepted) {
        scale.largest = std::max(scale.largest, GapOf(sample, lowest_cost));
      }
    }
  }
  scale.first = std::min(scale.first, 1.0);
  scale.last = std::max(scale.last, 1.01 * scale.first);
  return scale;
}

void AppendGapGrid(const GapScale& scale, std::string* svg) {
  *svg +=
      Formatted("<rect class=\"frame\" x=\"%.0f\" y=\"%.0f\" width=\"%.0f\" height=\"%.0f\"/>\n",
                kPlotLeft, kPlotTop, kPlotWidth, kPlotHeight);
  for (const double gap : kGapLines) {
    *svg += Formatted(
        "<path class=\"grid\" d=\"M%.0f %.1fh%.0f\"/><text class=\"tick\" x=\"%.0f\" "
        "y=\"%.1f\">%.0e</text>\n",
        kPlotLeft, scale.Y(gap), kPlotWidth, kPlotLeft - 8.0, scale.Y(gap) + 4.0, gap);
  }
  constexpr int kNumTicks = 4;
  for (int k = 0; k <= kNumTicks; ++k) {
    const double seconds = scale.first * std::pow(scale.last / scale.first, 1.0 * k / kNumTicks);
    *svg += Formatted("<text class=\"second\" x=\"%.1f\" y=\"%.0f\">%.3g s</text>\n",
                      scale.X(seconds), kPlotTop + kPlotHeight + 20.0, seconds);
  }
}

void AppendGapCurve(const GapScale& scale, double lowest_cost, const GapCurve& curve,
                    std::size_t index, std::string* svg) {
  std::string line;
  double x = kPlotLeft, y = scale.Y(scale.largest);
  for (const CostSample& sample : curve.trace) {
    if (!sample.accepted) {
      continue;
    }
    x = scale.X(sample.seconds);
    if (line.empty()) {
      y = scale.Y(GapOf(sample, lowest_cost));
      line += Formatted("M%.1f %.1f", x, y);
      continue;
    }
    y = std::max(y, scale.Y(GapOf(sample, lowest_cost)));  // the best state so far
    line += Formatted("H%.1fV%.1f", x, y);
  }
  const char* const color = kCurveColors[index % kCurveColors.size()];
  const std::string label = EscapeXml(curve.label);
  *svg += "<path class=\"curve\" data-label=\"" + label + "\" stroke=\"" + color + "\" d=\"" +
          line + "\"/>\n";
  *svg += Formatted("<text x=\"%.0f\" y=\"%.0f\" style=\"fill:%s\">", kPlotLeft + kPlotWidth + 14.0,
                    kPlotTop + 18.0 + 20.0 * static_cast<double>(index), color);
  *svg += label + "</text>\n";
}

}  // namespace

std::string GapCurvesSvg(const std::string& title, double lowest_cost,
                         const std::vector<GapCurve>& curves) {
  const GapScale scale = ChooseGapScale(lowest_cost, curves);
  std::string svg = "<?xml version=\"1.0\" encoding=\"UTF-8\"?>\n";
  svg += Formatted(
      "<svg xmlns=\"http://www.w3.org/2000/svg\" viewBox=\"0 0 %.0f %.0f\" width=\"%.0f\" "
      "height=\"%.0f\">\n",
      kPageWidth, kPageHeight, kPageWidth, kPageHeight);
  svg +=
      "<style>\n"
      "text{font:13px sans-serif;fill:#333} .title{font-size:16px}\n"
      ".tick{font-size:12px;text-anchor:end} .second{font-size:12px;text-anchor:middle}\n"
      ".frame{fill:#fbfbf8;stroke:#ccc} .grid{stroke:#ddd;fill:none}\n"
      ".curve{stroke-width:2;fill:none}\n"
      "</style>\n";
  svg +=
      Formatted("<rect width=\"%.0f\" height=\"%.0f\" fill=\"#fff\"/>\n", kPageWidth, kPageHeight);
  svg += "<text class=\"title\" x=\"20\" y=\"32\">" + EscapeXml(title) + "</text>\n";
  AppendGapGrid(scale, &svg);
  for (std::size_t k = 0; k < curves.size(); ++k) {
    AppendGapCurve(scale, lowest_cost, curves[k], k, &svg);
  }
  svg += Formatted(
      "<text x=\"%.0f\" y=\"%.0f\">how far above the lowest cost, relative, over the "
      "seconds of the solve</text>\n</svg>\n",
      kPlotLeft, kPlotTop + kPlotHeight + 44.0);
  return svg;
}

}  // namespace inceres::tools
