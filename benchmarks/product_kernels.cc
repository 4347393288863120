// Block products and sums: what H, the gradient, S and b are made of.
//
//   build/bin/kernels_benchmark --benchmark_filter='Products|Add'

#include "benchmarks/kernel_benchmark.h"

namespace inceres::bench {
namespace {

using namespace internal;  // NOLINT(google-build-using-namespace): benchmarks of internal parts

constexpr int kCommon = 100;  // landmarks that two cameras of Ladybug-49 share, on average

std::vector<ProductTerm> ConsecutiveTerms(int count, int quads, bool symmetric) {
  std::vector<ProductTerm> terms;
  for (int p = 0; p < count; ++p) {
    terms.push_back({p * quads, (symmetric ? p : count + p) * quads});
  }
  return terms;
}

// Of symmetric products one triangle is counted, with its diagonal.
void MeasureBlockProducts(benchmark::State& state, int size, int depth, bool tail, bool symmetric) {
  const Kernels* kernels = KernelsOrSkip(state);
  if (kernels == nullptr) {
    return;
  }
  const int quads = tail ? QuadsWithTail(depth, size) : depth * PadToQuad(size) / kQuad;
  const AlignedVector<double> Y = Random(std::int64_t{2} * kCommon * quads * kQuad);
  const std::vector<ProductTerm> terms = ConsecutiveTerms(kCommon, quads, symmetric);
  const BlockProducts products{Y.data(), Y.data(), terms.data(), kCommon,  depth,
                               size,     size,     tail,         symmetric};
  AlignedVector<double> C(static_cast<std::size_t>(size * PadToQuad(size)));
  for (auto _ : state) {
    kernels->accumulate_products(products, -1.0, C.data());
    benchmark::DoNotOptimize(C.data());
  }
  const double entries = symmetric ? Triangle(size) : 1.0 * size * size;
  CountWork(state, 2.0 * kCommon * depth * entries,
            8.0 * ((symmetric ? 1.0 : 2.0) * kCommon * depth * size + 2.0 * entries));
}

// One block of the arguments' frame size: depth 2 (residuals of reprojections) is a block of H,
// depth 3 (points) and 1 (inverse depths) one of S.
void BM_BlockProducts(benchmark::State& state) {
  MeasureBlockProducts(state, static_cast<int>(state.range(1)), static_cast<int>(state.range(2)),
                       /*tail=*/false,
                       /*symmetric=*/false);
}
BENCHMARK(BM_BlockProducts)
    ->ArgNames({"set", "size", "depth"})
    ->ArgsProduct({AllSets(), {6, 9, 15}, {1, 2, 3}});

// The same for cameras of 9 whose blocks have their last column apart, as those of Y have.
void BM_BlockProductsWithTail(benchmark::State& state) {
  MeasureBlockProducts(state, 9, 3, /*tail=*/true, /*symmetric=*/false);
}
BENCHMARK(BM_BlockProductsWithTail)->ArgNames({"set"})->ArgsProduct({AllSets()});

// A diagonal block, of H or of S.
void BM_SymmetricProducts(benchmark::State& state) {
  MeasureBlockProducts(state, static_cast<int>(state.range(1)), static_cast<int>(state.range(2)),
                       /*tail=*/false,
                       /*symmetric=*/true);
}
BENCHMARK(BM_SymmetricProducts)
    ->ArgNames({"set", "size", "depth"})
    ->ArgsProduct({AllSets(), {6, 9, 15}, {1, 2, 3}});

void BM_SymmetricProductsWithTail(benchmark::State& state) {
  MeasureBlockProducts(state, 9, 3, /*tail=*/true, /*symmetric=*/true);
}
BENCHMARK(BM_SymmetricProductsWithTail)->ArgNames({"set"})->ArgsProduct({AllSets()});

// One frame's part of the gradient (depth 2) or of b (depth 3).
void BM_VectorProducts(benchmark::State& state) {
  const Kernels* kernels = KernelsOrSkip(state);
  if (kernels == nullptr) {
    return;
  }
  constexpr int kFactors = 650;  // of one camera of Ladybug-49
  const int size = static_cast<int>(state.range(1));
  const int depth = static_cast<int>(state.range(2));
  const int quads = depth * PadToQuad(size) / kQuad;
  const AlignedVector<double> A = Random(std::int64_t{kFactors} * quads * kQuad);
  const AlignedVector<double> v = Random(std::int64_t{kFactors} * depth);
  std::vector<ProductTerm> terms;
  for (int p = 0; p < kFactors; ++p) {
    terms.push_back({p * quads, p * depth});
  }
  const VectorProducts products{A.data(), v.data(), terms.data(), kFactors, depth, size};
  AlignedVector<double> y(static_cast<std::size_t>(PadToQuad(size)));
  for (auto _ : state) {
    kernels->accumulate_vectors(products, 1.0, y.data());
    benchmark::DoNotOptimize(y.data());
  }
  CountWork(state, 2.0 * kFactors * depth * size, 8.0 * kFactors * depth * (size + 1.0));
}
BENCHMARK(BM_VectorProducts)
    ->ArgNames({"set", "size", "depth"})
    ->ArgsProduct({AllSets(), {6, 9}, {2, 3}});

// What one landmark seen from eight frames adds to a living S and to vectors, or puts in the place
// of what it added before.
struct SharedLandmark {
  SharedLandmark(int size_given, int depth_given, bool replaces)
      : size(size_given),
        depth(depth_given),
        quads(PadToQuad(size_given) / kQuad),
        Y(Random(std::int64_t{2} * kFrames * depth_given * quads * kQuad)) {
    const std::ptrdiff_t block = std::ptrdiff_t{depth} * quads * kQuad;
    for (int r = 0; r < kFrames; ++r) {
      const double* out = replaces ? Y.data() + (kFrames + r) * block : nullptr;
      rows.push_back({Y.data() + r * block, r * quads, quads, size, out});
      for (int c = 0; c <= r; ++c) {
        blocks.push_back(static_cast<std::int32_t>(blocks.size()) * size * quads);
      }
    }
    contribution = {rows.data(), kFrames, depth, replaces};
  }
  // How often A is added.
  double times() const { return contribution.replaces ? 2.0 : 1.0; }
  double num_blocks() const { return static_cast<double>(blocks.size()); }
  double entries() const { return times() * kFrames * depth * size; }

