#include "robust/weighted_problem.h"

#include <algorithm>
#include <utility>

#include "robust/squared_errors.h"

namespace inceres::internal {

// The weighted least-squares problem of a round, ½ Σ w_k ‖f_k‖² + the other factors, on a copy of
// the graph. Each suspect has a loss object of its own that reads its weight where it stands, so a
// new weight is an assignment and no change of structure: the Solver keeps what it has analyzed.
//
// Kept from solve to solve: values, weights, thresholds c², and the squared errors at the values,
// which are measured after each solve, without losses.

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
    thresholds_.push_back(ThresholdOf(options, graph_.family(id.family)));
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

// Passes Ok through, and writes a failure into the summary.
bool WeightedProblem::Fail(const Status& status) {
  if (!status.ok()) {
    summary_.termination = Termination::kFailure;
    summary_.message = status.message;
  }
  return status.ok();
}

void WeightedProblem::SetWeights(const std::vector<double>& weights) {
  for (std::size_t k = 0; k < weights_.size(); ++k) {
    weights_[k]->weight = weights[k];
  }
}

bool WeightedProblem::Measure() {
  return Fail(SquaredErrors(
      graph_, suspects_, [this](VariableId id) { return graph_.Values(id); }, &squared_errors_));
}

// Of a round in the graduation only a few steps are taken, for its weights are not the last ones.
// The summary's costs are of weighted problems; TruncatedCost makes them comparable.
bool WeightedProblem::Solve(bool last, double mu) {
  GncRound round;
  for (const auto& weight : weights_) {
    round.num_full += weight->weight == 1.0 ? 1 : 0;
    round.num_none += weight->weight == 0.0 ? 1 : 0;
  }
  // Without a start of its own a round begins at the values that the solve before has left.
  if (options_.start && !Fail(options_.start(Weights(), &graph_))) {
    return false;
  }
  SolverOptions options = options_.solver;
  if (!last) {
    options.max_num_iterations = std::min(options.max_num_iterations, options_.iterations_a_round);
  }
  // Weight zero makes the Jacobian of a factor zero. Finding that costs something at each
  // linearization. Linear models that eliminate, iterate or drop Jacobians do without.
  SolverOptions sparse = options;
  sparse.dynamic_sparsity = true;
  if (round.num_none > kSparseShare * static_cast<double>(weights_.size()) &&
      sparse.Validate().ok()) {
    options = std::move(sparse);
  }
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
  // Iteration 0 counts as a successful step. Where nothing can move, both counts are -1.
  round.num_iterations =
      std::max(0, solved.num_successful_steps + solved.num_unsuccessful_steps - 1);
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

// With weights 0 and 1 this is ½ Σ min(‖f‖², c²) wherever they agree with the errors: final_cost
// has the ½‖f‖² of those of weight 1, and who is left out costs ½ c².
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

// Not the summary, which the caller has its own copy of, nor the thresholds.
void WeightedProblem::Restore(const Snapshot& snapshot) {
  graph_.mutable_state() = snapshot.state;
  squared_errors_ = snapshot.squared_errors;
  SetWeights(snapshot.weights);
}

void WeightedProblem::Judge() {
  for (std::size_t k = 0; k < suspects_.size(); ++k) {
    AddVerdict(suspects_[k], squared_errors_[k], thresholds_[k], weights_[k]->weight, &summary_);
  }
}

// The loss objects here refer to weights that end with this object; the graph gets losses that
// stand by themselves, and none where the weight is 1.
void WeightedProblem::HandOver(FactorGraph* graph) const {
  graph->mutable_state() = graph_.state();
  for (std::size_t k = 0; k < suspects_.size(); ++k) {
    const double weight = weights_[k]->weight;
    graph->SetLoss(suspects_[k].family, suspects_[k].index,
                   weight == 1.0 ? nullptr : std::make_shared<ScaledLoss>(nullptr, weight));
  }
}

}  // namespace inceres::internal
