#include "inceres/solver/gnc.h"

#include <algorithm>
#include <cmath>
#include <iterator>
#include <map>
#include <memory>
#include <utility>

#include "base/stopwatch.h"
#include "inceres/solver/solver.h"
#include "robust/gnc_schedule.h"
#include "robust/squared_errors.h"
#include "robust/threshold_scale.h"

namespace inceres {
namespace internal {
namespace {

// Verdicts that go round in a circle, because factors at the threshold decide about each other, are
// left as they are after so many rounds.
constexpr int kMaxLastRounds = 10;

// Squared errors, in thresholds, up to which suspects that were left out are tried once more: what
// a wrong inlier has displaced is near, what is wrong itself is far.
constexpr double kSecondLooks[] = {4.0, 16.0, 64.0, 256.0};

// Of the cost: less is no gain.
constexpr double kLeastGain = 1e-6;

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

// Of the suspects: with more of them at weight zero, leaving their blocks out of H pays.
constexpr double kSparseShare = 0.05;

// What is left of a suspect: w ½‖f‖². Its weight changes between solves, and nothing else does, so
// the structure that a Solver keeps stays good.
class GncWeight final : public Loss {
 public:
  void Evaluate(double s, double rho[3]) const override {
    rho[0] = weight * s;
    rho[1] = weight;
    rho[2] = 0.0;
  }
  double weight = 1.0;
};

class GncMinimizer {
 public:
  GncMinimizer(const GncOptions& options, const std::vector<FactorId>& suspects,
               const FactorGraph& graph, GncSummary* summary)
      : options_(options),
        suspects_(suspects),
        graph_(graph),
        schedule_(options.kernel, options.step),
        summary_(*summary) {
    for (const FactorId& id : suspects_) {
      weights_.push_back(std::make_shared<GncWeight>());
      graph_.SetLoss(id.family, id.index, weights_.back());
      nominal_.push_back(
          options.threshold_scale *
          ChiSquareQuantile(options.inlier_probability, graph.family(id.family).residual_size()));
    }
    thresholds_ = nominal_;
  }

  void Minimize();
  void HandOver(FactorGraph* graph) const;

 private:
  bool Fail(const Status& status);
  bool Measure();
  bool StartRound();
  bool SolveWeighted(bool last);
  bool SolveToTheEnd();
  bool TightenThresholds();
  bool RelaxThresholds();
  bool SolveByScale();
  int NumInliers() const;
  std::vector<double> ThresholdsByErrors(const std::vector<double>& limits) const;
  bool HasRoundsLeft(std::size_t count) const {
    return summary_.rounds.size() + count <=
           rounds_before_ + static_cast<std::size_t>(options_.max_rounds);
  }
  bool Graduate();
  bool Settle();
  int SetWeights(bool last);
  double Largest() const;
  void LookAgain(double farthest);
  bool TryWith(double limit);
  double TruncatedCost() const;
  void Judge();
  double Ratio(std::size_t k) const { return squared_errors_[k] / thresholds_[k]; }

