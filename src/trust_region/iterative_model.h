#pragma once

#include <memory>
#include <vector>

#include "linear/block_product.h"
#include "linearize/hessian.h"
#include "schur/elimination.h"
#include "schur/frame_aggregates.h"
#include "trust_region/conjugate_gradients_model.h"
#include "trust_region/preconditioner.h"

namespace inceres::internal {

/// A step whose conjugate gradients have taken max_iterations: landmarks follow, or, where S is
/// formed, stay where they are, as in Ceres.
enum class Unfinished { kMovesAll, kAsCeres };

/// Steps by conjugate gradients, as Ceres's ITERATIVE_SCHUR takes them where the layout has
/// landmarks, and as its CGNR does where it has none: from zero, until the quadratic model hardly
/// gains (Nash & Sofer 1990), the residual computed anew every ten iterations.
///
/// S = C − Y Yᵀ is not formed, unless the options ask for that: a product with it is one with C and
/// a pass over the Jacobians. An iteration's cost: those, and the preconditioner. Threads: those of
/// the evaluator; the same bits for any number. Source: Agarwal et al. 2010, "Bundle Adjustment in
/// the Large"; docs/ceres_contract.md, "Conjugate gradients".
class IterativeModel final : public ConjugateGradientsModel {
 public:
  IterativeModel(const ConjugateGradientsOptions& options, Unfinished unfinished,
                 const Evaluator& evaluator, Status* status);

  void BeginSolve() override;
  void Refresh() override;
  const std::vector<double>& Gradient() const override { return hessian_.gradient(); }
  const std::vector<double>& Diagonal() const override { return hessian_.diagonal(); }
  Status Solve(const double* damping, double* step) override;
  const char* SolverName() const override;
  void Describe(WorkCounts* work) const override;

 private:
  bool is_formed() const { return options_.explicit_schur_complement; }
  void MakePreconditioner(Status* status);
  const FrameClusters* FindClusters();
  void UpdateEta();
  Status SolveReduced(double* step);
  void SubtractProduct(const double* v, double* y) const override;
  bool Precondition(const double* r, double* z) override;

  const Unfinished unfinished_;
  const bool has_landmarks_;
  LandmarkIncidences incidences_;
  std::unique_ptr<FrameAggregates> aggregates_;  // of a two-level preconditioner
  FrameClusters clusters_;                       // of one by clusters
  FramePlans plans_;
  Hessian hessian_;
  Elimination elimination_;
  BlockProduct product_;
  std::vector<const double*> blocks_;  // of the matrix that is multiplied, by the pattern
  std::unique_ptr<Preconditioner> preconditioner_;  // null: the identity
  double gradient_norm_ = 0.0;                      // where eta_ was found; 0: nowhere yet
};

}  // namespace inceres::internal
