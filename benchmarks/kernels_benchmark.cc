// The inner loops by themselves, each with its multiply-adds a second, for every instruction set this processor has.
//
//   build/bin/kernels_benchmark --benchmark_filter=Products

#include <random>
#include <vector>

#include <benchmark/benchmark.h>

#include "base/aligned_vector.h"
#include "block/kernels.h"

namespace inceres::internal {
namespace {

AlignedVector<double> Random(std::size_t count) {
  std::mt19937_64 engine(1);
  std::uniform_real_distribution<double> uniform(-1.0, 1.0);
  AlignedVector<double> values(count);
  for (double& value : values) {
    value = uniform(engine);
  }
  return values;
}

const Kernels* KernelsOrSkip(benchmark::State& state) {
  const Kernels* kernels = KernelsFor(static_cast<InstructionSet>(state.range(0)));
  if (kernels == nullptr) {
    state.SkipWithError("this processor lacks the instruction set");
  } else {
    state.SetLabel(kernels->name);
  }
  return kernels;
}

void CountMultiplyAdds(benchmark::State& state, double per_iteration) {
  state.counters["multiply_adds"] =
      benchmark::Counter(per_iteration * static_cast<double>(state.iterations()), benchmark::Counter::kIsRate);
}

// One block of S: frames of one size, landmarks of size 3, as many common landmarks as two cameras of Ladybug-49 share on
// average.
void BM_Products(benchmark::State& state) {
  const Kernels* kernels = KernelsOrSkip(state);
  if (kernels == nullptr) {
    return;
  }
  constexpr int kCommon = 100;
  constexpr int kDepth = 3;
  const int size = static_cast<int>(state.range(1));
  const int quads = kDepth * PadToQuad(size) / kQuad;
  const AlignedVector<double> Y = Random(static_cast<std::size_t>(2 * kCommon * quads * kQuad));
  std::vector<ProductTerm> terms;
  for (int p = 0; p < kCommon; ++p) {
    terms.push_back({p * quads, (kCommon + p) * quads});
  }
  BlockProducts products;
  products.a = products.b = Y.data();
  products.terms = terms.data();
  products.count = kCommon;
  products.depth = kDepth;
  products.a_size = products.b_size = size;
  AlignedVector<double> C(static_cast<std::size_t>(size * PadToQuad(size)));
  for (auto _ : state) {
    kernels->accumulate_products(products, -1.0, C.data());
    benchmark::DoNotOptimize(C.data());
  }
  CountMultiplyAdds(state, 1.0 * kCommon * kDepth * size * size);
}
BENCHMARK(BM_Products)->ArgsProduct({{0, 1, 2}, {6, 9, 15}});

// The trailing update of a dense Cholesky panel.
void BM_SubtractOuter(benchmark::State& state) {
  const Kernels* kernels = KernelsOrSkip(state);
  if (kernels == nullptr) {
    return;
  }
  const int rows = static_cast<int>(state.range(1));
  constexpr int kCols = 16;
  const int depth = rows / 2;
  const AlignedVector<double> A = Random(static_cast<std::size_t>(rows) * static_cast<std::size_t>(depth));
  AlignedVector<double> C(static_cast<std::size_t>(rows) * kCols);
  for (auto _ : state) {
    kernels->subtract_outer(rows, kCols, depth, A.data(), rows, A.data(), rows, C.data(), rows);
    benchmark::DoNotOptimize(C.data());
  }
  CountMultiplyAdds(state, 1.0 * rows * kCols * depth);
}
BENCHMARK(BM_SubtractOuter)->ArgsProduct({{0, 1, 2}, {100, 444, 1000}});

}  // namespace
}  // namespace inceres::internal
