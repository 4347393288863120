#include "tools/draw/error_histogram.h"

#include <algorithm>
#include <cmath>
#include <iterator>
#include <utility>

#include "src/base/formatted.h"

namespace inceres::tools {
namespace {

using internal::Formatted;

constexpr double kSmallest = 1e-12;  // pixels: what an error of exactly 0 counts as

std::vector<double> Finite(const std::vector<double>& values) {
  std::vector<double> finite;
  std::copy_if(values.begin(), values.end(), std::back_inserter(finite),
               [](double value) { return std::isfinite(value); });
  return finite;
}

// The smallest and the largest edge.
std::pair<double, double> Bounds(const std::vector<double>& before,
                                 const std::vector<double>& after) {
  double low = HUGE_VAL;
  double high = 0.0;
  for (const std::vector<double>* values : {&before, &after}) {
    for (const double value : *values) {
      low = std::min(low, value);
      high = std::max(high, value);
    }
  }
  low = std::max({std::min(low, high), 1e-3 * SpreadOf(after).median, kSmallest});
  return {low, std::max(high, 1.01 * low)};
}

std::vector<std::size_t> Count(const std::vector<double>& values, const ErrorHistogram& histogram) {
  const std::vector<double>& edges = histogram.edges;
  std::vector<std::size_t> counts(edges.size() - 1);
  for (const double value : values) {
    const auto above = std::upper_bound(edges.begin() + 1, edges.end() - 1, value);
    ++counts[static_cast<std::size_t>(above - edges.begin() - 1)];
  }
  return counts;
}

// The bars of one sample from the middle of the frame, `sign` 1 for upward.
void AppendBars(const char* style, const std::vector<double>& edges,
                const std::vector<std::size_t>& counts, std::size_t largest, double sign,
                const SvgFrame& frame, std::string* svg) {
  const double middle = frame.top + 0.5 * frame.height;
  const double width = frame.width / static_cast<double>(counts.size());
  for (std::size_t k = 0; k < counts.size(); ++k) {
    const double height =
        0.5 * frame.height * static_cast<double>(counts[k]) / static_cast<double>(largest);
    if (counts[k] > 0) {
      *svg += Formatted(
          "<rect class=\"%s\" x=\"%.2f\" y=\"%.2f\" width=\"%.2f\" height=\"%.2f\">"
          "<title>%s: %zu of %.3g to %.3g px</title></rect>\n",
          style, frame.left + width * static_cast<double>(k) + 0.5,
          sign > 0.0 ? middle - height : middle, std::max(width - 1.0, 0.5), height, style,
          counts[k], edges[k], edges[k + 1]);
    }
  }
}

}  // namespace

ErrorSpread SpreadOf(const std::vector<double>& errors) {
  std::vector<double> sorted = Finite(errors);
  if (sorted.empty()) {
    return {};
  }
  std::sort(sorted.begin(), sorted.end());
  const auto at = [&](double share) {  // nearest rank
    const auto rank =
        static_cast<std::size_t>(std::ceil(share * static_cast<double>(sorted.size()) - 1e-9));
    return sorted[std::max<std::size_t>(rank, 1) - 1];
  };
  return {at(0.5), at(0.95), sorted.back()};
}

ErrorHistogram SortErrors(const std::vector<double>& before, const std::vector<double>& after,
                          std::size_t num_bins) {
  const std::vector<double> finite_before = Finite(before);
  const std::vector<double> finite_after = Finite(after);
  const auto [low, high] = Bounds(finite_before, finite_after);
  ErrorHistogram histogram;
  for (std::size_t k = 0; k <= num_bins; ++k) {
    histogram.edges.push_back(
        low * std::pow(high / low, static_cast<double>(k) / static_cast<double>(num_bins)));
  }
  histogram.before = Count(finite_before, histogram);
  histogram.after = Count(finite_after, histogram);
  histogram.not_finite = before.size() + after.size() - finite_before.size() - finite_after.size();
  return histogram;
}

std::string ErrorHistogramShapes(const ErrorHistogram& histogram, const SvgFrame& frame,
                                 std::size_t num_labels) {
  const std::size_t largest =
      std::max({std::size_t{1}, *std::max_element(histogram.before.begin(), histogram.before.end()),
                *std::max_element(histogram.after.begin(), histogram.after.end())});
  std::string svg;
  for (std::size_t k = 0; k < num_labels; ++k) {
    const double share = static_cast<double>(k) / static_cast<double>(num_labels - 1);
    const double x = frame.left + share * frame.width;
    const double edge =
        histogram.edges.front() * std::pow(histogram.edges.back() / histogram.edges.front(), share);
    svg += Formatted(
        "<path class=\"grid\" d=\"M%.1f %.0fV%.0f\"/><text class=\"%s\" x=\"%.1f\" "
        "y=\"%.0f\">%.2g</text>\n",
        x, frame.top, frame.top + frame.height,
        k == 0                ? "first"
        : k + 1 == num_labels ? "last"
                              : "mid",
        x, frame.top + frame.height + 16.0, edge);
  }
  AppendBars("after", histogram.edges, histogram.after, largest, 1.0, frame, &svg);
  AppendBars("before", histogram.edges, histogram.before, largest, -1.0, frame, &svg);
  svg += Formatted("<path class=\"zero\" d=\"M%.1f %.1fh%.1f\"/>\n", frame.left,
                   frame.top + 0.5 * frame.height, frame.width);
  return svg;
}

}  // namespace inceres::tools
