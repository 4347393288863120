#include "robust/suspect.h"

#include <cstddef>

namespace inceres::internal {

// The weights of one suspect by graduated non-convexity (docs/algorithms.md, "Graduated
// non-convexity"), and the same rounds played ahead with errors by foresight.

namespace {

// Foresight is to first order: what is decided is so for errors of this share as well.
constexpr double kSureShare = 0.75;

// With such a share of the errors that are foreseen; those that do not come to an end stay open.
std::vector<Suspect> PlayAhead(const Foresight& foresight, std::vector<Suspect> played,
                               double share, int max_rounds) {
  for (Suspect& suspect : played) {
    suspect.phase = Suspect::Phase::kUnforeseen;
  }
  std::vector<double> weights(played.size(), 0.0);
  bool is_settled = false;
  for (int i = 0; i < max_rounds && !is_settled; ++i) {
    const std::vector<double> errors = foresight.SquaredErrors(weights);
    is_settled = true;
    for (std::size_t k = 0; k < played.size(); ++k) {
      Suspect& suspect = played[k];
      suspect.weight = suspect.NextWeight(share * share * errors[k] / suspect.threshold);
      is_settled =
          is_settled && suspect.phase == Suspect::Phase::kSettled && suspect.weight == weights[k];
      weights[k] = suspect.weight;
    }
  }
  for (Suspect& suspect : played) {
    suspect.phase = is_settled ? Suspect::Phase::kSettled : Suspect::Phase::kOpen;
  }
  return played;
}

}  // namespace

// The history begins where the cost is convex up to its error; what is an inlier has none.
// In doubt is what is no inlier yet: s above 1. Its first weight lies between 0 and 1.
double Suspect::WeightOfNew(double s) {
  const bool in_doubt = schedule.Begin(s);
  phase = in_doubt ? Phase::kOpen : Phase::kSettled;
  return in_doubt ? schedule.Weight(s) : schedule.LastWeight(s);
}

// A settled one that truncation has kept and whose error has grown past its threshold begins anew,
// as if it had just come: it is not dropped at once. One that was dropped and has come below comes
// back at once, by LastWeight.
double Suspect::NextWeight(double s) {
  const bool truncated = schedule.kernel() == GncKernel::kTruncatedLeastSquares;
  switch (phase) {
    case Phase::kWaiting:
      return 0.0;
    case Phase::kForeseen:
      phase = Phase::kSettled;
      return 1.0;
    case Phase::kNew:
    case Phase::kUnforeseen:
      return WeightOfNew(s);
    case Phase::kSettled:
      return truncated && weight == 1.0 && s > 1.0 ? WeightOfNew(s) : schedule.LastWeight(s);
    case Phase::kOpen:
      break;
  }
  schedule.Advance();
  // A right one is drawn in by the first round or two: from there on it is as one that comes with
  // the error it has now.
  if (truncated && s <= 1.0) {
    phase = Phase::kSettled;
    return 1.0;
  }
  // Never backwards: an error that has grown changes nothing here.
  schedule.SkipTo(s);
  const double next = schedule.Weight(s);
  // Of Geman–McClure the weight is never 0 or 1: it is decided when μ is 1.
  const bool decided = truncated ? next == 0.0 || next == 1.0 : schedule.IsLast();
  phase = decided ? Phase::kSettled : Phase::kOpen;
  return next;
}

// What is right weighs as much as it will, what is wrong nothing. Where the rounds end in another
// way for smaller errors they are carried out.
std::vector<Suspect::Phase> ForeseePhases(const Foresight& foresight,
                                          const std::vector<Suspect>& waiting, int max_rounds) {
  const std::vector<Suspect> played = PlayAhead(foresight, waiting, 1.0, max_rounds);
  const std::vector<Suspect> nearer = PlayAhead(foresight, waiting, kSureShare, max_rounds);
  std::vector<Suspect::Phase> phases;
  for (std::size_t k = 0; k < waiting.size(); ++k) {
    const bool is_right = played[k].phase == Suspect::Phase::kSettled && played[k].weight == 1.0;
    const bool is_wrong = played[k].IsOut() && nearer[k].IsOut();
    phases.push_back(is_right   ? Suspect::Phase::kForeseen
                     : is_wrong ? Suspect::Phase::kSettled
                                : Suspect::Phase::kUnforeseen);
  }
  return phases;
}

}  // namespace inceres::internal
