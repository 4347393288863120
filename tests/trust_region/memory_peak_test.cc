// What a solve is predicted to take, beside what it does take.
#include <cstdint>
#include <memory>
#include <ostream>
#include <string>
#include <vector>

#include <gtest/gtest.h>

#include "inceres/solver/solver.h"
#include "support/allocations.h"
#include "support/random_graph.h"

namespace inceres {
namespace {

struct Case {
  const char* name;
  test::BundleOptions bundle;
  SolverOptions options;
};

std::ostream& operator<<(std::ostream& out, const Case& problem) {
  return out << problem.name;
}

// Cameras of nine parameters and points, each seen by neighbors along a path.
Case Path(const char* name, int num_frames, int num_landmarks, int num_views) {
  Case result;
  result.name = name;
  result.bundle.num_frames = num_frames;
  result.bundle.num_landmarks = num_landmarks;
  result.bundle.num_views = num_views;
  result.bundle.frame_sizes = {9};
  result.bundle.perturbation = 0.001;
  result.options.max_num_iterations = 1;
  return result;
}

Case ByConjugateGradients(const char* name, PreconditionerKind preconditioner, bool on_S = false) {
  Case result = Path(name, 300, 20000, 5);
  result.options.linear_model = LinearModelKind::kIterativeSchur;
  result.options.conjugate_gradients.preconditioner = preconditioner;
  result.options.conjugate_gradients.explicit_schur_complement = on_S;
  return result;
}

class MemoryOfASolve : public testing::TestWithParam<Case> {};

TEST_P(MemoryOfASolve, IsPredictedToAFifthAndNotBelow) {
  if (!test::CanCountAllocations()) {
    GTEST_SKIP() << "nothing can be counted";
  }
  const auto bundle = test::MakeBundle(GetParam().bundle);
  SolverOptions options = GetParam().options;
  test::StartPeak();
  const std::int64_t before = test::BytesInUse();
  const Summary solved = Solve(options, &bundle->graph());
  const std::int64_t peak = test::PeakBytes() - before;
  ASSERT_TRUE(solved.IsSolutionUsable()) << solved.message;
  ASSERT_GT(peak, 1 << 20);

  options.max_memory_bytes = peak - 1;
  test::StartPeak();
  const std::int64_t before_tight = test::BytesInUse();
  const Summary tight = Solve(options, &bundle->graph());
  EXPECT_TRUE(tight.termination == Termination::kFailure || tight.recomputed_jacobians)
      << "less is predicted than is taken";
  EXPECT_LT(test::PeakBytes() - before_tight, peak);
  options.max_memory_bytes = peak + peak / 5;
  const Summary wide = Solve(options, &bundle->graph());
  EXPECT_TRUE(wide.IsSolutionUsable()) << peak << " are taken: " << wide.message;
  EXPECT_FALSE(wide.recomputed_jacobians) << peak << " are taken";
}

std::vector<Case> Cases() {
  std::vector<Case> cases;
  cases.push_back(Path("Small", 40, 3000, 4));
  cases.push_back(Path("Sparse", 600, 30000, 5));
  cases.push_back(Path("Dense", 200, 4000, 20));
  cases.back().options.reduced_solver = ReducedSolverKind::kDense;
  cases.push_back(Path("BeyondTheLimitOfPadding", 2000, 110000, 5));
  cases.push_back(Path("SeveralThreads", 600, 30000, 5));
  cases.back().options.num_threads = 4;
  cases.push_back(Path("WithLosses", 300, 20000, 5));
  cases.back().bundle.losses = true;
  cases.push_back(Path("ByDogleg", 300, 20000, 5));
  cases.back().options.strategy = TrustRegionStrategyKind::kDogleg;
  cases.push_back(Path("ByMarquardt", 300, 20000, 5));
  cases.back().options.strategy = TrustRegionStrategyKind::kMarquardt;
  cases.push_back(Path("Inexact", 600, 30000, 5));
  cases.back().options.reduced_solver = ReducedSolverKind::kAutomaticInexact;
  cases.push_back(ByConjugateGradients("Implicit", PreconditionerKind::kSchurJacobi));
  cases.push_back(ByConjugateGradients("Jacobi", PreconditionerKind::kJacobi));
  cases.push_back(ByConjugateGradients("TwoLevel", PreconditionerKind::kTwoLevel));
  cases.push_back(ByConjugateGradients("Explicit", PreconditionerKind::kSchurJacobi, true));
  cases.push_back(ByConjugateGradients("Floats", PreconditionerKind::kSchurJacobi));
  cases.back().options.conjugate_gradients.single_precision_jacobians = true;
  cases.push_back(Path("ManyFrames", 3000, 6000, 3));
  cases.push_back(ByConjugateGradients("ImplicitOfManyFrames", PreconditionerKind::kSchurJacobi));
  cases.back().bundle.num_frames = 3000;
  cases.back().bundle.num_landmarks = 9000;
  cases.back().bundle.num_views = 3;
  cases.push_back(ByConjugateGradients("FloatsByFrame", PreconditionerKind::kSchurJacobi));
  cases.back().options.conjugate_gradients.single_precision_jacobians = true;
  cases.back().bundle.by_frame = true;
  return cases;
}

INSTANTIATE_TEST_SUITE_P(Kinds, MemoryOfASolve, testing::ValuesIn(Cases()),
                         [](const auto& tested) { return std::string(tested.param.name); });

}  // namespace
}  // namespace inceres
