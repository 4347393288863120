#pragma once

#include <Eigen/Core>

namespace sliding_window {

/// A quadratic cost dx^T H dx / 2 + b^T dx, where b = J^T r.
struct NormalEquations {
  Eigen::MatrixXd H;
  Eigen::VectorXd b;

  static NormalEquations Zero(int size) {
    return {Eigen::MatrixXd::Zero(size, size), Eigen::VectorXd::Zero(size)};
  }
};

/// The same cost as |J dx + r|^2 / 2 (but for a constant).
struct SquareRoot {
  Eigen::MatrixXd J;
  Eigen::VectorXd r;
};

/// What is known of the other variables when the first `num_dropped` are minimized over: H_rr -
/// H_rm H_mm^+ H_mr and b_r - H_rm H_mm^+ b_m, with the pseudo-inverse of H_mm by its eigenvalues
/// above `epsilon`.
NormalEquations MarginalizeFirst(const NormalEquations& equations, int num_dropped, double epsilon);

/// J = S^1/2 V^T and r = S^-1/2 V^T b from the eigenvalues S of H above `epsilon`; the other rows
/// are zero.
SquareRoot TakeSquareRoot(const NormalEquations& equations, double epsilon);

/// The largest eigenvalue that can be rounding error in H: size * machine epsilon * the largest
/// eigenvalue's bound, the trace.
double RoundingError(const Eigen::MatrixXd& H);

}  // namespace sliding_window