  static constexpr int kFrames = 8;
  int size;
  int depth;
  int quads;
  AlignedVector<double> Y;
  std::vector<BlockRow> rows;
  std::vector<std::int32_t> blocks;
  Contribution contribution;
};

SharedLandmark LandmarkFromArguments(const benchmark::State& state) {
  return {static_cast<int>(state.range(1)), static_cast<int>(state.range(2)), state.range(3) != 0};
}

void Contributions(benchmark::internal::Benchmark* benchmark) {
  benchmark->ArgNames({"set", "size", "depth", "replaces"})
      ->ArgsProduct({AllSets(), {6, 15}, {1, 3}, {0, 1}});
}

void BM_AddOuter(benchmark::State& state) {
  const Kernels* kernels = KernelsOrSkip(state);
  if (kernels == nullptr) {
    return;
  }
  const SharedLandmark landmark = LandmarkFromArguments(state);
  const double size = landmark.size;
  AlignedVector<double> C(landmark.blocks.size() *
                          static_cast<std::size_t>(landmark.size * landmark.quads * kQuad));
  for (auto _ : state) {
    kernels->add_outer(landmark.contribution, -1.0, landmark.blocks.data(), C.data());
    benchmark::DoNotOptimize(C.data());
  }
  CountWork(state, 2.0 * landmark.times() * landmark.num_blocks() * landmark.depth * size * size,
            8.0 * (2.0 * landmark.num_blocks() * size * size + landmark.entries()));
}
BENCHMARK(BM_AddOuter)->Apply(Contributions);

// b, with the largest magnitude that it had.
void BM_AddTransposed(benchmark::State& state) {
  const Kernels* kernels = KernelsOrSkip(state);
  if (kernels == nullptr) {
    return;
  }
  const SharedLandmark landmark = LandmarkFromArguments(state);
  const AlignedVector<double> v = Random(std::int64_t{2} * landmark.depth);
  AlignedVector<double> y(
      static_cast<std::size_t>(SharedLandmark::kFrames * landmark.quads * kQuad));
  AlignedVector<double> peak = y;
  const double* v_out = landmark.contribution.replaces ? v.data() + landmark.depth : nullptr;
  for (auto _ : state) {
    kernels->add_transposed(landmark.contribution, v.data(), v_out, -1.0, y.data(), peak.data());
    benchmark::DoNotOptimize(y.data());
    benchmark::DoNotOptimize(peak.data());
  }
  CountWork(state, 2.0 * landmark.entries(),
            8.0 * (landmark.entries() + 4.0 * SharedLandmark::kFrames * landmark.size));
}
BENCHMARK(BM_AddTransposed)->Apply(Contributions);

// The diagonal of C, with the largest magnitude that it had.
void BM_AddSquares(benchmark::State& state) {
  const Kernels* kernels = KernelsOrSkip(state);
  if (kernels == nullptr) {
    return;
  }
  const SharedLandmark landmark = LandmarkFromArguments(state);
  AlignedVector<double> y(
      static_cast<std::size_t>(SharedLandmark::kFrames * landmark.quads * kQuad));
  AlignedVector<double> peak = y;
  for (auto _ : state) {
    kernels->add_squares(landmark.contribution, -1.0, y.data(), peak.data());
    benchmark::DoNotOptimize(y.data());
    benchmark::DoNotOptimize(peak.data());
  }
  CountWork(state, 2.0 * landmark.entries(),
            8.0 * (landmark.entries() + 4.0 * SharedLandmark::kFrames * landmark.size));
}
BENCHMARK(BM_AddSquares)->Apply(Contributions);

}  // namespace
}  // namespace inceres::bench
