// What a dense Cholesky factorization is made of; whole ones are in stages_benchmark.
//
//   build/bin/kernels_benchmark --benchmark_filter=Dense

#include "benchmarks/kernel_benchmark.h"

namespace inceres::bench {
namespace {

using namespace internal;  // NOLINT(google-build-using-namespace): benchmarks of internal parts

// The trailing update of a panel.
void BM_DenseSubtractOuter(benchmark::State& state) {
  const Kernels* kernels = KernelsOrSkip(state);
  if (kernels == nullptr) {
    return;
  }
  const int rows = static_cast<int>(state.range(1));
  constexpr int kCols = 16;
  const int depth = rows / 2;
  const AlignedVector<double> A = Random(std::int64_t{rows} * depth);
  AlignedVector<double> C = Random(std::int64_t{rows} * kCols);
  for (auto _ : state) {
    kernels->subtract_outer(rows, kCols, depth, A.data(), rows, A.data(), rows, C.data(), rows);
    benchmark::DoNotOptimize(C.data());
  }
  CountWork(state, 2.0 * rows * kCols * depth, 8.0 * (1.0 * rows * depth + 2.0 * rows * kCols));
}
BENCHMARK(BM_DenseSubtractOuter)
    ->ArgNames({"set", "rows"})
    ->ArgsProduct({AllSets(), {100, 444, 1000}});

// The same on rows: the resumed Cholesky of a living problem.
void BM_DenseSubtractRowDots(benchmark::State& state) {
  const Kernels* kernels = KernelsOrSkip(state);
  if (kernels == nullptr) {
    return;
  }
  const int size = static_cast<int>(state.range(1));
  const int depth = static_cast<int>(state.range(2));
  const AlignedVector<double> A = Random(std::int64_t{size} * depth);
  AlignedVector<double> C = Random(std::int64_t{size} * size);
  for (auto _ : state) {
    kernels->subtract_row_dots(size, size, depth, A.data(), depth, A.data(), depth, C.data(), size);
    benchmark::DoNotOptimize(C.data());
  }
  CountWork(state, 2.0 * size * size * depth, 8.0 * (1.0 * size * depth + 2.0 * size * size));
}
BENCHMARK(BM_DenseSubtractRowDots)
    ->ArgNames({"set", "size", "depth"})
    ->ArgsProduct({AllSets(), {6, 15}, {60, 600}});

// The rows below a triangle; L is the identity with small entries, so that repeated solves stay
// finite.
void BM_DenseSolveTriangle(benchmark::State& state) {
  const Kernels* kernels = KernelsOrSkip(state);
  if (kernels == nullptr) {
    return;
  }
  const int rows = static_cast<int>(state.range(1));
  constexpr int kSize = 24;
  AlignedVector<double> L(kSize * kSize, 0.0);
  for (int j = 0; j < kSize; ++j) {
    for (int i = j; i < kSize; ++i) {
      L[static_cast<std::size_t>(i + j * kSize)] = i == j ? 1.0 : 1e-9;
    }
  }
  AlignedVector<double> X = Random(std::int64_t{rows} * kSize);
  for (auto _ : state) {
    kernels->solve_lower_transposed(rows, kSize, L.data(), kSize, X.data(), rows);
    benchmark::DoNotOptimize(X.data());
  }
  CountWork(state, 1.0 * rows * kSize * kSize, 8.0 * 2.0 * rows * kSize);
}
BENCHMARK(BM_DenseSolveTriangle)->ArgNames({"set", "rows"})->ArgsProduct({AllSets(), {100, 444}});

}  // namespace
}  // namespace inceres::bench
