#include "robust/scaled_thresholds.h"

#include <algorithm>
#include <cstddef>
#include <map>

namespace inceres::internal {
namespace {

// Of a threshold: a lower one is worth another graduation if it is below this; and how often.
constexpr double kLowerShare = 0.7;
constexpr int kMaxScales = 8;
// Thresholds by the scale of the errors up to which right ones may lie that were left out: without
// them the solution has moved away from them.
constexpr double kNear = 64.0;
// Of the inliers by thresholds as they are given: fewer are too few.
constexpr double kLeastInliers = 0.9;
// Errors up to so many thresholds by the scale may be those of right ones.
constexpr double kTails = 4.0;
// Times: thresholds by the scale of the errors at last, against those that wrong ones were looked
// for with.
constexpr double kRelaxation = 2.0;

// Of ThresholdScale.
constexpr double kProbabilities[] = {0.5, 0.75, 0.9, 0.95};
constexpr std::size_t kLeastCount = 20;
// Times the ratio at the median: what is further out is not the tail of right ones.
constexpr double kLongestTail = 10.0;
// Errors of measurements that are exact, or that nothing contradicts, are rounding.
constexpr double kLeastScale = 1e-8;

}  // namespace

// Matching of quantiles (Huber & Ronchetti 2009, section 5.1): how much smaller measured errors
// are than a chi-square distribution of unit information lets expect. The largest of several
// quantiles is taken, since real errors have longer tails than their middle tells; how far it may
// exceed the median's ratio is limited, so that wrong measurements among them do not set the
// scale.
double ThresholdScale(int degrees, std::vector<double>* squared_errors) {
  std::vector<double>& errors = *squared_errors;
  if (errors.size() < kLeastCount) {
    return 1.0;
  }
  // Order statistics: an entry at or below each probability, no interpolation.
  std::sort(errors.begin(), errors.end());
  double largest = 0.0, at_median = 0.0;
  for (const double probability : kProbabilities) {
    const auto at = static_cast<std::size_t>(probability * static_cast<double>(errors.size() - 1));
    largest = std::max(largest, errors[at] / ChiSquareQuantile(probability, degrees));
    // The median is the first one.
    at_median = probability == 0.5 ? largest : at_median;
  }
  return std::clamp(kTightTails * std::min(largest, kLongestTail * at_median), kLeastScale, 1.0);
}

// Per suspect: its threshold by the errors, up to these limits, of its family.
std::vector<double> ScaledThresholds::ByErrors(const std::vector<double>& limits) const {
  std::map<FamilyId, std::vector<double>> errors;
  for (std::size_t k = 0; k < limits.size(); ++k) {
    if (problem_.squared_errors()[k] <= limits[k]) {
      errors[problem_.FamilyOf(k)].push_back(problem_.squared_errors()[k]);
    }
  }
  std::map<FamilyId, double> scales;
  for (auto& [family, squared] : errors) {
    scales[family] = ThresholdScale(problem_.ResidualSize(family), &squared);
  }
  std::vector<double> thresholds = nominal_;
  for (std::size_t k = 0; k < thresholds.size(); ++k) {
    const auto scale = scales.find(problem_.FamilyOf(k));
    thresholds[k] *= scale != scales.end() ? scale->second : 1.0;
  }
  return thresholds;
}

// By the errors of the inliers there are, those in the tails among them: else each scale would be
// that of what the one before has cut off. False if no threshold is lower by a good deal.
bool ScaledThresholds::Tighten() {
  std::vector<double>& thresholds = problem_.thresholds();
  std::vector<double> limits = nominal_;
  for (std::size_t k = 0; k < limits.size(); ++k) {
    limits[k] = std::min(nominal_[k], kTails * thresholds[k]);
  }
  const std::vector<double> tighter = ByErrors(limits);
  bool any = false;
  for (std::size_t k = 0; k < limits.size(); ++k) {
    if (tighter[k] < kLowerShare * thresholds[k]) {
      thresholds[k] = tighter[k];
      any = true;
    }
  }
  return any;
}

// Wrong suspects are out, and what they had bent is straight: from there right ones in the tails of
// the errors come back, and wrong ones, which are far, do not. False if a solve has failed.
bool ScaledThresholds::Relax() {
  const std::vector<double> tight = ByErrors(nominal_);
  std::vector<double>& thresholds = problem_.thresholds();
  for (std::size_t k = 0; k < thresholds.size(); ++k) {
    thresholds[k] = std::max(thresholds[k], std::min(nominal_[k], kRelaxation * tight[k]));
  }
  graduation_.BeginRounds();
  if (!graduation_.Settle()) {
    return false;
  }
  graduation_.LookAgain(kNear);
  return true;
}

bool ScaledThresholds::Solve() {
  const int num_inliers = problem_.NumInliers();
  const WeightedProblem::Snapshot before = problem_.Save();
  const GncSummary told = problem_.summary();
  for (int i = 0; i < kMaxScales && Tighten(); ++i) {
    graduation_.BeginRounds();
    if (!graduation_.SolveToTheEnd()) {
      return false;
    }
  }
  if (!graduation_.HasBegunAnew()) {
    return true;  // the thresholds suit the errors
  }
  if (!Relax()) {
    return false;
  }
  if (problem_.NumInliers() < kLeastInliers * num_inliers) {
    problem_.Restore(before);
    problem_.thresholds() = nominal_;
    problem_.summary() = told;
  }
  return true;
}

}  // namespace inceres::internal
