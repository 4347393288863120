#include "tools/draw/pose_graph_picture.h"

#include <algorithm>
#include <array>
#include <cstddef>
#include <limits>
#include <utility>

#include "inceres/io/g2o_graph.h"
#include "src/base/formatted.h"
#include "tools/draw/page_style.h"
#include "tools/draw/svg_text.h"

namespace inceres::tools {
namespace {

using internal::Formatted;

constexpr double kSide = 560.0;  // of a panel
constexpr double kPanelGap = 20.0;
constexpr double kHead = 70.0;  // above the panels

struct Box {
  std::array<double, 3> low, high;
  double size(int k) const {
    return high[static_cast<std::size_t>(k)] - low[static_cast<std::size_t>(k)];
  }
  double middle(int k) const {
    return 0.5 * (high[static_cast<std::size_t>(k)] + low[static_cast<std::size_t>(k)]);
  }
};

Box BoxOf(const PoseGraph& graph) {
  Box box{};
  for (int k = 0; k < graph.dimension; ++k) {
    const auto axis = static_cast<std::size_t>(k);
    box.low[axis] = std::numeric_limits<double>::max();
    box.high[axis] = std::numeric_limits<double>::lowest();
    for (int i = 0; i < graph.NumVertices(); ++i) {
      box.low[axis] = std::min(box.low[axis], graph.PoseData(i)[k]);
      box.high[axis] = std::max(box.high[axis], graph.PoseData(i)[k]);
    }
  }
  return box;
}

// From the world to a panel.
struct PanelView {
  int right = 0, up = 1;  // axes of the world
  double middle_right = 0.0, middle_up = 0.0;
  double scale = 1.0;

