// Both estimators, each twice: one solves with stock Ceres, the other with inceres in exact mode,
// every single solve from the same start.

#include <algorithm>
#include <cmath>

#include <gtest/gtest.h>

#include "inceres/ceres/solve.h"
#include "sliding_window/estimators.h"
#include "sliding_window/scale.h"

namespace sliding_window {
namespace {

double LargestDifference(const std::vector<double>& a, const std::vector<double>& b) {
  double largest = a.size() == b.size() ? 0.0 : INFINITY;
  for (std::size_t i = 0; i < a.size() && i < b.size(); ++i) {
    largest = std::max(largest, std::abs(a[i] - b[i]) / std::max(1.0, std::abs(b[i])));
  }
  return largest;
}

class Lockstep {
 public:
  explicit Lockstep(MakeAny make) : make_(std::move(make)) {}

  void Play(const RunOptions& options) {
    Run(
        options,
        [this](const EstimatorOptions& estimator, const SolveFunction& solve, const ImuState& start,
               const std::vector<Pose>& extrinsics) {
          estimator_ = make_(estimator, solve, start, extrinsics);
          return [this](const Frame& frame) {
            estimator_.add_frame(frame);
            return estimator_.newest_state();
          };
        },
        [this](const auto&... arguments) { Solve(arguments...); });
  }

  int num_solves() const { return num_solves_; }

 private:
  // Cost functions with a memory (ImuError) are brought to rest by a first solve, so that the other
  // two meet them alike.
  void Solve(const ceres::Solver::Options& options, ceres::Problem* problem,
             ceres::Solver::Summary* summary) {
    const std::vector<double> start = estimator_.values();
    ceres::Solve(options, problem, summary);
    estimator_.set_values(start);
    ceres::Solve(options, problem, summary);
    const std::vector<double> end = estimator_.values();

    estimator_.set_values(start);
    ceres::Solver::Summary ours;
    inceres::SolveOptions asked;
    inceres::SolveReport report;
    asked.strict = true;
    inceres::Solve(options, problem, &ours, asked, &report);
    EXPECT_EQ(report.fallback_reason, "");
    EXPECT_LT(LargestDifference(estimator_.values(), end), 1e-6) << "solve " << num_solves_;
    EXPECT_NEAR(ours.initial_cost, summary->initial_cost, 1e-12 * summary->initial_cost)
        << "solve " << num_solves_;
    EXPECT_NEAR(ours.final_cost, summary->final_cost, 1e-8 * summary->final_cost)
        << "solve " << num_solves_;
    EXPECT_EQ(ours.iterations.size(), summary->iterations.size()) << "solve " << num_solves_;
    EXPECT_EQ(ours.termination_type, summary->termination_type) << "solve " << num_solves_;
    estimator_.set_values(end);
    ++num_solves_;
  }

  MakeAny make_;
  AnyEstimator estimator_;
  int num_solves_ = 0;
};

RunOptions Options(bool free_extrinsics, int tracks_per_frame) {
  RunOptions options;
  options.num_frames = kNumFramesOfRun;
  options.estimator.free_extrinsics = free_extrinsics;
  options.simulator.tracks_per_frame = tracks_per_frame;
  return options;
}

TEST(Lockstep, VinsWithExtrinsicsHeld) {
  Lockstep lockstep(MakeVins);
  lockstep.Play(Options(false, 75));
  EXPECT_EQ(lockstep.num_solves(), kNumFramesOfRun - 10);
}

TEST(Lockstep, VinsWithExtrinsicsFree) {
  Lockstep lockstep(MakeVins);
  lockstep.Play(Options(true, 75));
  EXPECT_EQ(lockstep.num_solves(), kNumFramesOfRun - 10);
}

TEST(Lockstep, OkvisWithExtrinsicsHeld) {
  Lockstep lockstep(MakeOkvis(false));
  lockstep.Play(Options(false, 127));
  EXPECT_EQ(lockstep.num_solves(), kNumFramesOfRun);
}

TEST(Lockstep, OkvisWithExtrinsicsFreeAndConstantsToggled) {
  Lockstep lockstep(MakeOkvis(true));
  lockstep.Play(Options(true, 60));
  EXPECT_EQ(lockstep.num_solves(), 2 * kNumFramesOfRun);
}

}  // namespace
}  // namespace sliding_window
