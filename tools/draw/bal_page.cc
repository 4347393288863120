#include "tools/draw/bal_page.h"

#include <cmath>
#include <cstddef>
#include <cstdio>
#include <utility>
#include <vector>

#include "src/base/formatted.h"
#include "tools/draw/cost_curve_svg.h"
#include "tools/draw/error_histogram.h"
#include "tools/draw/page_style.h"
#include "tools/draw/scene_view.h"
#include "tools/draw/svg_text.h"
#include "tools/problems/bal_ceres_problem.h"

namespace inceres::tools {
namespace {

using internal::Formatted;

const Eigen::Vector2d kTopPanel(560.0, 400.0);
const Eigen::Vector2d kSidePanel(560.0, 220.0);
constexpr double kGap = 12.0;
constexpr SceneLimits kLimits{8000, 1000};
constexpr std::size_t kBins = 40;

// A figure: words to read, and the number itself for programs.
std::string Figure(const std::string& id, double number, const char* format) {
  std::string words;
  if (std::isfinite(number)) {
    char text[64];
    std::snprintf(text, sizeof(text), format, number);
    words = text;
  } else {
    words = "not finite";
  }
  std::string html;
  html += Formatted("<span id=\"%s\" data-value=\"%.17g\">%s</span>", id.c_str(), number,
                    words.c_str());
  return html;
}

std::string Figure(const std::string& id, std::size_t number) {
  return Figure(id, static_cast<double>(number), "%.0f");
}

std::string Tile(const std::string& big, const std::string& small) {
  return "<div class=\"tile\"><p class=\"big\">" + big + "</p><p>" + small + "</p></div>\n";
}

std::string Header(const BalPageContent& content) {
  const BalProblem& bal = *content.before;
  return "<header><h1>" + EscapeXml(content.title) + "</h1><p>" +
         Figure("num_cameras", static_cast<std::size_t>(bal.num_cameras)) + " cameras, " +
         Figure("num_points", static_cast<std::size_t>(bal.num_points)) + " points, " +
         Figure("num_observations", bal.observations.size()) + " observations; solved by " +
         EscapeXml(content.solver) + "</p></header>\n";
}

std::string Tiles(const BalPageContent& content) {
  const SolveRecord& record = *content.record;
  return "<section class=\"tiles\">\n" +
         Tile(Figure("final_rms_pixels", RmsReprojectionError(*content.after), "%.4g") + " px",
              "reprojection error, root mean square; before " +
                  Figure("initial_rms_pixels", RmsReprojectionError(*content.before), "%.4g") +
                  " px") +
         Tile(Figure("final_cost", record.final_cost, "%.6g"),
              "cost; before " + Figure("initial_cost", record.initial_cost, "%.6g")) +
         Tile(Figure("iterations", static_cast<std::size_t>(record.iterations)),
              "iterations; " + EscapeXml(record.termination)) +
         Tile(Figure("seconds", record.seconds, "%.3g") + " s", "the whole solve call") +
         "</section>\n";
}

// One panel of a scene, with its upper left corner at `top`.
void AppendPanel(const std::string& id, const SceneView& view, const BalProblem& bal, double top,
                 std::string* svg) {
  *svg += Formatted(
      "<g id=\"%s\" transform=\"translate(0 %.0f)\"><clipPath id=\"clip_%s\"><rect "
      "width=\"%.0f\" height=\"%.0f\"/></clipPath>"
      "<rect class=\"frame\" width=\"%.0f\" height=\"%.0f\"/>\n",
      id.c_str(), top, id.c_str(), view.panel.x(), view.panel.y(), view.panel.x(), view.panel.y());
  *svg += "<g clip-path=\"url(#clip_" + id + ")\">\n" + SceneSvg(view, bal, kLimits) + "</g></g>\n";
}

std::string SceneCard(const char* when, const char* title, const SceneViews& views,
                      const BalProblem& bal) {
  std::string svg;
  svg += Formatted(
      "<svg viewBox=\"-1 -1 %.0f %.0f\" role=\"img\" aria-label=\"Cameras and points %s, "
      "from above and from the side\">\n",
      kTopPanel.x() + 2.0, kTopPanel.y() + kGap + kSidePanel.y() + 2.0, when);
  AppendPanel(std::string(when) + "_top", views.top, bal, 0.0, &svg);
  AppendPanel(std::string(when) + "_side", views.side, bal, kTopPanel.y() + kGap, &svg);
  return std::string("<section class=\"card half\" id=\"") + when + "\"><h2>" + title +
         "</h2><figure>" + svg +
         "</svg><figcaption>From above, and below that from the side, at the same scale. Orange: "
         "cameras, open where they look.</figcaption></figure></section>\n";
}

std::string EveryNth(std::size_t count, std::size_t limit, const char* what) {
  const std::size_t stride = DrawnStride(count, limit);
  return stride > 1
             ? " Of the " + std::string(what) + " one of " + std::to_string(stride) + " is drawn."
             : "";
}

std::string Scenes(const BalPageContent& content) {
  const BalProblem& after = *content.after;
  const SceneViews views = ChooseViews(after, kTopPanel, kSidePanel);
  const std::string thinned =
      EveryNth(static_cast<std::size_t>(after.num_points), kLimits.points, "points") +
      EveryNth(static_cast<std::size_t>(after.num_cameras), kLimits.cameras, "cameras");
  return SceneCard("before", "Before", views, *content.before) +
         SceneCard("after", "After", views, after) +
         (thinned.empty() ? ""
                          : "<p class=\"note\" id=\"thinned\">" + thinned.substr(1) + "</p>\n");
}

// The same picture for a wide and a narrow screen; the style shows one of them.
template <typename Shapes>
std::string TwoWidths(const char* label, double left, const Shapes& shapes) {
  std::string html = "<figure>";
  for (const auto& [style, width] : {std::pair("wide", 500.0), std::pair("narrow", 320.0)}) {
    html +=
        Formatted("<svg class=\"%s\" viewBox=\"0 0 %.0f 260\" role=\"img\" aria-label=\"%s\">\n",
                  style, width, label);
    html += shapes(SvgFrame{left, 10.0, width - left - 12.0, 225.0}, width) + "</svg>";
  }
  return html + "</figure>";
}

std::string CostCard(const SolveRecord& record) {
  return "<section class=\"card half\" id=\"cost\"><h2>Cost</h2><p class=\"note\">Over the "
         "iterations, on a logarithmic scale. Hollow: steps that were rejected.</p>" +
         TwoWidths(
             "Cost over the iterations", 78.0,
             [&](const SvgFrame& frame, double) { return CostCurveShapes(record.trace, frame); }) +
         "</section>\n";
}

std::string SpreadRow(const char* when, const ErrorSpread& spread) {
  const auto cell = [&](const char* name, double value) {
    return "<td class=\"number\">" + Figure(std::string(name) + "_error_" + when, value, "%.3g") +
           "</td>";
  };
  return std::string("<tr><th><span class=\"key ") + when + "\">" + when + "</span></th>" +
         cell("median", spread.median) + cell("p95", spread.p95) + cell("max", spread.max) +
         "</tr>";
}

std::string HistogramCard(const BalPageContent& content) {
  const std::vector<double> before = ReprojectionErrors(*content.before);
  const std::vector<double> after = ReprojectionErrors(*content.after);
  const ErrorHistogram histogram = SortErrors(before, after, kBins);
  const std::string not_finite =
      histogram.not_finite > 0 ? "<p class=\"note\">" + Figure("not_finite", histogram.not_finite) +
                                     " errors are not finite, and not among these.</p>"
                               : "";
  return "<section class=\"card half\" id=\"errors\"><h2>Reprojection errors</h2><p "
         "class=\"note\">How many observations have which, in pixels: upward after the solve, "
         "downward before.</p>" +
         TwoWidths("Histogram of the reprojection errors before and after", 12.0,
                   [&](const SvgFrame& frame, double width) {
                     return ErrorHistogramShapes(histogram, frame, width > 400.0 ? 6 : 4);
                   }) +
         "<table><tr><th>pixels</th><th class=\"number\">median</th><th class=\"number\">95 "
         "%</th><th class=\"number\">largest</th></tr>" +
         SpreadRow("before", SpreadOf(before)) + SpreadRow("after", SpreadOf(after)) + "</table>" +
         not_finite + "</section>\n";
}

std::string Row(const std::string& name, const std::string& value) {
  return "<tr><th>" + EscapeXml(name) + "</th><td>" + EscapeXml(value) + "</td></tr>\n";
}

std::string FactsCard(const BalPageContent& content) {
  const SolveRecord& record = *content.record;
  std::string rows = Row("solver", content.solver) + Row("linear solver", record.linear_solver) +
                     Row("loss", content.robust) +
                     Row("threads", std::to_string(content.num_threads)) +
                     Row("end", record.termination + ": " + record.message);
  for (const auto& [stage, seconds] : record.stage_seconds) {
    std::string text;
    text += Formatted("%.4g ms", 1e3 * seconds);
    rows += Row("time of " + stage, text);
  }
  for (const auto& [name, count] : record.work) {
    rows += Row(name, std::to_string(count));
  }
  for (const std::string& option : record.options_without_effect) {
    rows += Row("without effect", option);
  }
  return "<section class=\"card\" id=\"facts\"><h2>How it was solved</h2><div class=\"scroll\">"
         "<table>" +
         rows + "</table></div></section>\n";
}

}  // namespace

std::string BalPageHtml(const BalPageContent& content) {
  return "<!DOCTYPE html>\n<html lang=\"en\"><head><meta charset=\"utf-8\"><meta "
         "name=\"viewport\" content=\"width=device-width, initial-scale=1\"><link rel=\"icon\" "
         "href=\"data:,\"><title>" +
         EscapeXml(content.title) + "</title><style>" + kPageStyle +
         "</style></head>\n<body><main>\n" + Header(content) + Tiles(content) + Scenes(content) +
         CostCard(*content.record) + HistogramCard(content) + FactsCard(content) +
         "</main></body></html>\n";
}

}  // namespace inceres::tools