  double X(const double* p) const { return 0.5 * kSide + scale * (p[right] - middle_right); }
  double Y(const double* p) const { return 0.5 * kSide - scale * (p[up] - middle_up); }
};

// The axes of the solved graph; a start that is larger is shown, up to twice as large.
PanelView ViewOf(const PoseGraph& before, const PoseGraph& after) {
  const Box solved = BoxOf(after), start = BoxOf(before);
  PanelView view;
  if (after.dimension == 3) {
    int thin = 0;
    for (int k = 1; k < 3; ++k) {
      thin = solved.size(k) < solved.size(thin) ? k : thin;
    }
    view.right = thin == 0 ? 1 : 0;
    view.up = thin == 2 ? 1 : 2;
  }
  view.middle_right = solved.middle(view.right);
  view.middle_up = solved.middle(view.up);
  const double side = std::max(solved.size(view.right), solved.size(view.up));
  const double wanted = std::max(start.size(view.right), start.size(view.up));
  const double shown = std::max(std::min(wanted, 2.0 * side), side);
  view.scale = shown > 0.0 ? 0.92 * kSide / shown : 1.0;
  return view;
}

// The edges of one kind as one path.
template <typename Wanted>
void AppendEdges(const char* style, const PanelView& view, const PoseGraph& graph,
                 const Wanted& wanted, std::string* svg) {
  *svg += Formatted("<path class=\"%s\" d=\"", style);
  int at = -1;  // where the pen is
  for (std::size_t i = 0; i < graph.edges.size(); ++i) {
    if (wanted(i)) {
      const double* a = graph.PoseData(graph.edges[i].from);
      const double* b = graph.PoseData(graph.edges[i].to);
      if (graph.edges[i].from != at) {
        *svg += Formatted("M%.1f %.1f", view.X(a), view.Y(a));
      }
      *svg += Formatted("L%.1f %.1f", view.X(b), view.Y(b));
      at = graph.edges[i].to;
    }
  }
  *svg += "\"/>\n";
}

void AppendGraphPanel(const char* id, double left, const PanelView& view, const PoseGraph& graph,
                      const std::vector<bool>& is_loop, const std::vector<bool>& is_outlier,
                      std::string* svg) {
  *svg += Formatted(
      "<g id=\"%s\" transform=\"translate(%.0f %.0f)\"><rect class=\"frame\" "
      "width=\"%.0f\" height=\"%.0f\"/><g clip-path=\"url(#panel)\">\n",
      id, left, kHead, kSide, kSide);
  AppendEdges(
      "outlier", view, graph, [&](std::size_t i) { return is_outlier[i]; }, svg);
  AppendEdges(
      "loop", view, graph, [&](std::size_t i) { return is_loop[i] && !is_outlier[i]; }, svg);
  AppendEdges(
      "odometry", view, graph, [&](std::size_t i) { return !is_loop[i] && !is_outlier[i]; }, svg);
  *svg += Formatted("</g><text x=\"12\" y=\"26\">%s</text></g>\n", id);
}

}  // namespace

std::string PoseGraphPictureSvg(const std::string& title, const PoseGraph& before,
                                const PoseGraph& after, const std::vector<bool>& is_outlier) {
  constexpr double kWidth = 2.0 * kSide + 3.0 * kPanelGap;
  constexpr double kHeight = kHead + kSide + kPanelGap;
  std::string svg;
  svg += Formatted(
      "<svg xmlns=\"http://www.w3.org/2000/svg\" viewBox=\"0 0 %.0f %.0f\" width=\"%.0f\" "
      "height=\"%.0f\">\n",
      kWidth, kHeight, kWidth, kHeight);
  svg +=
      "<style>text{font:15px sans-serif;fill:#333} .title{font-size:20px} "
      ".frame{fill:#fbfbf8;stroke:#ccc} path{fill:none;stroke-linecap:round}\n"
      ".odometry{stroke:#1f4e79;stroke-width:1.3} "
      ".loop{stroke:#5b9bd5;stroke-width:.6;stroke-opacity:.6} "
      ".outlier{stroke:#d0451b;stroke-width:.5;stroke-opacity:.35;stroke-dasharray:4 3}</style>\n";
  svg += Formatted(
      "<clipPath id=\"panel\"><rect width=\"%.0f\" height=\"%.0f\"/></clipPath>"
      "<rect width=\"%.0f\" height=\"%.0f\" fill=\"#fff\"/>\n",
      kSide, kSide, kWidth, kHeight);
  svg += "<text class=\"title\" x=\"20\" y=\"42\">" + EscapeXml(title) + "</text>\n";
  std::vector<bool> is_loop(after.edges.size(), false);
  for (const int edge : LoopEdges(after)) {
    is_loop[static_cast<std::size_t>(edge)] = true;
  }
  const PanelView view = ViewOf(before, after);
  AppendGraphPanel("before", kPanelGap, view, before, is_loop, is_outlier, &svg);
  AppendGraphPanel("after", kSide + 2.0 * kPanelGap, view, after, is_loop, is_outlier, &svg);
  return svg + "</svg>\n";
}

std::string PoseGraphPageHtml(const std::string& title, const std::string& svg,
                              const std::vector<std::pair<std::string, std::string>>& figures) {
  std::string html =
      "<!DOCTYPE html>\n<html lang=\"en\"><head><meta charset=\"utf-8\">"
      "<meta name=\"viewport\" content=\"width=device-width\"><title>" +
      EscapeXml(title) + "</title>\n<style>" + kPageStyle +
      "</style></head>\n<body><main><header><h1>" + EscapeXml(title) +
      "</h1></header>\n<section class=\"card\"><figure>" + svg +
      "<figcaption>Dark: odometry; light: loops; red: edges found to be "
      "wrong.</figcaption></figure></section>\n<section class=\"card\"><table>\n";
  for (const auto& [name, text] : figures) {
    html +=
        "<tr><th scope=\"row\">" + EscapeXml(name) + "</th><td>" + EscapeXml(text) + "</td></tr>\n";
  }
  return html + "</table></section></main></body></html>\n";
}

}  // namespace inceres::tools
