#include "marginal/null_space.h"

#include <algorithm>
#include <cstdint>
#include <vector>

#include <Eigen/Dense>

#include "linear/sparse_cholesky.h"

namespace inceres::internal {
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
      const VectorXd shifted = shift_ * diagonal;
      return factor_.Factorize(ReducedMatrix(pattern, S, shifted.data()), {}).ok();
    };
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
    Q = Orthonormal(inverse * Q);
  }
  const MatrixXd T = Q.transpose() * (inverse * Q);
  const Eigen::SelfAdjointEigenSolver<MatrixXd> eigen(0.5 * (T + T.transpose()));
  // Its eigenvalues ascend; those of S are 1/θ − ε.
  Eigen::Index found = 0;
  const auto value = [&](Eigen::Index k) {
    return 1.0 / eigen.eigenvalues()[Q.cols() - 1 - k] - inverse.shift();
  };
  while (inverse.ok() && found < Q.cols() && value(found) <= threshold) {
    ++found;
  }
  return Q * eigen.eigenvectors().rowwise().reverse().leftCols(found);
}

}  // namespace inceres::internal
