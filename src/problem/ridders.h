#pragma once

#include <algorithm>
#include <array>
#include <cmath>
#include <cstddef>
#include <limits>
#include <vector>

namespace inceres::internal {

/// A derivative and its estimated error, entry by entry.
struct NumericDerivative {
  std::vector<double> value;
  std::vector<double> error;
};

/// d f(t)/dt at t = 0 of a vector function of `size` entries, by Ridders' method: central
/// differences at steps h, h/1.4, h/1.4², …, extrapolated (Neville's table); of each entry the
/// estimate of the smallest error. evaluate(t, f) writes f(t) and says whether it could; while it
/// cannot, h is halved. False if it never could.
template <typename Evaluate>
bool DifferentiateByRidders(double h, std::size_t size, const Evaluate& evaluate,
                            NumericDerivative* derivative) {
  constexpr int kTable = 10;
  constexpr int kTries = 12;
  constexpr double kShrink = 1.4;
  std::vector<double> plus(size), minus(size);
  int tries = 0;
  while (!(evaluate(h, plus.data()) && evaluate(-h, minus.data()))) {
    if (++tries == kTries) {
      return false;
    }
    h *= 0.5;
  }
  derivative->value.assign(size, 0.0);
  derivative->error.assign(size, std::numeric_limits<double>::infinity());
  std::vector<std::array<double, kTable>> last(size), row(size);  // of the table, by entry
  for (int i = 0; i < kTable; ++i, h /= kShrink) {
    if (i > 0 && !(evaluate(h, plus.data()) && evaluate(-h, minus.data()))) {
      return false;
    }
    for (std::size_t k = 0; k < size; ++k) {
      const double difference = plus[k] - minus[k];
      // of the difference: half a unit in the last place of either residual
      const double rounding = std::numeric_limits<double>::epsilon() *
                              std::max(std::fabs(plus[k]), std::fabs(minus[k])) / h;
      row[k][0] = difference / (2.0 * h);
      double factor = kShrink * kShrink;
      for (int j = 1; j <= i; ++j, factor *= kShrink * kShrink) {
        row[k][static_cast<std::size_t>(j)] = (row[k][static_cast<std::size_t>(j - 1)] * factor -
                                               last[k][static_cast<std::size_t>(j - 1)]) /
                                              (factor - 1.0);
        const double error =
            rounding + std::max(std::fabs(row[k][static_cast<std::size_t>(j)] -
                                          row[k][static_cast<std::size_t>(j - 1)]),
                                std::fabs(row[k][static_cast<std::size_t>(j)] -
                                          last[k][static_cast<std::size_t>(j - 1)]));
        if (error < derivative->error[k]) {
          derivative->error[k] = error;
          derivative->value[k] = row[k][static_cast<std::size_t>(j)];
        }
      }
    }
    last.swap(row);
  }
  return true;
}

}  // namespace inceres::internal
