#include "tools/ab/statistics.h"

#include <algorithm>
#include <cassert>
#include <cmath>
#include <cstddef>
#include <limits>

namespace inceres::tools {
namespace {

double Median(std::vector<double> sorted) {
  std::sort(sorted.begin(), sorted.end());
  const std::size_t middle = sorted.size() / 2;
  return sorted.size() % 2 == 1 ? sorted[middle] : 0.5 * (sorted[middle - 1] + sorted[middle]);
}

}  // namespace

Spread Summarize(std::vector<double> values) {
  assert(!values.empty());
  const auto [min, max] = std::minmax_element(values.begin(), values.end());
  Spread spread;
  spread.min = *min;
  spread.max = *max;
  spread.median = Median(std::move(values));
  return spread;
}

double Percentile(std::vector<double> values, double fraction) {
  assert(!values.empty() && fraction > 0.0 && fraction <= 1.0);
  // 0.95 · 20 is a little more than 19 in doubles, which must not become rank 20.
  const double rank = std::ceil(fraction * static_cast<double>(values.size()) - 1e-9);
  const auto nth = values.begin() + static_cast<std::ptrdiff_t>(rank) - 1;
  std::nth_element(values.begin(), nth, values.end());
  return *nth;
}

Spread SummarizeRatios(const std::vector<double>& numerators,
                       const std::vector<double>& denominators) {
  assert(numerators.size() == denominators.size());
  std::vector<double> ratios(numerators.size());
  std::transform(numerators.begin(), numerators.end(), denominators.begin(), ratios.begin(),
                 [](double numerator, double denominator) { return numerator / denominator; });
  return Summarize(std::move(ratios));
}

std::optional<double> MedianOrNever(const std::vector<std::optional<double>>& values) {
  if (values.empty()) {
    return std::nullopt;
  }
  std::vector<double> seconds;
  seconds.reserve(values.size());
  for (const std::optional<double>& value : values) {
    seconds.push_back(value.value_or(std::numeric_limits<double>::infinity()));
  }
  const double median = Median(std::move(seconds));
  return std::isfinite(median) ? std::optional<double>(median) : std::nullopt;
}

}  // namespace inceres::tools
