#pragma once

#include <functional>
#include <memory>
#include <ostream>
#include <string>
#include <vector>

#include <gtest/gtest.h>

#include "inceres/problem/factor_graph.h"
#include "inceres/solver/options.h"
#include "support/random_graph.h"

namespace inceres::test {

/// One of the ways through the batch solver, on a problem that shows it, for what must hold of all.
struct SolverWay {
  std::string name;
  SolverOptions options;  ///< without tolerances; how many threads is for the test to say
  /// the problem, or one of the same structure whose numbers are others throughout
  std::function<std::shared_ptr<FactorGraph>(bool other_numbers)> make;
  bool remembers = false;  ///< its reduced solver does, and is made anew for each solve
  bool allocates = false;  ///< also in a second solve
};

std::vector<SolverWay> SolverWays();

inline void PrintTo(const SolverWay& way, std::ostream* stream) {
  *stream << way.name;
}

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

/// Frames on a path, so that S is sparse, and Jacobians of a few chunks.
inline BundleOptions LongBundle(bool by_frame) {
  BundleOptions bundle;
  bundle.seed = 1401;
  bundle.num_frames = 60;
  bundle.num_landmarks = 3600;
  bundle.num_views = 5;
  bundle.frame_sizes = {9, 6};
  bundle.landmark_sizes = {3, 3, 1};
  bundle.residual_sizes = {2, 3};
  bundle.by_frame = by_frame;
  bundle.losses = bundle.manifolds = bundle.constants = true;
  bundle.perturbation = 0.1;
  return bundle;
}

}  // namespace inceres::test
