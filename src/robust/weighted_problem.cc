#include "robust/weighted_problem.h"

#include <algorithm>

#include "robust/squared_errors.h"

namespace inceres::internal {
namespace {

// Of the suspects: with more of them at weight zero, leaving their blocks out of H pays.
constexpr double kSparseShare = 0.05;

}  // namespace

WeightedProblem::WeightedProblem(const GncOptions& options, const std::vector<FactorId>& suspects,
                                 const FactorGraph& graph, GncSummary* summary)
    : options_(options), suspects_(suspects), graph_(graph), summary_(*summary) {
  for (const FactorId& id : suspects_) {
    weights_.push_back(std::make_shared<Weight>());
    graph_.SetLoss(id.family, id.index, weights_.back());
    thresholds_.push_back(options.threshold_scale *
                          ChiSquareQuantile(options.inlier_probability, ResidualSize(id.family)));
  }
}

std::vector<double> WeightedProblem::Weights() const {
  std::vector<double> weights;
  weights.reserve(weights_.size());
  for (const auto& weight : weights_) {
    weights.push_back(weight->weight);
  }
  return weights;
}

bool WeightedProblem::Fail(const Status& status) {
  if (!status.ok()) {
    summary_.termination = Termination::kFailure;
    summary_.message = status.message;
  }
  return status.ok();
}

bool WeightedProblem::Measure() {
  return Fail(SquaredErrors(
      graph_, suspects_, [this](VariableId id) { return graph_.Values(id); }, &squared_errors_));
}

bool WeightedProblem::Solve(bool last, double mu) {
  GncRound round;
  for (const auto& weight : weights_) {
    round.num_full += weight->weight == 1.0 ? 1 : 0;
    round.num_none += weight->weight == 0.0 ? 1 : 0;
  }
  if (options_.start && !Fail(options_.start(Weights(), &graph_))) {
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
  round.mu = last ? 0.0 : mu;
  round.cost = summary_.final_cost = solved.final_cost;
  round.num_iterations = solved.num_successful_steps + solved.num_unsuccessful_steps - 1;
  summary_.num_iterations += round.num_iterations;
  summary_.rounds.push_back(round);
  return Measure();
}

double WeightedProblem::LargestRatio() const {
  double largest = 0.0;
  for (std::size_t k = 0; k < weights_.size(); ++k) {
    largest = weights_[k]->weight > 0.0 ? std::max(largest, Ratio(k)) : largest;
  }
  return largest;
}

double WeightedProblem::TruncatedCost() const {
  double cost = summary_.final_cost;
  for (std::size_t k = 0; k < weights_.size(); ++k) {
    cost += 0.5 * (1.0 - weights_[k]->weight) * thresholds_[k];
  }
  return cost;
}

int WeightedProblem::NumInliers() const {
  int count = 0;
  for (std::size_t k = 0; k < suspects_.size(); ++k) {
    count += squared_errors_[k] <= thresholds_[k] ? 1 : 0;
  }
  return count;
}

void WeightedProblem::Restore(const Snapshot& snapshot) {
  graph_.mutable_state() = snapshot.state;
  squared_errors_ = snapshot.squared_errors;
  for (std::size_t k = 0; k < weights_.size(); ++k) {
    weights_[k]->weight = snapshot.weights[k];
  }
}

void WeightedProblem::Judge() {
  for (std::size_t k = 0; k < suspects_.size(); ++k) {
    const bool inlier = squared_errors_[k] <= thresholds_[k];
    summary_.verdicts.push_back(
        {suspects_[k], squared_errors_[k], thresholds_[k], weights_[k]->weight, inlier});
    summary_.num_outliers += inlier ? 0 : 1;
  }
}

void WeightedProblem::HandOver(FactorGraph* graph) const {
  graph->mutable_state() = graph_.state();
  for (std::size_t k = 0; k < suspects_.size(); ++k) {
    const double weight = weights_[k]->weight;
    graph->SetLoss(suspects_[k].family, suspects_[k].index,
                   weight == 1.0 ? nullptr : std::make_shared<ScaledLoss>(nullptr, weight));
  }
}

}  // namespace inceres::internal
