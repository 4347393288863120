#include "marginal/null_space.h"

#include <algorithm>
#include <cstdint>

#include <Eigen/Dense>

#include "linear/sparse_cholesky.h"

namespace inceres::internal {

// The directions that S leaves open, for the covariance to name (docs/algorithms.md, "Covariance";
// Golub & Van Loan, section 8.2). Subspace iteration with (D^-½ S D^-½ + ε)⁻¹: in units of D
// variables of unlike units compare, and the shift ε lets a singular S have a factor. The inverse
// makes the small eigenvalues large; a direction of eigenvalue λ grows by 1/(λ + ε) an iteration,
// so those below the threshold leave all others behind within a few.
//
// The eigenvalues come from the Rayleigh quotient of the inverse at the end, ½(T + Tᵀ) because
// rounding leaves T a little unsymmetric.

namespace {

using Eigen::MatrixXd;
using Eigen::VectorXd;

// What is next to nothing grows by threshold / ε in each of them against what is a hundred times
// the threshold.
constexpr int kIterations = 6;
constexpr double kLargestShift = 1e-4;

class ShiftedInverse {
 public:
  ShiftedInverse(const BlockPattern& pattern, const double* S, const VectorXd& diagonal,
                 const Executor& executor)
      : scale_(diagonal.cwiseSqrt()), factor_(executor) {
    const VectorXd none = VectorXd::Zero(diagonal.size());
    ok_ = factor_.Analyze(ReducedMatrix(pattern, S, none.data())).ok();
    const auto factorize = [&] {
      // ε D is added to S, which is ε in the scaled matrix.
      const VectorXd shifted = shift_ * diagonal;
      return factor_.Factorize(ReducedMatrix(pattern, S, shifted.data()), {}).ok();
    };
    // Rounding may leave S with a pivot below zero: tenfold more until there is a factor, or no
    // point in it, for what is open would drown in the shift.
    while (ok_ && !factorize()) {
      shift_ *= 10.0;
      ok_ = shift_ <= kLargestShift;
    }
  }

  bool ok() const { return ok_; }
  double shift() const { return shift_; }

  // (D^-½ S D^-½ + ε)⁻¹ Q.
  MatrixXd operator*(const MatrixXd& Q) {
    MatrixXd result(Q.rows(), Q.cols());
    for (Eigen::Index c = 0; c < Q.cols(); ++c) {
      // D^½ (S + εD)⁻¹ D^½: S itself is never scaled.
      const VectorXd right = scale_.cwiseProduct(Q.col(c));
      VectorXd left(Q.rows());
      ok_ = factor_.Solve(right.data(), {}, {}, left.data()).ok() && ok_;
      result.col(c) = scale_.cwiseProduct(left);
    }
    return result;
  }

 private:
  VectorXd scale_;
  SparseCholesky factor_;
  double shift_ = 1e-11;
  bool ok_ = false;
};

MatrixXd Orthonormal(const MatrixXd& columns) {
  return Eigen::HouseholderQR<MatrixXd>(columns).householderQ() *
         MatrixXd::Identity(columns.rows(), columns.cols());
}

// The start has to have a share of every direction and be the same in every run: numbers of a
// linear congruential generator, from −1 to 1.
MatrixXd Start(Eigen::Index rows, Eigen::Index columns) {
  MatrixXd start(rows, columns);
  std::uint32_t bits = 1;
  for (Eigen::Index i = 0; i < start.size(); ++i) {
    bits = bits * 1664525u + 1013904223u;
    start(i) = static_cast<double>(bits >> 8) / (1u << 23) - 1.0;
  }
  return Orthonormal(start);
}

}  // namespace

MatrixXd FindNullSpace(const BlockPattern& pattern, const double* S, const VectorXd& diagonal,
                       double threshold, int most, const Executor& executor) {
  ShiftedInverse inverse(pattern, S, diagonal, executor);
  if (!inverse.ok()) {
    return MatrixXd(diagonal.size(), 0);
  }
  MatrixXd Q = Start(diagonal.size(), std::min<Eigen::Index>(most, diagonal.size()));
  for (int i = 0; i < kIterations; ++i) {
    // Made orthonormal each time, or all columns would turn to the first.
    Q = Orthonormal(inverse * Q);
  }
  const MatrixXd T = Q.transpose() * (inverse * Q);
  const Eigen::SelfAdjointEigenSolver<MatrixXd> eigen(0.5 * (T + T.transpose()));
  // Its eigenvalues ascend; those of S are 1/θ − ε.
  Eigen::Index found = 0;
  const auto value = [&](Eigen::Index k) {
    return 1.0 / eigen.eigenvalues()[Q.cols() - 1 - k] - inverse.shift();
  };
  // The largest eigenvalue of the inverse comes first: it is the smallest of S.
  while (inverse.ok() && found < Q.cols() && value(found) <= threshold) {
    ++found;
  }
  return Q * eigen.eigenvectors().rowwise().reverse().leftCols(found);
}

}  // namespace inceres::internal
