#include "inceres/solver/gnc.h"

#include <algorithm>
#include <cmath>
#include <iterator>
#include <memory>
#include <utility>

#include "base/stopwatch.h"
#include "inceres/solver/solver.h"
#include "robust/gnc_schedule.h"
#include "robust/squared_errors.h"

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
      thresholds_.push_back(
          options.threshold_scale *
          ChiSquareQuantile(options.inlier_probability, graph.family(id.family).residual_size()));
    }
  }

  void Minimize();
  void HandOver(FactorGraph* graph) const;

 private:
  bool Fail(const Status& status);
  bool Measure();
  bool StartRound();
  bool SolveWeighted(bool last);
  bool Graduate();
  bool Settle();
  int SetWeights(bool last);
  double Largest() const;
  void LookAgain();
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
  std::vector<double> thresholds_;
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
  while (static_cast<int>(summary_.rounds.size()) < options_.max_rounds) {
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
    if (i > 0 && (!any || static_cast<int>(summary_.rounds.size()) >= options_.max_rounds)) {
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
void GncMinimizer::LookAgain() {
  int num_tried = 0;
  for (std::size_t i = 0; i < std::size(kSecondLooks);) {
    int num_near = 0;
    for (std::size_t k = 0; k < weights_.size(); ++k) {
      num_near += weights_[k]->weight == 0.0 && Ratio(k) <= kSecondLooks[i] ? 1 : 0;
    }
    const bool fits = static_cast<int>(summary_.rounds.size()) + 2 <= options_.max_rounds;
    if (num_near > num_tried && fits && TryWith(kSecondLooks[i])) {
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

void GncMinimizer::Minimize() {
  summary_.termination = Termination::kNoConvergence;
  if (SolveWeighted(/*last=*/false) && Graduate() && Settle()) {
    if (options_.kernel == GncKernel::kTruncatedLeastSquares) {
      LookAgain();
    }
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
