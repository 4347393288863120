// Elimination of landmarks and the way back, by family: landmark size, and one frame a factor
// (points in world coordinates) or two (inverse depths, seen from a host frame).
//
//   build/bin/kernels_benchmark --benchmark_filter=Landmark

#include "benchmarks/kernel_benchmark.h"

namespace inceres::bench {
namespace {

using namespace internal;  // NOLINT(google-build-using-namespace): benchmarks of internal parts

constexpr int kResidual = 2;

// Landmarks one after the other, each with `views` factors over frames of one size.
struct Landmarks {
  Landmarks(int landmark_size_given, int frame_size_given, int frames_a_factor)
      : landmark_size(landmark_size_given),
        frame_size(frame_size_given),
        num_slots(frames_a_factor + 1),
        frame_stride(PadToQuad(frame_size)),
        values(
            Random(std::int64_t{kFactors} * kResidual * (frames_a_factor * frame_stride + kQuad))),
        residuals(Random(std::int64_t{kFactors} * kResidual)) {
    double* next = values.data();
    for (int s = 0; s < frames_a_factor; ++s) {
      slots.push_back({next, std::ptrdiff_t{kResidual} * frame_stride, frame_stride, frame_size});
      next += std::ptrdiff_t{kFactors} * kResidual * frame_stride;
    }
    slots.push_back({next, std::ptrdiff_t{kResidual} * kQuad, kQuad, landmark_size});
    const int y_quads = landmark_size * frame_stride / kQuad;
    for (int i = 0; i < kFactors; ++i) {
      factor_ids.push_back(i);
      // With two frames the first is the host: one block a landmark, begun by its first factor.
      if (frames_a_factor == 2) {
        const int host = i / kViews * (kViews + 1);
        y_targets.push_back(2 * host * y_quads + (i % kViews > 0 ? 1 : 0));
        y_targets.push_back(2 * (host + 1 + i % kViews) * y_quads);
      } else {
        y_targets.push_back(2 * i * y_quads);
      }
      y_targets.push_back(-1);
      for (int s = 0; s < frames_a_factor; ++s) {
        tangent_offsets.push_back((i + s) % kFrames * frame_stride / kQuad);
      }
      tangent_offsets.push_back(kFrames * frame_stride / kQuad + i / kViews);
    }
    num_blocks = kNumLandmarks * (kViews + frames_a_factor - 1);
    for (int q = 0; q < num_blocks; ++q) {
      incidences.push_back({q * y_quads, q % kFrames * frame_stride / kQuad, frame_stride / kQuad});
    }
    Y = Random(std::int64_t{num_blocks} * y_quads * kQuad);
  }

  LandmarkFactors Of(int landmark) const {
    LandmarkFactors factors;
    factors.factors = factor_ids.data() + std::ptrdiff_t{landmark} * kViews;
    factors.count = kViews;
    factors.residual_size = kResidual;
    factors.landmark_slot = num_slots - 1;
    factors.num_slots = num_slots;
    factors.jacobians = slots.data();
    factors.residuals = residuals.data();
    factors.y_targets = y_targets.data();
    factors.tangent_offsets = tangent_offsets.data();
    return factors;
  }
  int BlocksOfOne() const { return num_blocks / kNumLandmarks; }

