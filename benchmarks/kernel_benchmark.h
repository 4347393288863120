#pragma once

#include <cstddef>
#include <cstdint>
#include <random>
#include <vector>

#include <benchmark/benchmark.h>

#include "base/aligned_vector.h"
#include "benchmarks/roofline.h"
#include "simd/kernels.h"

namespace inceres::bench {

/// The argument of every kernel benchmark: all instruction sets, those a processor lacks are
/// reported as skipped.
inline std::vector<std::int64_t> AllSets() {
  return {0, 1, 2, 3};
}

/// The kernels of the set that is the benchmark's first argument, or null and the benchmark is
/// skipped.
inline const internal::Kernels* KernelsOrSkip(benchmark::State& state) {
  const internal::Kernels* kernels =
      internal::KernelsFor(static_cast<internal::InstructionSet>(state.range(0)));
  if (kernels == nullptr) {
    state.SkipWithError("this processor lacks the instruction set");
  } else {
    state.SetLabel(kernels->name);
  }
  return kernels;
}

inline internal::AlignedVector<double> Random(std::int64_t count) {
  std::mt19937_64 engine(1);
  std::uniform_real_distribution<double> uniform(-1.0, 1.0);
  internal::AlignedVector<double> values(static_cast<std::size_t>(count));
  for (double& value : values) {
    value = uniform(engine);
  }
  return values;
}

}  // namespace inceres::bench
