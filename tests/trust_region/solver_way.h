#pragma once

#include <string>

#include <gtest/gtest.h>

#include "inceres/solver/options.h"
#include "support/random_graph.h"

namespace inceres::test {

/// One of the ways through the batch solver, for a parameterised test.
struct SolverWay {
  const char* name;
  LinearModelKind model;
  ReducedSolverKind reduced;
  TrustRegionStrategyKind strategy;
  int num_threads;
  bool recomputes_jacobians = false;

  void Choose(SolverOptions* options) const {
    options->linear_model = model;
    options->reduced_solver = reduced;
    options->strategy = strategy;
    options->num_threads = num_threads;
    options->recompute_jacobians = recomputes_jacobians;
  }
};

inline std::string NameOf(const testing::TestParamInfo<SolverWay>& way) {
  return way.param.name;
}

/// A problem with everything in it that a structure consists of.
inline BundleOptions MixedBundle(int num_landmarks) {
  BundleOptions options;
  options.num_frames = 12;
  options.num_landmarks = num_landmarks;
  options.frame_sizes = {6, 9};
  options.landmark_sizes = {3, 1};
  options.losses = options.manifolds = options.constants = true;
  options.perturbation = 0.5;
  return options;
}

}  // namespace inceres::test
