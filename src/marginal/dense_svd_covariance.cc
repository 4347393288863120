#include "marginal/dense_svd_covariance.h"

#include <algorithm>
#include <cmath>

#include <Eigen/QR>

#include "base/formatted.h"
#include "linearize/jacobian_map.h"
#include "marginal/singular_values.h"

namespace inceres::internal {

// Covariance by the singular values of J (Golub & Van Loan, sections 5.5.2 and 8.6; Ceres's
// DENSE_SVD, docs/ceres_contract.md, "Covariance"). With J = U Σ Vᵀ, (JᵀJ)⁻¹ = (V Σ⁻¹)(V Σ⁻¹)ᵀ: the
// root V Σ⁻¹ is kept, a block of the covariance is the product of the rows of two variables.
// Working on J and not on JᵀJ keeps the digits that squaring the condition number would cost.
// Directions with small singular values are left out of V, which makes the inverse that of Moore
// and Penrose.
//
// Landmarks are not eliminated: the rank that is judged is that of all of J.

DenseSvdCovariance::DenseSvdCovariance(const FactorGraph& graph, const std::vector<double>& state,
                                       const CovarianceOptions& options)
    : graph_(graph),
      options_(options),
      executor_(options.num_threads),
      // Landmarks count as frames here: they have columns like all others.
      layout_(graph, /*eliminate_landmarks=*/false),
      evaluator_(graph, layout_, executor_) {
  evaluator_.points().SetCurrent(state);
}

Eigen::MatrixXd DenseSvdCovariance::DenseJacobian() const {
  Eigen::Index num_rows = 0;
  for (const Linearization& family : evaluator_.families()) {
    num_rows += Eigen::Index{family.num_factors} * family.residual_size;
  }
  // Variables that no factor touches have no place in the layout. Columns of zeros make J as wide
  // as all that may move, so that they count where its rank is judged.
  Eigen::Index num_untouched = 0;
  for (VariableId id = 0; id < graph_.num_variables(); ++id) {
    if (graph_.HasVariable(id) && !graph_.IsConstant(id) && !Has(id)) {
      num_untouched += graph_.TangentSize(id);
    }
  }
  Eigen::MatrixXd J = Eigen::MatrixXd::Zero(num_rows, layout_.size() + num_untouched);
  Eigen::Index row = 0;
  for (const Linearization& family : evaluator_.families()) {
    for (int i = 0; i < family.num_factors; ++i, row += family.residual_size) {
      const VariableId* const ids = graph_.Variables(family.id, i);
      for (int s = 0; s < family.num_slots; ++s) {
        const int position = layout_.Position(ids[s]);
        if (position >= 0) {
          // Added, not assigned: a factor may have one variable in two slots.
          J.block(row, layout_.packed_offset[position], family.residual_size,
                  family.slots[s].columns) += JacobianOf(family.slots[s], i, family.residual_size);
        }
      }
    }
  }
  return J;
}

// With automatic truncation all that is small is left out; else so many, and no other may be small.
Status DenseSvdCovariance::Factorize(const GraphCovariance::Pairs& /*pairs*/) {
  double cost = 0.0;
  const Status status = evaluator_.EvaluateJacobians(/*known_point=*/false, &cost);
  if (!status.ok()) {
    return status;
  }
  Eigen::MatrixXd J = DenseJacobian();
  if (!J.allFinite()) {  // a loss without a weight
    return Status::Error(StatusCode::kSingular,
                         "there is no covariance: the Jacobian is not finite");
  }
  if (J.rows() > J.cols()) {  // the singular values are those of R
    Eigen::HouseholderQR<Eigen::Ref<Eigen::MatrixXd>> qr(J);
    // Q is not needed: V belongs to R as well.
    J = qr.matrixQR().topRows(J.cols()).triangularView<Eigen::Upper>().toDenseMatrix();
  }
  const Eigen::BDCSVD<Eigen::MatrixXd> svd(J, Eigen::ComputeThinV);
  const Eigen::VectorXd& values = svd.singularValues();
  // A negative rank: automatic truncation.
  const bool truncates = options_.null_space_rank < 0;
  const Eigen::Index max_rank =
      std::clamp<Eigen::Index>(values.size() - options_.null_space_rank, 0, values.size());
  // The option speaks of JᵀJ, whose eigenvalues are squares.
  const double smallest = std::sqrt(options_.min_reciprocal_condition_number);
  Eigen::Index rank = 0;
  // Values descend. One that is zero has no inverse whatever the options allow.
  while (rank < max_rank && values[rank] >= smallest * values[0] && values[rank] > 0.0) {
    ++rank;
  }
  // Of those that were to be kept one is too small.
  if (rank < max_rank && !truncates) {
    const double ratio = values[0] > 0.0 ? values[rank] / values[0] : 0.0;
    return Status::Error(
        StatusCode::kSingular,
        Formatted("the Jacobian is rank deficient: reciprocal condition number %g < %g, with %d "
                  "singular values left out (null_space_rank); -1 leaves out all that are small",
                  ratio * ratio, options_.min_reciprocal_condition_number,
                  options_.null_space_rank));
  }
  root_ = svd.matrixV().leftCols(rank) * values.head(rank).cwiseInverse().asDiagonal();
  return Status::Ok();
}

Eigen::MatrixXd DenseSvdCovariance::RowsOf(VariableId id) const {
  return root_.middleRows(layout_.packed_offset[layout_.position[id]], graph_.TangentSize(id));
}

Eigen::MatrixXd DenseSvdCovariance::Product(VariableId a, VariableId b) const {
  return RowsOf(a) * RowsOf(b).transpose();
}

}  // namespace inceres::internal