  static constexpr int kNumLandmarks = 200;
  static constexpr int kViews = 4;
  static constexpr int kFactors = kNumLandmarks * kViews;
  static constexpr int kFrames = 50;
  int landmark_size;
  int frame_size;
  int num_slots;
  int frame_stride;
  AlignedVector<double> values;
  AlignedVector<double> residuals;
  std::vector<SlotJacobians> slots;
  std::vector<std::int32_t> factor_ids;
  std::vector<std::int32_t> y_targets;
  std::vector<std::int32_t> tangent_offsets;
  std::vector<Incidence> incidences;
  AlignedVector<double> Y;
  int num_blocks = 0;
};

Landmarks FromArguments(const benchmark::State& state) {
  return {static_cast<int>(state.range(1)), static_cast<int>(state.range(2)),
          static_cast<int>(state.range(3))};
}

void Families(benchmark::internal::Benchmark* benchmark) {
  benchmark->ArgNames({"set", "landmark", "frame", "frames"});
  for (const std::int64_t set : AllSets()) {
    benchmark->Args({set, 3, 9, 1})->Args({set, 3, 6, 1})->Args({set, 1, 6, 2});
  }
}

// P and η.
void BM_LandmarkGram(benchmark::State& state) {
  const Kernels* kernels = KernelsOrSkip(state);
  if (kernels == nullptr) {
    return;
  }
  const Landmarks landmarks = FromArguments(state);
  const double d = landmarks.landmark_size;
  for (auto _ : state) {
    for (int l = 0; l < Landmarks::kNumLandmarks; ++l) {
      double P[16] = {};
      double eta[4] = {};
      kernels->landmark_gram(landmarks.landmark_size, landmarks.Of(l), P, eta);
      benchmark::DoNotOptimize(P);
    }
  }
  const double rows = Landmarks::kFactors * kResidual;
  CountWork(state, 2.0 * rows * (d * d + d), 8.0 * rows * (d + 1.0));
}
BENCHMARK(BM_LandmarkGram)->Apply(Families);

// Y.
void BM_LandmarkEliminate(benchmark::State& state) {
  const Kernels* kernels = KernelsOrSkip(state);
  if (kernels == nullptr) {
    return;
  }
  Landmarks landmarks = FromArguments(state);
  const double d = landmarks.landmark_size;
  const double U_inv[16] = {1.0, 0.0, 0.0, 0.0, 0.5, 1.0, 0.0, 0.0, 0.5, 0.5, 1.0};
  for (auto _ : state) {
    for (int l = 0; l < Landmarks::kNumLandmarks; ++l) {
      kernels->eliminate(landmarks.landmark_size, landmarks.Of(l), U_inv, landmarks.Y.data());
    }
    benchmark::DoNotOptimize(landmarks.Y.data());
  }
  const double rows = Landmarks::kFactors * kResidual;
  const double frames = static_cast<double>(landmarks.num_slots - 1) * landmarks.frame_size;
  CountWork(state, rows * (d * (d + 1.0) + 2.0 * frames * d),
            8.0 * (rows * (frames + d) + landmarks.num_blocks * d * landmarks.frame_size));
}
BENCHMARK(BM_LandmarkEliminate)->Apply(Families);

// What the frames' step means for the landmarks.
void BM_LandmarkBackSubstitute(benchmark::State& state) {
  const Kernels* kernels = KernelsOrSkip(state);
  if (kernels == nullptr) {
    return;
  }
  const Landmarks landmarks = FromArguments(state);
  const AlignedVector<double> delta =
      Random(std::int64_t{Landmarks::kFrames} * landmarks.frame_stride);
  const int blocks = landmarks.BlocksOfOne();
  for (auto _ : state) {
    for (int l = 0; l < Landmarks::kNumLandmarks; ++l) {
      double y[4] = {};
      kernels->back_substitute(landmarks.landmark_size,
                               landmarks.incidences.data() + std::ptrdiff_t{l} * blocks, blocks,
                               landmarks.Y.data(), delta.data(), y);
      benchmark::DoNotOptimize(y);
    }
  }
  const double entries = 1.0 * landmarks.num_blocks * landmarks.frame_size;
  CountWork(state, 2.0 * entries * landmarks.landmark_size,
            8.0 * entries * (landmarks.landmark_size + 1.0));
}
BENCHMARK(BM_LandmarkBackSubstitute)->Apply(Families);

// The same from the Jacobians, where Y is not kept.
void BM_LandmarkMultiplyCoupling(benchmark::State& state) {
  const Kernels* kernels = KernelsOrSkip(state);
  if (kernels == nullptr) {
    return;
  }
  const Landmarks landmarks = FromArguments(state);
  const AlignedVector<double> delta =
      Random(std::int64_t{Landmarks::kFrames} * landmarks.frame_stride);
  for (auto _ : state) {
    for (int l = 0; l < Landmarks::kNumLandmarks; ++l) {
      double w[4] = {};
      kernels->multiply_coupling(landmarks.Of(l), delta.data(), w);
      benchmark::DoNotOptimize(w);
    }
  }
  const double rows = Landmarks::kFactors * kResidual;
  const double frames = static_cast<double>(landmarks.num_slots - 1) * landmarks.frame_size;
  const double entries = rows * (frames + landmarks.landmark_size);
  CountWork(state, 2.0 * entries, 8.0 * (entries + Landmarks::kFactors * frames));
}
BENCHMARK(BM_LandmarkMultiplyCoupling)->Apply(Families);

// What a change of the landmarks' part means for b.
void BM_LandmarkSubtractIncidences(benchmark::State& state) {
  const Kernels* kernels = KernelsOrSkip(state);
  if (kernels == nullptr) {
    return;
  }
  const Landmarks landmarks = FromArguments(state);
  const AlignedVector<double> v = Random(4);
  AlignedVector<double> b = Random(std::int64_t{Landmarks::kFrames} * landmarks.frame_stride);
  const int blocks = landmarks.BlocksOfOne();
  for (auto _ : state) {
    for (int l = 0; l < Landmarks::kNumLandmarks; ++l) {
      kernels->subtract_incidences(landmarks.landmark_size,
                                   landmarks.incidences.data() + std::ptrdiff_t{l} * blocks, blocks,
                                   landmarks.Y.data(), v.data(), b.data());
    }
    benchmark::DoNotOptimize(b.data());
  }
  const double entries = 1.0 * landmarks.num_blocks * landmarks.frame_size;
  CountWork(state, 2.0 * entries * landmarks.landmark_size,
            8.0 * entries * (landmarks.landmark_size + 2.0));
}
BENCHMARK(BM_LandmarkSubtractIncidences)->Apply(Families);

}  // namespace
}  // namespace inceres::bench
