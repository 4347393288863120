#include "common/schur_complement.h"

#include <limits>

#include <Eigen/Eigenvalues>

namespace sliding_window {

using Eigen::MatrixXd;
using Eigen::VectorXd;

NormalEquations MarginalizeFirst(const NormalEquations& equations, int num_dropped,
                                 double epsilon) {
  const Eigen::Index m = num_dropped;
  const Eigen::Index n = equations.b.size() - m;
  const MatrixXd H_mm =
      0.5 * (equations.H.topLeftCorner(m, m) + equations.H.topLeftCorner(m, m).transpose());
  const Eigen::SelfAdjointEigenSolver<MatrixXd> eigen(H_mm);
  const VectorXd S_inv =
      (eigen.eigenvalues().array() > epsilon).select(eigen.eigenvalues().array().inverse(), 0.0);
  // H_rm V, so that H_rm H_mm^+ = (H_rm V) S^-1 V^T.
  const MatrixXd H_rm_V = equations.H.bottomLeftCorner(n, m) * eigen.eigenvectors();
  NormalEquations kept;
  kept.H = equations.H.bottomRightCorner(n, n) - H_rm_V * S_inv.asDiagonal() * H_rm_V.transpose();
  kept.b = equations.b.tail(n) -
           H_rm_V * S_inv.asDiagonal() * (eigen.eigenvectors().transpose() * equations.b.head(m));
  return kept;
}

SquareRoot TakeSquareRoot(const NormalEquations& equations, double epsilon) {
  const Eigen::SelfAdjointEigenSolver<MatrixXd> eigen(0.5 *
                                                      (equations.H + equations.H.transpose()));
  const VectorXd S = (eigen.eigenvalues().array() > epsilon).select(eigen.eigenvalues(), 0.0);
  const VectorXd sqrt_S = S.cwiseSqrt();
  const VectorXd sqrt_S_inv = (S.array() > 0.0).select(sqrt_S.array().inverse(), 0.0);
  return {sqrt_S.asDiagonal() * eigen.eigenvectors().transpose(),
          sqrt_S_inv.asDiagonal() * (eigen.eigenvectors().transpose() * equations.b)};
}

double RoundingError(const MatrixXd& H) {
  return static_cast<double>(H.rows()) * std::numeric_limits<double>::epsilon() * H.trace();
}

}  // namespace sliding_window
