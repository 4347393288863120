#pragma once

#include <cstddef>
#include <memory>
#include <vector>

#include "inceres/problem/factor_graph.h"
#include "inceres/problem/losses.h"
#include "inceres/solver/gnc.h"
#include "inceres/solver/solver.h"
#include "inceres/status.h"

namespace inceres::internal {

/// A copy of a graph whose suspects have weights, ½ w ‖f‖², that change from one solve to the next,
/// with the squared errors they have after each and the thresholds these are measured by. Nothing
/// else about it changes, so the structure that its Solver keeps stays good. What the solves did
/// goes into the summary; so does a failure. Threads: as Solve.
class WeightedProblem {
 public:
  /// Of weights 1 and thresholds as the options have them. All but the graph must outlive it.
  WeightedProblem(const GncOptions& options, const std::vector<FactorId>& suspects,
                  const FactorGraph& graph, GncSummary* summary);

  std::size_t num_suspects() const { return suspects_.size(); }
  FamilyId FamilyOf(std::size_t k) const { return suspects_[k].family; }
  int ResidualSize(FamilyId family) const { return graph_.family(family).residual_size(); }
  double weight(std::size_t k) const { return weights_[k]->weight; }
  void SetWeights(const std::vector<double>& weights);
  std::vector<double> Weights() const;
  std::vector<double>& thresholds() { return thresholds_; }
  const std::vector<double>& thresholds() const { return thresholds_; }
  const std::vector<double>& squared_errors() const { return squared_errors_; }
  /// Squared error, in thresholds.
  double Ratio(std::size_t k) const { return squared_errors_[k] / thresholds_[k]; }
  GncSummary& summary() { return summary_; }

  /// One weighted problem, from the start that the options give it, and the squared errors it leads
  /// to. `mu` is for its row in the summary. False if it could not be solved.
  bool Solve(bool last, double mu);

  /// The largest error of those that count, in thresholds.
  double LargestRatio() const;
  /// What truncated least squares minimizes: ½ Σ min(‖f‖², c²), and the other factors.
  double TruncatedCost() const;
  /// Suspects below their threshold.
  int NumInliers() const;

  /// What a solve changes, but for the summary.
  struct Snapshot {
    std::vector<double> state, squared_errors, weights;
  };
  Snapshot Save() const { return {graph_.state(), squared_errors_, Weights()}; }
  void Restore(const Snapshot& snapshot);

  /// Tells the verdicts.
  void Judge();
  /// Leaves values and weights in a graph like the one it was made of.
  void HandOver(FactorGraph* graph) const;

 private:
  // What is left of a suspect: w ½‖f‖².
  class Weight final : public Loss {
   public:
    void Evaluate(double s, double rho[3]) const override {
      rho[0] = weight * s;
      rho[1] = weight;
      rho[2] = 0.0;
    }
    double weight = 1.0;
  };

  bool Fail(const Status& status);
  bool Measure();

  const GncOptions& options_;
  const std::vector<FactorId>& suspects_;
  FactorGraph graph_;
  GncSummary& summary_;
  std::vector<std::shared_ptr<Weight>> weights_;
  std::vector<double> thresholds_;
  std::vector<double> squared_errors_;
  Solver solver_;
};

}  // namespace inceres::internal
