#pragma once

#include <optional>
#include <vector>

namespace inceres::tools {

/// Median, smallest and largest of a set of measurements.
struct Spread {
  double median = 0.0;
  double min = 0.0;
  double max = 0.0;
};

/// The spread of `values`, which must not be empty; the median of an even count is the mean of the
/// two middle values.
Spread Summarize(std::vector<double> values);

/// The smallest of `values`, which must not be empty, that the given fraction of them does not
/// exceed (nearest rank); 0 < fraction ≤ 1.
double Percentile(std::vector<double> values, double fraction);

/// Spread of numerators[i] / denominators[i]: the ratio is taken round by round, so that a
/// disturbance of the machine that lasts a whole round cancels. Both have the same, non-zero size.
Spread SummarizeRatios(const std::vector<double>& numerators,
                       const std::vector<double>& denominators);

/// Median where an absent value stands for "never", later than any number; absent if the median is
/// "never".
std::optional<double> MedianOrNever(const std::vector<std::optional<double>>& values);

}  // namespace inceres::tools
