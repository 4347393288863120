#include "benchmarks/roofline.h"

#include <algorithm>
#include <vector>

#include "base/stopwatch.h"

namespace inceres::bench {
namespace {

constexpr int kRepetitions = 5;  // the best one counts
// of multiply-adds that do not wait for each other: latency times units, with room
constexpr int kChains = 12;

// Sums of kChains chains of `count` multiply-adds on registers of this many doubles.
#define INCERES_DEFINE_PEAK(Name, kWidth, ...)                                  \
  __VA_ARGS__ __attribute__((noinline)) double Name(int count, double factor) { \
    typedef double Vector __attribute__((vector_size(8 * (kWidth))));           \
    Vector sum[kChains];                                                        \
    for (int k = 0; k < kChains; ++k) {                                         \
      sum[k] = Vector{} + 1e-3 * k;                                             \
    }                                                                           \
    const Vector a = Vector{} + factor;                                         \
    for (int n = 0; n < count; ++n) {                                           \
      for (int k = 0; k < kChains; ++k) {                                       \
        sum[k] = sum[k] * a + a;                                                \
      }                                                                         \
    }                                                                           \
    double total = 0.0;                                                         \
    for (int k = 0; k < kChains; ++k) {                                         \
      total += sum[k][0];                                                       \
    }                                                                           \
    return total;                                                               \
  }

INCERES_DEFINE_PEAK(PeakOf128, 2)
#ifdef __x86_64__
INCERES_DEFINE_PEAK(PeakOf256, 4, __attribute__((target("avx2,fma"))))
INCERES_DEFINE_PEAK(PeakOf512, 8, __attribute__((target("avx512f"))))
#endif

double FlopsOf(double (*chains)(int, double), int width) {
  constexpr int kCount = 2000000;
  double best = 0.0;
  for (int repetition = 0; repetition < kRepetitions; ++repetition) {
    const double start = internal::NowInSeconds();
    benchmark::DoNotOptimize(chains(kCount, 0.5));
    best = std::max(best, 2.0 * kChains * width * kCount / (internal::NowInSeconds() - start));
  }
  return best;
}

double MeasureFlops() {
  double flops = FlopsOf(PeakOf128, 2);
#ifdef __x86_64__
  if (__builtin_cpu_supports("avx2") && __builtin_cpu_supports("fma")) {
    flops = std::max(flops, FlopsOf(PeakOf256, 4));
  }
  if (__builtin_cpu_supports("avx512f")) {
    flops = std::max(flops, FlopsOf(PeakOf512, 8));
  }
#endif
  return flops;
}

double MeasureBytes() {
  constexpr std::size_t kSize = std::size_t{1} << 23;  // 64 MB an array
  std::vector<double> a(kSize, 0.0);
  const std::vector<double> b(kSize, 1.0);
  const std::vector<double> c(kSize, 2.0);
  double best = 0.0;
  for (int repetition = 0; repetition < kRepetitions; ++repetition) {
    const double start = internal::NowInSeconds();
    std::transform(b.begin(), b.end(), c.begin(), a.begin(),
                   [](double x, double y) { return x + 3.0 * y; });
    benchmark::DoNotOptimize(a.data());
    benchmark::ClobberMemory();
    best = std::max(best, 24.0 * kSize / (internal::NowInSeconds() - start));
  }
  return best;
}

}  // namespace

const MachinePeaks& MeasuredPeaks() {
  static const MachinePeaks peaks = {MeasureFlops(), MeasureBytes()};
  return peaks;
}

void CountWork(benchmark::State& state, double flops, double bytes) {
  const MachinePeaks& peaks = MeasuredPeaks();
  const auto iterations = static_cast<double>(state.iterations());
  const auto rate = [&](double work) {
    return benchmark::Counter(work * iterations, benchmark::Counter::kIsRate);
  };
  state.counters["flops"] = rate(flops);
  state.counters["bytes"] = rate(bytes);
  state.counters["share_of_peak"] = rate(flops / peaks.flops);
  state.counters["share_of_bandwidth"] = rate(bytes / peaks.bytes);
}

namespace {

// The peaks themselves, so that they stand in every report.
void BM_MachinePeaks(benchmark::State& state) {
  const MachinePeaks& peaks = MeasuredPeaks();
  for (auto _ : state) {
    benchmark::DoNotOptimize(peaks.flops);
  }
  state.counters["peak_flops"] = peaks.flops;
  state.counters["peak_bytes"] = peaks.bytes;
}
BENCHMARK(BM_MachinePeaks)->Iterations(1);

}  // namespace
}  // namespace inceres::bench
