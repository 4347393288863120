#pragma once

#include <cstdint>
#include <memory>
#include <vector>

#include "linearize/hessian.h"
#include "schur/elimination.h"
#include "trust_region/linear_model.h"

namespace inceres::internal {

/// Blocks are found by 32-bit counts of quads; a target in Y spends one bit on a flag.
Status CheckBlockOffsets(const Evaluator& evaluator, const LandmarkIncidences& incidences);

/// What any model has to say of H: the bytes of C and of its plans, and how many factors have
/// residuals too long for kernels that are sized at compile time.
void DescribeHessian(const Evaluator& evaluator, const Hessian& hessian, const FramePlans& plans,
                     WorkCounts* work);

/// S = H: nothing to eliminate (pose graphs, curve fitting). Also the frame half of the Schur
/// model.
class PlainModel : public LinearModel {
 public:
  /// `incidences`: those of the evaluator where somebody has found them already, else null.
  PlainModel(const SolverOptions& options, const Evaluator& evaluator,
             std::unique_ptr<LandmarkIncidences> incidences, Status* status);

  void Refresh() override;
  const std::vector<double>& Gradient() const override { return hessian_.gradient(); }
  const std::vector<double>& Diagonal() const override { return hessian_.diagonal(); }
  Status Solve(const double* damping, double* step) override;
  const char* SolverName() const override {
    return reduced_solver_ ? reduced_solver_->Name() : "none";
  }
  std::vector<int> EliminationOrder() const override;
  void Describe(WorkCounts* work) const override;

 protected:
  /// δ_c = (S + diag(damping))⁻¹ b, timed. A system of size zero is solved by doing nothing.
  Status SolveReduced(const double* S, const double* b, const double* damping, double* step);
  /// Of Jacobians that are not kept: keeps what a step promises, for MultiplyJacobian.
  void KeepProducts(const double* step, const RowProducts& products);
  /// Where S may be formed without memory of its own, for the reduced solver that there is: the
  /// plans' pattern then has its blocks there. Null: nowhere.
  double* PlaceS();

  LandmarkIncidences incidences_;
  FramePlans plans_;
  Hessian hessian_;

 private:
  RowProducts MultiplyJacobian(const double* v) override;

  std::unique_ptr<ReducedSolver> reduced_solver_;
  std::vector<double> b_;
  // of the last step since Refresh whose products are known; else empty
  std::vector<double> multiplied_;
  RowProducts products_;
};

/// Landmarks eliminated block by block, δ_c from the reduced system, δ_l by back-substitution.
class SchurModel final : public PlainModel {
 public:
  SchurModel(const SolverOptions& options, const Evaluator& evaluator,
             std::unique_ptr<LandmarkIncidences> incidences, Status* status);

  Status Solve(const double* damping, double* step) override;
  void Describe(WorkCounts* work) const override;

 private:
  Status SubstituteByChunks(double* step);

  Elimination elimination_;
};

/// S = H of the blocks of J that are not all zeros at the current point
/// (Evaluator::set_leaves_out_zero_blocks): where factors touch many variables of which few count,
/// a few that change from step to step. Pattern, plans and symbolic factorization are made anew
/// whenever the zeros have moved, and kept while they have not.
class DynamicModel final : public LinearModel {
 public:
  DynamicModel(const SolverOptions& options, const Evaluator& evaluator);

  void Refresh() override;
  const std::vector<double>& Gradient() const override { return model_->Gradient(); }
  const std::vector<double>& Diagonal() const override { return model_->Diagonal(); }
  Status Solve(const double* damping, double* step) override;
  const char* SolverName() const override {
    return model_ == nullptr ? "found at each linearization" : model_->SolverName();
  }
  void Describe(WorkCounts* work) const override;

 private:
  bool ZerosAreAsBefore() const;
  void Rebuild();

  const SolverOptions options_;
  std::unique_ptr<PlainModel> model_;
  Status status_;
  // per family, as model_ was made for them
  std::vector<UnwrittenVector<std::int32_t>> tangent_offsets_;
};

}  // namespace inceres::internal
