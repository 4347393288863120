#pragma once

#include <functional>
#include <unordered_map>
#include <vector>

#include <Eigen/Core>

#include "inceres/solver/marginalization.h"
#include "linearize/factor_linearizer.h"

namespace inceres::internal {

/// The linear system of one marginalization: the rows of the factors concerned, from which
/// landmarks are eliminated one by one as the rows come in, then the frames; what is left is
/// reduced to a square.
///
///     columns:   [ marginalized frames | kept variables | f ]
class MarginalSystem {
 public:
  using RowsOf = std::function<Status(FactorId, LinearizedFactor*)>;

  MarginalSystem(const FactorGraph& graph, const MarginalizationOptions& options)
      : graph_(graph), options_(options) {}

  /// Gives a variable its place: a marginalized one that moves, or a kept one. Marginalized ones
  /// come first.
  void AddMarginalized(VariableId id);
  void AddKept(VariableId id);
  bool Has(VariableId id) const { return columns_.count(id) > 0 || landmarks_.count(id) > 0; }

  /// Takes in the factors and eliminates. On rank loss *offenders gets the variables.
  Status Eliminate(const std::vector<FactorId>& factors, const RowsOf& rows_of,
                   std::vector<VariableId>* offenders);

  /// The square-root information of the kept variables and its right-hand side, [J e₀], after
  /// Eliminate.
  const Eigen::MatrixXd& result() const { return result_; }
  double fixed_cost() const { return fixed_cost_; }

 private:
  // The matrix that a landmark is eliminated in: itself, the frames it is seen from, f. Or that of
  // a factor without one.
  struct OwnColumns {
    int of_landmark = 0;                        // how many
    std::unordered_map<VariableId, int> first;  // of each variable
    std::vector<int> of_frames;                 // behind the landmark's: where they go
    Eigen::Index num_rows = 0;
  };

  int NumColumns() const { return num_frame_columns_ + num_kept_columns_; }
  OwnColumns OwnColumnsOf(VariableId landmark, const std::vector<FactorId>& factors) const;
  // What the factors of a landmark say of the frames, or a factor of none: −1.
  Status StackRows(VariableId landmark, const std::vector<FactorId>& factors, const RowsOf& rows_of,
                   std::vector<VariableId>* offenders);
  Status EliminateFrames(std::vector<VariableId>* offenders);
  Status RankLoss(const char* kind, const std::vector<VariableId>& offenders) const;
  void Append(const Eigen::MatrixXd& rows, Eigen::Index first_row, Eigen::Index first_column,
              const std::vector<int>& columns);

  const FactorGraph& graph_;
  const MarginalizationOptions& options_;
  std::vector<VariableId> frames_;
  std::unordered_map<VariableId, int> landmarks_;  // marginalized: their number
  std::unordered_map<VariableId, int> columns_;    // of all others: their first column
  int num_frame_columns_ = 0;
  int num_kept_columns_ = 0;
  std::vector<double> stack_;  // row-major, NumColumns() + 1 wide
  Eigen::MatrixXd result_;
  double fixed_cost_ = 0.0;
};

/// Cuts off the directions of [J e₀] (square J) that the options call noise: J becomes Σ Vᵀ of the
/// rest, padded with zeros. Returns how many. Directions come from the singular values of J, which
/// keep the digits that the eigenvalues of JᵀJ lose.
int TruncatePrior(const MarginalizationOptions& options, Eigen::MatrixXd* prior);

}  // namespace inceres::internal
