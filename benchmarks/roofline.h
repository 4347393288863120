#pragma once

#include <benchmark/benchmark.h>

namespace inceres::bench {

/// What one core of this machine does at best, measured once, before the first benchmark that asks:
/// about half a second.
struct MachinePeaks {
  /// double precision, a second: independent fused multiply-adds on the widest registers there are
  double flops = 0.0;
  double bytes = 0.0;  ///< a second: a = b + s c over arrays that no cache holds, 24 bytes an entry
};

const MachinePeaks& MeasuredPeaks();

/// Sets the counters of a benchmark of which every iteration does this work (a multiply-add is two
/// flops; of the bytes each operand counts once, what is updated twice): flops and bytes a second,
/// and each as a share of the machine's peak. A share of the bandwidth above 1 means that the
/// operands come from a cache.
void CountWork(benchmark::State& state, double flops, double bytes);

/// Entries of one triangle of a square block, with its diagonal.
constexpr double Triangle(double size) {
  return 0.5 * size * (size + 1.0);
}

}  // namespace inceres::bench
