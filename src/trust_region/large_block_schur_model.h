#pragma once

#include <memory>
#include <vector>

#include <Eigen/Cholesky>
#include <Eigen/Core>

#include "linearize/hessian.h"
#include "trust_region/conjugate_gradients_model.h"
#include "trust_region/kept_blocks.h"

namespace inceres::internal {

/// Steps by conjugate gradients on S with variables of any size eliminated, where IterativeModel
/// eliminates landmarks of up to four degrees of freedom: what Ceres's ITERATIVE_SCHUR does with a
/// first group of, say, poses. With the eliminated ones e and the others f,
///
///     S δ_f = η_f − H_fe H_ee⁻¹ η_e,   S = H_ff − H_fe H_ee⁻¹ H_ef,
///     δ_e = H_ee⁻¹ (η_e − H_ef δ_f),
///
/// H damped, H_ee block-diagonal. A product takes H_ff, and H_ef twice. Cost: that of the blocks of
/// H. Single-threaded but for H itself. Preconditioners: all but kSubset and kTwoLevel. Source:
/// Ceres's implicit_schur_complement.cc; docs/ceres_contract.md, "Conjugate gradients".
class LargeBlockSchurModel final : public ConjugateGradientsModel {
 public:
  /// Of an evaluator whose layout eliminates nothing.
  LargeBlockSchurModel(const SolverOptions& options, const Evaluator& evaluator,
                       const std::vector<VariableId>& eliminated, Status* status);

  void Refresh() override;
  const std::vector<double>& Gradient() const override { return hessian_.gradient(); }
  const std::vector<double>& Diagonal() const override { return hessian_.diagonal(); }
  Status Solve(const double* damping, double* step) override;
  const char* SolverName() const override {
    return "conjugate gradients on the reduced system, by products, large blocks eliminated";
  }
  void Describe(WorkCounts* work) const override;

 private:
  using RowMajor = Eigen::Matrix<double, Eigen::Dynamic, Eigen::Dynamic, Eigen::RowMajor>;
  using BlockMap = Eigen::Map<const RowMajor, 0, Eigen::OuterStride<>>;
  // An off-diagonal block of H between two variables: H_ij for i > j.
  struct Entry {
    int block;
    int i;
    int j;
    int OtherThan(int variable) const { return i == variable ? j : i; }
  };

  void SortBlocks(Status* status);
  Eigen::MatrixXd Diagonal(int variable) const;
  Eigen::MatrixXd Off(const Entry& entry, int row) const;
  void Multiply(const Entry& entry, int row, const double* v, double sign, double* y) const;
  Status FactorEliminated();
  KeptStructure FindKeptStructure() const;
  Status FactorPreconditioner();
  void SubtractCoupledBlocks(std::size_t e);
  Status SolveKept(double* step);
  void AddCoupled(const double* v, double* y) const;
  void SubtractDiagonal(int variable, const double* v, double* y) const;
  void SubtractProduct(const double* v, double* y) const override;
  bool Precondition(const double* r, double* z) override;
  void BackSubstitute(double* step) const;
  int Size(int variable) const { return plans_.pattern.block_size(variable); }
  int Offset(int variable) const { return plans_.pattern.offsets[variable]; }

  LandmarkIncidences incidences_;
  FramePlans plans_;
  Hessian hessian_;
  std::vector<int> eliminated_;         // variables of the layout
  std::vector<int> kept_;               // the others
  std::vector<int> place_;              // per variable: among its own kind
  std::vector<char> is_eliminated_;     // per variable
  std::vector<int> padded_;             // per kept one: its first entry in padded vectors
  std::vector<Entry> between_kept_;     // blocks of H_ff
  std::vector<std::vector<Entry>> of_;  // per eliminated one: blocks of H_ef
  // Inverses, as Ceres has them: one product where a factor takes two substitutions.
  std::vector<Eigen::MatrixXd> eliminated_inverse_;  // of H_ee
  std::unique_ptr<KeptBlocks> preconditioner_;
  mutable std::vector<double> coupled_;  // scratch of AddCoupled
};

}  // namespace inceres::internal
