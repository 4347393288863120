// What becomes of the Jacobian that a cost function has written: taken over, checked, corrected by
// a loss, and, in small problems, gathered into one dense matrix.
//
//   build/bin/kernels_benchmark --benchmark_filter=Jacobian

#include <algorithm>
#include <vector>

#include "benchmarks/kernel_benchmark.h"

namespace inceres::bench {
namespace {

using namespace internal;  // NOLINT(google-build-using-namespace): benchmarks of internal parts

// A Jacobian is copied and summed up. It is written anew before each call, as the user's function
// does: that is measured too, and counted.
void BM_JacobianTake(benchmark::State& state) {
  const Kernels* kernels = KernelsOrSkip(state);
  if (kernels == nullptr) {
    return;
  }
  constexpr int kRows = 2;
  const int ambient_size = static_cast<int>(state.range(1));
  const int columns = static_cast<int>(state.range(2));
  const ColumnTake take = kernels->find_take(kRows, ambient_size, columns);
  if (take == nullptr) {
    state.SkipWithError("there is no such kernel");
    return;
  }
  const AlignedVector<double> written = Random(std::int64_t{kRows} * ambient_size);
  AlignedVector<double> J = written;
  AlignedVector<double> out(static_cast<std::size_t>(kRows * PadToQuad(columns)));
  for (auto _ : state) {
    std::copy(written.begin(), written.end(), J.begin());
    benchmark::DoNotOptimize(J.data());
    benchmark::DoNotOptimize(take(1, J.data(), kRows, out.data(), 0, PadToQuad(columns)));
    benchmark::DoNotOptimize(out.data());
    benchmark::ClobberMemory();
  }
  CountWork(state, 1.0 * kRows * ambient_size, 8.0 * kRows * (2.0 * ambient_size + columns));
}

// Poses of 7 with 6 columns, cameras, points and inverse depths.
void Takes(benchmark::internal::Benchmark* benchmark) {
  benchmark->ArgNames({"set", "ambient", "columns"});
  for (const std::int64_t set : AllSets()) {
    benchmark->Args({set, 7, 6})->Args({set, 9, 9})->Args({set, 3, 3})->Args({set, 1, 1});
  }
}
BENCHMARK(BM_JacobianTake)->Apply(Takes);

// The Jacobian of one reprojection to its camera, and that of an IMU factor to one of its poses and
// velocities.
void BM_JacobianAreOrdinary(benchmark::State& state) {
  const Kernels* kernels = KernelsOrSkip(state);
  if (kernels == nullptr) {
    return;
  }
  const int count = static_cast<int>(state.range(1));
  AlignedVector<double> values = Random(count);
  for (auto _ : state) {
    benchmark::DoNotOptimize(values.data());
    benchmark::DoNotOptimize(kernels->are_ordinary(values.data(), count));
    benchmark::ClobberMemory();
  }
  CountWork(state, 1.0 * count, 8.0 * count);
}
BENCHMARK(BM_JacobianAreOrdinary)->ArgNames({"set", "count"})->ArgsProduct({AllSets(), {18, 240}});

// What a loss does to reprojections of points into frames of the argument's size: a scale alone
// (second_order 0, ρ'' ≤ 0), or with the second-order term. Scale and term are so near 1 and 0 that
// the entries stay of a size, however often.
void BM_JacobianCorrect(benchmark::State& state) {
  const Kernels* kernels = KernelsOrSkip(state);
  if (kernels == nullptr) {
    return;
  }
  constexpr int kFactors = 100;
  constexpr int kRows = 2;
  const int size = static_cast<int>(state.range(1));
  const bool second_order = state.range(2) != 0;
  const int stride = PadToQuad(size);
  AlignedVector<double> frames = Random(std::int64_t{kFactors} * kRows * stride);
  AlignedVector<double> points = Random(std::int64_t{kFactors} * kRows * kQuad);
  const SlotJacobians slots[2] = {{frames.data(), std::ptrdiff_t{kRows} * stride, stride, size},
                                  {points.data(), std::ptrdiff_t{kRows} * kQuad, kQuad, 3}};
  const std::vector<std::int32_t> offsets(2 * kFactors, 0);
  const std::vector<double> f(kFactors * kRows, 0.5);
  const std::vector<FactorScale> scales(kFactors, {1.0 - 1e-16, second_order ? 1e-16 : 0.0});
  for (auto _ : state) {
    kernels->correct_factors(slots, 2, 0, kFactors, offsets.data(), f.data(), kRows, scales.data());
    benchmark::DoNotOptimize(frames.data());
    benchmark::ClobberMemory();
  }
  const double entries = 1.0 * kFactors * kRows * (size + 3.0);
  CountWork(state, (second_order ? 5.0 : 1.0) * entries, 16.0 * entries);
}
BENCHMARK(BM_JacobianCorrect)
    ->ArgNames({"set", "size", "second_order"})
    ->ArgsProduct({AllSets(), {6, 9}, {0, 1}});

// A family's Jacobians into the columns of a small problem: 53 rows, as in small_solves.
void BM_JacobianRowsToColumns(benchmark::State& state) {
  const Kernels* kernels = KernelsOrSkip(state);
  if (kernels == nullptr) {
    return;
  }
  constexpr int kRows = 53;
  const int columns = static_cast<int>(state.range(1));
  const int row_stride = PadToQuad(columns);
  const AlignedVector<double> J = Random(std::int64_t{kRows} * row_stride);
  AlignedVector<double> out(static_cast<std::size_t>(columns * PadToQuad(kRows)));
  for (auto _ : state) {
    kernels->rows_to_columns(kRows, columns, J.data(), row_stride, out.data(), PadToQuad(kRows));
    benchmark::DoNotOptimize(out.data());
    benchmark::ClobberMemory();
  }
  CountWork(state, 0.0, 16.0 * kRows * columns);
}
BENCHMARK(BM_JacobianRowsToColumns)
    ->ArgNames({"set", "columns"})
    ->ArgsProduct({AllSets(), {3, 16}});

// The predicted decrease of such a problem.
void BM_JacobianColumnProducts(benchmark::State& state) {
  const Kernels* kernels = KernelsOrSkip(state);
  if (kernels == nullptr) {
    return;
  }
  constexpr int kRows = PadToQuad(53);
  const int columns = static_cast<int>(state.range(1));
  const AlignedVector<double> J_f = Random(std::int64_t{columns + 1} * kRows);
  const AlignedVector<double> v = Random(columns);
  for (auto _ : state) {
    benchmark::DoNotOptimize(
        kernels->column_products(kRows, columns, J_f.data(), kRows, v.data()).model_decrease);
    benchmark::ClobberMemory();
  }
  // J v, then two multiply-adds and a half of f a row.
  CountWork(state, kRows * (2.0 * columns + 5.0), 8.0 * (kRows * (columns + 1.0) + columns));
}
BENCHMARK(BM_JacobianColumnProducts)
    ->ArgNames({"set", "columns"})
    ->ArgsProduct({AllSets(), {3, 16}});

}  // namespace
}  // namespace inceres::bench
