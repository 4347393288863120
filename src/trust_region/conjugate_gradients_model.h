#pragma once

#include <vector>

#include "linear/conjugate_gradients.h"
#include "trust_region/linear_model.h"

namespace inceres::internal {

/// A model whose steps are those of conjugate gradients as Ceres iterates: from zero, until ζ_k = k
/// (Q_k − Q_{k−1}) / Q_k < η for the quadratic model Q = xᵀAx/2 − bᵀx (Nash & Sofer 1990), the
/// residual computed anew every ten iterations. Whose system it is says what A and M are. Source:
/// Ceres's conjugate_gradients_solver.cc; docs/ceres_contract.md, "Conjugate gradients".
class ConjugateGradientsModel : public LinearModel, protected ConjugateGradients::System {
 public:
  void ScaleColumnsBy(const std::vector<double>& scale) override { scale_ = scale.data(); }
  bool left_out_landmarks() const override { return leaves_landmarks_; }
  bool is_iterative() const override { return true; }
  int num_iterations() const override { return num_iterations_; }

 protected:
  ConjugateGradientsModel(const ConjugateGradientsOptions& options, const Evaluator& evaluator)
      : LinearModel(evaluator), options_(options), eta_(options.eta) {}

  /// At the head of Solve: none of its iterations has been taken. The damping outlives the step.
  void BeginStep(const double* damping);
  /// x of iteration_, for its b. A step that took too many iterations, or met a direction without
  /// curvature, is as good as any; kSingular is one that does not exist.
  Status Iterate();

  const ConjugateGradientsOptions options_;
  ConjugateGradients iteration_;
  double eta_;  // of the next step
  const double* damping_ = nullptr;
  const double* scale_ = nullptr;
  bool converged_ = false;
  bool leaves_landmarks_ = false;

 private:
  bool IsGoodEnough(const ConjugateGradients& iteration) const final;

  int num_iterations_ = 0;
};

}  // namespace inceres::internal
