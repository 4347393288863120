#pragma once

#include <vector>

#include <Eigen/Core>

#include "trust_region/linear_model.h"

namespace inceres::internal {

/// min ‖Jδ + f‖² + ‖√Λ δ‖² by Householder QR of the stacked rows [J; √Λ], without forming H: the
/// condition number is not squared. For small, ill-conditioned problems (curve fitting with
/// tolerances near machine precision). Single-threaded. Source: Golub & Van Loan, section 5.3.
class DenseQrModel final : public LinearModel {
 public:
  explicit DenseQrModel(const Evaluator& evaluator);

  void Refresh() override;
  const std::vector<double>& Gradient() const override { return gradient_; }
  const std::vector<double>& Diagonal() const override { return diagonal_; }
  Status Solve(const double* damping, double* step) override;
  const char* SolverName() const override { return "dense QR"; }
  void Describe(WorkCounts* work) const override;

 private:
  int num_residuals_ = 0;
  // first packed entry of the variable that starts at a quad offset
  std::vector<int> packed_of_quad_;
  Eigen::MatrixXd J_;  // rows of the evaluator's factors, family by family
  Eigen::VectorXd f_;
  Eigen::MatrixXd stacked_;
  std::vector<double> gradient_;
  std::vector<double> diagonal_;
};

}  // namespace inceres::internal
