#include "robust/graduation.h"

#include <algorithm>
#include <cmath>
#include <iterator>
#include <utility>

namespace inceres::internal {

// Graduated non-convexity (docs/algorithms.md, section of that name; Yang et al. 2020, equations 10
// to 14). By Black & Rangarajan the robust cost is a minimum over weights, so the rounds alternate:
// weights in closed form from the errors s = ‖f‖²/c², a few steps of the weighted problem, and μ
// one step on. GncSchedule has μ and the weights, WeightedProblem the values and the errors.
//
// Three phases: Graduate, from the convex cost on; Settle, with weights of the last cost until they
// agree with the errors they lead to; LookAgain, which corrects what the graduation has decided
// wrongly. All of them count rounds against max_rounds.

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

// Of the residuals now.
std::vector<double> Graduation::WeightsNow(bool last) const {
  std::vector<double> weights;
  for (std::size_t k = 0; k < problem_.num_suspects(); ++k) {
    const double ratio = problem_.Ratio(k);
    weights.push_back(last ? schedule_.LastWeight(ratio) : schedule_.Weight(ratio));
  }
  return weights;
}

// From the convex cost to the last one. False if a solve has failed.
bool Graduation::Graduate() {
  // All suspects are inliers as they are.
  if (!schedule_.Begin(problem_.LargestRatio())) {
    return true;
  }
  std::vector<bool> left_out_before;
  while (HasRoundsLeft(1)) {
    const std::vector<double> weights = WeightsNow(/*last=*/false);
    problem_.SetWeights(weights);
    // Truncated least squares has no last μ: it ends when no weight lies between 0 and 1.
    // Geman–McClure ends at μ = 1, with weights that Settle sets.
    const bool decided = std::all_of(weights.begin(), weights.end(),
                                     [](double weight) { return weight == 0.0 || weight == 1.0; });
    if (schedule_.IsLast() || (options_.kernel == GncKernel::kTruncatedLeastSquares && decided)) {
      return true;
    }
    if (!SolveWeighted(/*last=*/false)) {
      return false;
    }
    // A round that leaves out the same suspects as the one before would be followed by more of the
    // kind: μ skips to where it would begin for those that still count, whose largest error has
    // become smaller. Never backwards.
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
// Each round sets the weights by the errors of the solve before. It ends when none changes; the
// first round solves in any case, to the end and not for a few steps. Weights that nothing will be
// solved with are not set: state, cost and weights are always those of one problem.
bool Graduation::Settle() {
  GncSummary& summary = problem_.summary();
  summary.termination = Termination::kNoConvergence;
  for (int i = 0; i <= kMaxLastRounds; ++i) {
    const std::vector<double> weights = WeightsNow(/*last=*/true);
    if (i > 0 && weights == problem_.Weights()) {
      summary.termination = Termination::kConvergence;
      break;
    }
    if (i > 0 && (i == kMaxLastRounds || !HasRoundsLeft(1))) {
      break;
    }
    problem_.SetWeights(weights);
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
  // To take back all but the work if the trial gains nothing.
  const GncSummary told = summary;
  std::vector<double> weights;
  for (std::size_t k = 0; k < problem_.num_suspects(); ++k) {
    // Those that were inliers before stay so: their ratio is at most 1.
    weights.push_back(problem_.Ratio(k) <= limit ? 1.0 : 0.0);
  }
  problem_.SetWeights(weights);
  // Costs with different weights compare by what truncated least squares minimizes, in which who is
  // left out costs its threshold.
  if (SolveWeighted(/*last=*/true) && Settle() &&
      problem_.TruncatedCost() < cost * (1.0 - kLeastGain)) {
    return true;
  }
  problem_.Restore(before);
  if (summary.termination == Termination::kUserFailure) {  // an abort ends all of it
    return false;
  }
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
  // Geman–McClure never leaves anybody out.
  if (options_.kernel != GncKernel::kTruncatedLeastSquares) {
    return;
  }
  int num_tried = 0;
  for (std::size_t i = 0; i < std::size(kSecondLooks) && kSecondLooks[i] <= farthest &&
                          problem_.summary().termination != Termination::kUserFailure;) {
    int num_near = 0;
    for (std::size_t k = 0; k < problem_.num_suspects(); ++k) {
      num_near += problem_.weight(k) == 0.0 && problem_.Ratio(k) <= kSecondLooks[i] ? 1 : 0;
    }
    // Tried only if this limit takes in somebody whom the limits before did not. Two rounds at
    // least: the trial, and one to settle.
    if (num_near > num_tried && HasRoundsLeft(2) && TryWith(kSecondLooks[i])) {
      i = 0;
      num_tried = 0;
    } else {
      num_tried = std::max(num_tried, num_near);
      ++i;
    }
  }
}

// All weights 1: the least-squares solution, whose errors say where the graduation begins.
bool Graduation::SolveToTheEnd() {
  problem_.SetWeights(std::vector<double>(problem_.num_suspects(), 1.0));
  // With other thresholds this is the second time: the first solve is before a graduation again.
  schedule_ = GncSchedule(options_.kernel, options_.step);
  if (!SolveWeighted(/*last=*/false) || !Graduate() || !Settle()) {
    return false;
  }
  LookAgain(HUGE_VAL);
  return true;
}

}  // namespace inceres::internal
