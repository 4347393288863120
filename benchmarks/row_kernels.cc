// Products with J, factor by factor: the predicted decrease of a batch solve, the trial steps of an
// incremental one.
//
//   build/bin/kernels_benchmark --benchmark_filter=Rows

#include "benchmarks/kernel_benchmark.h"

namespace inceres::bench {
namespace {

using namespace internal;  // NOLINT(google-build-using-namespace): benchmarks of internal parts

// Reprojections of points into frames of the argument's size.
struct Factors {
  explicit Factors(int size)
      : stride(PadToQuad(size)),
        values(Random(std::int64_t{kCount} * kResidual * (stride + kQuad))),
        residuals(Random(std::int64_t{kCount} * kResidual)),
        v(Random(std::int64_t{kFrames} * stride + std::int64_t{kPoints} * kQuad)) {
    slots[0] = {values.data(), std::ptrdiff_t{kResidual} * stride, stride, size};
    slots[1] = {values.data() + std::ptrdiff_t{kCount} * kResidual * stride,
                std::ptrdiff_t{kResidual} * kQuad, kQuad, 3};
    for (int i = 0; i < kCount; ++i) {
      offsets.push_back(i % kFrames * stride / kQuad);
      offsets.push_back(kFrames * stride / kQuad + i / 4);
      ids.push_back(i);
    }
    rows.end = kCount;
    rows.residual_size = kResidual;
    rows.num_slots = 2;
    rows.jacobians = slots;
    rows.residuals = residuals.data();
    rows.tangent_offsets = offsets.data();
  }

  static constexpr int kResidual = 2;
  static constexpr int kCount = 2000;
  static constexpr int kFrames = 50;
  static constexpr int kPoints = kCount / 4;
  int stride;
  AlignedVector<double> values;
  AlignedVector<double> residuals;
  AlignedVector<double> v;
  SlotJacobians slots[2];
  std::vector<std::int32_t> offsets;
  std::vector<std::int32_t> ids;
  FactorRows rows;
};

template <typename Call>
void Measure(benchmark::State& state, double flops_an_entry, double vectors, const Call& call) {
  const Kernels* kernels = KernelsOrSkip(state);
  if (kernels == nullptr) {
    return;
  }
  const int size = static_cast<int>(state.range(1));
  const Factors factors(size);
  AlignedVector<double> y = factors.v;
  AlignedVector<double> out = factors.residuals;
  for (auto _ : state) {
    call(*kernels, factors, out.data(), y.data());
    benchmark::DoNotOptimize(out.data());
    benchmark::DoNotOptimize(y.data());
  }
  const double entries = Factors::kCount * Factors::kResidual * (size + 3.0);
  CountWork(state, flops_an_entry * entries,
            8.0 * (entries + vectors * static_cast<double>(factors.v.size()) +
                   2.0 * Factors::kCount * Factors::kResidual));
}

void BM_RowsModelDecrease(benchmark::State& state) {
  Measure(state, 2.0, 1.0, [](const Kernels& kernels, const Factors& f, double*, double*) {
    benchmark::DoNotOptimize(kernels.row_products(f.rows, f.v.data()).model_decrease);
  });
}
BENCHMARK(BM_RowsModelDecrease)->ArgNames({"set", "size"})->ArgsProduct({AllSets(), {6, 9}});

void BM_RowsMultiply(benchmark::State& state) {
  Measure(state, 2.0, 1.0, [](const Kernels& kernels, const Factors& f, double* out, double*) {
    kernels.multiply_rows(f.rows, f.ids.data(), Factors::kCount, f.v.data(), out);
  });
}
BENCHMARK(BM_RowsMultiply)->ArgNames({"set", "size"})->ArgsProduct({AllSets(), {6, 9}});

void BM_RowsTryStep(benchmark::State& state) {
  Measure(state, 4.0, 3.0, [](const Kernels& kernels, const Factors& f, double* out, double* y) {
    benchmark::DoNotOptimize(kernels.try_rows(f.rows, f.ids.data(), Factors::kCount, f.v.data(),
                                              f.residuals.data(), out, y));
  });
}
BENCHMARK(BM_RowsTryStep)->ArgNames({"set", "size"})->ArgsProduct({AllSets(), {6, 9}});

void BM_RowsSubtractTransposed(benchmark::State& state) {
  Measure(state, 2.0, 2.0, [](const Kernels& kernels, const Factors& f, double*, double* y) {
    kernels.subtract_transposed(f.rows, f.ids.data(), Factors::kCount, f.residuals.data(), y);
  });
}
BENCHMARK(BM_RowsSubtractTransposed)->ArgNames({"set", "size"})->ArgsProduct({AllSets(), {6, 9}});

}  // namespace
}  // namespace inceres::bench
