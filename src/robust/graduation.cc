#include "robust/graduation.h"

#include <algorithm>
#include <cmath>
#include <iterator>
#include <utility>

namespace inceres::internal {
namespace {

// Verdicts that go round in a circle, because factors at the threshold decide about each other, are
// left as they are after so many rounds.
constexpr int kMaxLastRounds = 10;

// Squared errors, in thresholds, up to which suspects that were left out are tried once more: what
// a wrong inlier has displaced is near, what is wrong itself is far.
constexpr double kSecondLooks[] = {4.0, 16.0, 64.0, 256.0};

// Of the cost: less is no gain.
constexpr double kLeastGain = 1e-6;

}  // namespace

// The weights of the residuals now; how many of them have changed.
int Graduation::SetWeights(bool last) {
  int num_changed = 0;
  for (std::size_t k = 0; k < problem_.num_suspects(); ++k) {
    const double ratio = problem_.Ratio(k);
    const double weight = last ? schedule_.LastWeight(ratio) : schedule_.Weight(ratio);
    num_changed += weight != problem_.weight(k) ? 1 : 0;
    problem_.SetWeight(k, weight);
  }
  return num_changed;
}

// From the convex cost to the last one. False if a solve has failed.
bool Graduation::Graduate() {
  if (!schedule_.Begin(problem_.LargestRatio())) {
    return true;
  }
  std::vector<bool> left_out_before;
  while (HasRoundsLeft(1)) {
    SetWeights(/*last=*/false);
    const std::vector<double> weights = problem_.Weights();
    const bool decided = std::all_of(weights.begin(), weights.end(),
                                     [](double weight) { return weight == 0.0 || weight == 1.0; });
    if (schedule_.IsLast() || (options_.kernel == GncKernel::kTruncatedLeastSquares && decided)) {
      return true;
    }
    if (!SolveWeighted(/*last=*/false)) {
      return false;
    }
    std::vector<bool> left_out(weights.size());
    std::transform(weights.begin(), weights.end(), left_out.begin(),
                   [](double weight) { return weight == 0.0; });
    schedule_.Advance();
    if (left_out == left_out_before) {
      schedule_.SkipTo(problem_.LargestRatio());
    }
    left_out_before = std::move(left_out);
  }
  return true;
}

// Until the weights agree with what they lead to.
bool Graduation::Settle() {
  GncSummary& summary = problem_.summary();
  for (int i = 0; i < kMaxLastRounds; ++i) {
    const bool any = SetWeights(/*last=*/true) > 0;
    if (i > 0 && (!any || !HasRoundsLeft(1))) {
      summary.termination = any ? Termination::kNoConvergence : Termination::kConvergence;
      break;
    }
    if (!SolveWeighted(/*last=*/true)) {
      return false;
    }
  }
  summary.message = summary.termination == Termination::kConvergence
                        ? "The weights have settled."
                        : "The weights have not settled; the state is that of the last round.";
  return true;
}

// Solves with the suspects that were left out with errors up to a limit as inliers, and lets the
// weights settle from there. True if that costs less; else everything is as it was.
bool Graduation::TryWith(double limit) {
  const double cost = problem_.TruncatedCost();
  const WeightedProblem::Snapshot before = problem_.Save();
  GncSummary& summary = problem_.summary();
  const GncSummary told = summary;
  for (std::size_t k = 0; k < problem_.num_suspects(); ++k) {
    problem_.SetWeight(k, problem_.Ratio(k) <= limit ? 1.0 : 0.0);
  }
  if (SolveWeighted(/*last=*/true) && Settle() &&
      problem_.TruncatedCost() < cost * (1.0 - kLeastGain)) {
    return true;
  }
  problem_.Restore(before);
  const std::vector<GncRound> rounds = std::move(summary.rounds);
  const int num_iterations = summary.num_iterations;
  summary = told;  // but for the work that it took
  summary.rounds = rounds;
  summary.num_iterations = num_iterations;
  return false;
}

// A wrong suspect that was taken for right keeps a few right ones out, whose errors are then small
// compared to those of wrong ones. Every step down begins anew; a limit below which nobody new is
// found costs nothing.
void Graduation::LookAgain(double farthest) {
  if (options_.kernel != GncKernel::kTruncatedLeastSquares) {
    return;
  }
  int num_tried = 0;
  for (std::size_t i = 0; i < std::size(kSecondLooks) && kSecondLooks[i] <= farthest;) {
    int num_near = 0;
    for (std::size_t k = 0; k < problem_.num_suspects(); ++k) {
      num_near += problem_.weight(k) == 0.0 && problem_.Ratio(k) <= kSecondLooks[i] ? 1 : 0;
    }
    if (num_near > num_tried && HasRoundsLeft(2) && TryWith(kSecondLooks[i])) {
      i = 0;
      num_tried = 0;
    } else {
      num_tried = std::max(num_tried, num_near);
      ++i;
    }
  }
}

bool Graduation::SolveToTheEnd() {
  for (std::size_t k = 0; k < problem_.num_suspects(); ++k) {
    problem_.SetWeight(k, 1.0);
  }
  if (!SolveWeighted(/*last=*/false) || !Graduate() || !Settle()) {
    return false;
  }
  LookAgain(HUGE_VAL);
  return true;
}

}  // namespace inceres::internal