  const GncOptions& options_;
  const std::vector<FactorId>& suspects_;
  FactorGraph graph_;
  GncSchedule schedule_;
  GncSummary& summary_;
  std::vector<std::shared_ptr<GncWeight>> weights_;
  std::vector<double> nominal_;  // thresholds, as the information has them
  std::vector<double> thresholds_;
  std::size_t rounds_before_ = 0;  // the thresholds were set
  std::vector<double> squared_errors_;
  Solver solver_;
};

bool GncMinimizer::Fail(const Status& status) {
  if (!status.ok()) {
    summary_.termination = Termination::kFailure;
    summary_.message = status.message;
  }
  return status.ok();
}

bool GncMinimizer::Measure() {
  return Fail(SquaredErrors(
      graph_, suspects_, [this](VariableId id) { return graph_.Values(id); }, &squared_errors_));
}

bool GncMinimizer::StartRound() {
  if (!options_.start) {
    return true;
  }
  std::vector<double> weights;
  weights.reserve(weights_.size());
  for (const auto& weight : weights_) {
    weights.push_back(weight->weight);
  }
  return Fail(options_.start(weights, &graph_));
}

// One weighted problem; false if it could not be solved.
bool GncMinimizer::SolveWeighted(bool last) {
  GncRound round;
  for (const auto& weight : weights_) {
    round.num_full += weight->weight == 1.0 ? 1 : 0;
    round.num_none += weight->weight == 0.0 ? 1 : 0;
  }
  if (!StartRound()) {
    return false;
  }
  SolverOptions options = options_.solver;
  if (!last) {
    options.max_num_iterations = std::min(options.max_num_iterations, options_.iterations_a_round);
  }
  options.dynamic_sparsity = options.dynamic_sparsity ||
                             round.num_none > kSparseShare * static_cast<double>(weights_.size());
  const Summary solved = solver_.Solve(options, &graph_);
  if (!solved.IsSolutionUsable()) {
    summary_.termination = solved.termination;
    summary_.message = solved.message + (solved.detail.empty() ? "" : " " + solved.detail);
    return false;
  }
  if (summary_.rounds.empty()) {
    summary_.initial_cost = solved.initial_cost;
  }
  round.mu = last ? 0.0 : schedule_.mu();
  round.cost = summary_.final_cost = solved.final_cost;
  round.num_iterations = solved.num_successful_steps + solved.num_unsuccessful_steps - 1;
  summary_.num_iterations += round.num_iterations;
  summary_.rounds.push_back(round);
  return Measure();
}

// The weights of the residuals now; how many of them have changed.
int GncMinimizer::SetWeights(bool last) {
  int num_changed = 0;
  for (std::size_t k = 0; k < weights_.size(); ++k) {
    const double weight = last ? schedule_.LastWeight(Ratio(k)) : schedule_.Weight(Ratio(k));
    num_changed += weight != weights_[k]->weight ? 1 : 0;
    weights_[k]->weight = weight;
  }
  return num_changed;
}

// The largest error of those that count.
double GncMinimizer::Largest() const {
  double largest = 0.0;
  for (std::size_t k = 0; k < weights_.size(); ++k) {
    largest = weights_[k]->weight > 0.0 ? std::max(largest, Ratio(k)) : largest;
  }
  return largest;
}

// From the convex cost to the last one. False if a solve has failed.
bool GncMinimizer::Graduate() {
  if (!schedule_.Begin(Largest())) {
    return true;
  }
  std::vector<bool> left_out_before;
  while (HasRoundsLeft(1)) {
    SetWeights(/*last=*/false);
    const bool decided = std::all_of(weights_.begin(), weights_.end(), [](const auto& weight) {
      return weight->weight == 0.0 || weight->weight == 1.0;
    });
    if (schedule_.IsLast() || (options_.kernel == GncKernel::kTruncatedLeastSquares && decided)) {
      return true;
    }
    if (!SolveWeighted(/*last=*/false)) {
      return false;
    }
    std::vector<bool> left_out(weights_.size());
    for (std::size_t k = 0; k < weights_.size(); ++k) {
      left_out[k] = weights_[k]->weight == 0.0;
    }
    schedule_.Advance();
    if (left_out == left_out_before) {
      schedule_.SkipTo(Largest());
    }
    left_out_before = std::move(left_out);
  }
  return true;
}

// The last cost itself, by its weights, until those agree with what they lead to.
bool GncMinimizer::Settle() {
  for (int i = 0; i < kMaxLastRounds; ++i) {
    const bool any = SetWeights(/*last=*/true) > 0;
    if (i > 0 && (!any || !HasRoundsLeft(1))) {
      summary_.termination = any ? Termination::kNoConvergence : Termination::kConvergence;
      break;
    }
    if (!SolveWeighted(/*last=*/true)) {
      return false;
    }
  }
  summary_.message = summary_.termination == Termination::kConvergence
                         ? "The weights have settled."
                         : "The weights have not settled; the state is that of the last round.";
  return true;
}

// What truncated least squares minimizes: ½ Σ min(‖f‖², c²), and the other factors.
double GncMinimizer::TruncatedCost() const {
  double cost = summary_.final_cost;
  for (std::size_t k = 0; k < weights_.size(); ++k) {
    cost += 0.5 * (1.0 - weights_[k]->weight) * thresholds_[k];
  }
  return cost;
}

// Solves with the suspects that were left out with errors up to a limit as inliers, and lets the
// weights settle from there. True if that costs less; else everything is as it was.
bool GncMinimizer::TryWith(double limit) {
  const double cost = TruncatedCost();
  const std::vector<double> state = graph_.state();
  const std::vector<double> errors = squared_errors_;
  const GncSummary before = summary_;
  std::vector<double> weights;
  for (std::size_t k = 0; k < weights_.size(); ++k) {
    weights.push_back(weights_[k]->weight);
    weights_[k]->weight = Ratio(k) <= limit ? 1.0 : 0.0;
  }
  if (SolveWeighted(/*last=*/true) && Settle() && TruncatedCost() < cost * (1.0 - kLeastGain)) {
    return true;
  }
  graph_.mutable_state() = state;
  squared_errors_ = errors;
  for (std::size_t k = 0; k < weights_.size(); ++k) {
    weights_[k]->weight = weights[k];
  }
  const std::vector<GncRound> rounds = std::move(summary_.rounds);
  const int num_iterations = summary_.num_iterations;
  summary_ = before;  // but for the work that it took
  summary_.rounds = rounds;
  summary_.num_iterations = num_iterations;
  return false;
}

// A wrong suspect that was taken for right keeps a few right ones out, whose errors are then small
// compared to those of wrong ones. Every step down begins anew; a limit below which nobody new is
// found costs nothing.
void GncMinimizer::LookAgain(double farthest) {
  int num_tried = 0;
  for (std::size_t i = 0; i < std::size(kSecondLooks) && kSecondLooks[i] <= farthest;) {
    int num_near = 0;
    for (std::size_t k = 0; k < weights_.size(); ++k) {
      num_near += weights_[k]->weight == 0.0 && Ratio(k) <= kSecondLooks[i] ? 1 : 0;
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

void GncMinimizer::Judge() {
  for (std::size_t k = 0; k < suspects_.size(); ++k) {
    const bool inlier = squared_errors_[k] <= thresholds_[k];
    summary_.verdicts.push_back(
        {suspects_[k], squared_errors_[k], thresholds_[k], weights_[k]->weight, inlier});
    summary_.num_outliers += inlier ? 0 : 1;
  }
}

// From full weights on: what a wrong suspect has bent that was taken for right holds it.
bool GncMinimizer::SolveToTheEnd() {
  for (const auto& weight : weights_) {
    weight->weight = 1.0;
  }
  if (!SolveWeighted(/*last=*/false) || !Graduate() || !Settle()) {
    return false;
  }
  if (options_.kernel == GncKernel::kTruncatedLeastSquares) {
    LookAgain(HUGE_VAL);
  }
  return true;
}

// Per suspect: its threshold by the errors, up to these limits, of its family.
std::vector<double> GncMinimizer::ThresholdsByErrors(const std::vector<double>& limits) const {
  std::map<FamilyId, std::vector<double>> errors;
  for (std::size_t k = 0; k < suspects_.size(); ++k) {
    if (squared_errors_[k] <= limits[k]) {
      errors[suspects_[k].family].push_back(squared_errors_[k]);
    }
  }
  std::map<FamilyId, double> scales;
  for (auto& [family, squared] : errors) {
    scales[family] = ThresholdScale(graph_.family(family).residual_size(), &squared);
  }
  std::vector<double> thresholds = nominal_;
  for (std::size_t k = 0; k < suspects_.size(); ++k) {
    const auto scale = scales.find(suspects_[k].family);
    thresholds[k] *= scale != scales.end() ? scale->second : 1.0;
  }
  return thresholds;
}

// By the errors of the inliers there are, those in the tails among them: else each scale would be
// that of what the one before has cut off. False if no threshold is lower by a good deal.
bool GncMinimizer::TightenThresholds() {
  std::vector<double> limits = nominal_;
  for (std::size_t k = 0; k < suspects_.size(); ++k) {
    limits[k] = std::min(nominal_[k], kTails * thresholds_[k]);
  }
  const std::vector<double> tighter = ThresholdsByErrors(limits);
  bool any = false;
  for (std::size_t k = 0; k < suspects_.size(); ++k) {
    if (tighter[k] < kLowerShare * thresholds_[k]) {
      thresholds_[k] = tighter[k];
      any = true;
    }
  }
  return any;
}

// Wrong suspects are out, and what they had bent is straight: from there right ones in the tails of
// the errors come back, and wrong ones, which are far, do not. False if a solve has failed.
bool GncMinimizer::RelaxThresholds() {
  const std::vector<double> tight = ThresholdsByErrors(nominal_);
  for (std::size_t k = 0; k < suspects_.size(); ++k) {
    thresholds_[k] = std::max(thresholds_[k], std::min(nominal_[k], kRelaxation * tight[k]));
  }
  rounds_before_ = summary_.rounds.size();
  if (!Settle()) {
    return false;
  }
  if (options_.kernel == GncKernel::kTruncatedLeastSquares) {
    LookAgain(kNear);
  }
  return true;
}

int GncMinimizer::NumInliers() const {
  int count = 0;
  for (std::size_t k = 0; k < suspects_.size(); ++k) {
    count += squared_errors_[k] <= thresholds_[k] ? 1 : 0;
  }
  return count;
}

// With thresholds by the scale of the errors. Where that leaves out many more it was not their
// scale, as with few loops, whose errors say little: all is then as it was. False if a solve has
// failed.
bool GncMinimizer::SolveByScale() {
  const int num_inliers = NumInliers();
  const std::vector<double> state = graph_.state(), errors = squared_errors_;
  const GncSummary before = summary_;
  std::vector<double> weights;
  for (const auto& weight : weights_) {
    weights.push_back(weight->weight);
  }
  for (int i = 0; i < kMaxScales && TightenThresholds(); ++i) {
    rounds_before_ = summary_.rounds.size();
    if (!SolveToTheEnd()) {
      return false;
    }
  }
  if (rounds_before_ == 0) {
    return true;  // the thresholds suit the errors
  }
  if (!RelaxThresholds()) {
    return false;
  }
  if (NumInliers() < kLeastInliers * num_inliers) {
    graph_.mutable_state() = state;
    squared_errors_ = errors;
    thresholds_ = nominal_;
    for (std::size_t k = 0; k < weights_.size(); ++k) {
      weights_[k]->weight = weights[k];
    }
    summary_ = before;
  }
  return true;
}

void GncMinimizer::Minimize() {
  summary_.termination = Termination::kNoConvergence;
  bool solved = SolveToTheEnd();
  solved = solved && (!options_.estimate_scale || SolveByScale());
  if (solved) {
    Judge();
  }
}

void GncMinimizer::HandOver(FactorGraph* graph) const {
  graph->mutable_state() = graph_.state();
  for (std::size_t k = 0; k < suspects_.size(); ++k) {
    const double weight = weights_[k]->weight;
    graph->SetLoss(suspects_[k].family, suspects_[k].index,
                   weight == 1.0 ? nullptr : std::make_shared<ScaledLoss>(nullptr, weight));
  }
}

}  // namespace
}  // namespace internal

GncSummary SolveGnc(const GncOptions& options, const std::vector<FactorId>& suspects,
                    FactorGraph* graph) {
  const double start = internal::NowInSeconds();
  GncSummary summary;
  Status status = options.Validate();
  status = status.ok() ? graph->Validate() : status;
  status = status.ok() ? internal::CheckSuspects(*graph, suspects) : status;
  if (status.ok()) {
    internal::GncMinimizer minimizer(options, suspects, *graph, &summary);
    minimizer.Minimize();
    if (summary.IsSolutionUsable()) {
      minimizer.HandOver(graph);
    }
  } else {
    summary.message = status.message;
  }
  summary.seconds = internal::NowInSeconds() - start;
  return summary;
}

}  // namespace inceres
