#pragma once

#include <map>
#include <memory>
#include <vector>

#include <Eigen/Core>

#include "inceres/solver/covariance.h"
#include "linear/selected_inverse.h"
#include "marginal/factored_normals.h"

namespace inceres::internal {

/// Blocks of the inverse of the factored normal equations. With V of a variable as GraphCovariance
/// defines it, which touches few frames, a block is a sum over these:
///
///     cov(a, b) = Σ_ij V_aiᵀ (S⁻¹)_ij V_bj + [a = b is a landmark] P_b⁻¹.
///
/// The blocks of S⁻¹ come from the factor (SelectedInverse) where that takes less than solving for
/// the columns of all that is wanted, and where the factor has them; else from solves.
class CovarianceSystem {
 public:
  /// `has_landmarks`: whether Factorize may be given any.
  CovarianceSystem(const FactorGraph& graph, const std::vector<double>& state,
                   const CovarianceOptions& options, bool has_landmarks);

  bool Has(VariableId id) const { return layout_.position[id] >= 0; }
  /// What Factorize has found to be open.
  const RankDeficiency& deficiency() const { return normals_.deficiency(); }

  /// Linearizes, eliminates and factors, and makes ready what Product needs for these pairs, of
  /// variables that it Has. kSingular names a variable that is not determined.
  Status Factorize(const GraphCovariance::Pairs& pairs);
  /// cov(a, b) of one of the pairs.
  Eigen::MatrixXd Product(VariableId a, VariableId b) const;

 private:
  struct Column {
    std::vector<int> frames;
    std::vector<int> rows;  // of V, where each of these begins
    Eigen::MatrixXd V;      // rows of these frames × tangent size
    Eigen::MatrixXd P_inv;  // of landmarks
    Eigen::MatrixXd X;      // S⁻¹ V, where it was solved for
  };

  void MakeColumnByRows(int landmark, Column* column);
  void MakeColumn(VariableId id);
  void SubtractW();
  Status SolveFor(VariableId id);
  Status InvertFactor();
  Status SolveForPairs(const GraphCovariance::Pairs& pairs);
  Status Prepare(const GraphCovariance::Pairs& pairs);
  bool IsSelected(const Column& a, const Column& b) const;
  Eigen::MatrixXd FromSolution(const Column& a, const Column& b) const;
  Eigen::MatrixXd FromInverse(const Column& a, const Column& b) const;

  FactoredNormals normals_;
  const Layout& layout_;
  std::unique_ptr<SelectedInverse> inverse_;
  std::map<VariableId, Column> columns_;
};

}  // namespace inceres::internal
