#include "trust_region/dense_qr_model.h"

#include <Eigen/QR>

namespace inceres::internal {

// Householder QR of [J; √Λ] for Jacobians stored by slot; DenseColumnsQrModel does the same for
// whole rows. Rounding acts on J and not on JᵀJ, so that a problem with condition number κ loses
// digits by κ and not by κ². J is formed dense at each linearization, and copied for each damping.

DenseQrModel::DenseQrModel(const Evaluator& evaluator) : LinearModel(evaluator) {
  const Layout& layout = evaluator.layout();
  for (const Linearization& cache : evaluator.families()) {
    num_residuals_ += cache.num_factors * cache.residual_size;
  }
  packed_of_quad_.assign(layout.quad_offset.back(), 0);
  for (std::size_t i = 0; i < layout.variables.size(); ++i) {
    // Offsets come in quads from the linearization; only quads at which a variable begins are
    // looked up.
    packed_of_quad_[layout.quad_offset[i]] = layout.packed_offset[i];
  }
  J_.resize(num_residuals_, layout.size());
  f_.resize(num_residuals_);
  gradient_.resize(layout.size());
  diagonal_.resize(gradient_.size());
}

// J row by row, family by family: entries of factors go to the columns of their variables.
void DenseQrModel::Refresh() {
  // Blocks between are zero; blocks that are there are written over.
  J_.setZero();
  int row = 0;
  for (const Linearization& cache : evaluator_.families()) {
    const int rows = cache.residual_size;
    const int num_slots = cache.num_slots;
    for (int i = 0; i < cache.num_factors; ++i, row += rows) {
      f_.segment(row, rows) = Eigen::Map<const Eigen::VectorXd>(
          cache.residuals.data() + static_cast<std::ptrdiff_t>(i) * rows, rows);
      for (int s = 0; s < num_slots; ++s) {
        const int offset =
            cache
                .tangent_offsets[static_cast<std::size_t>(i) * static_cast<std::size_t>(num_slots) +
                                 static_cast<std::size_t>(s)];
        // A constant has no columns.
        if (offset < 0) {
          continue;
        }
        const SlotJacobians& slot = cache.slots[s];
        const double* block = slot.data + i * slot.factor_stride;
        const int column = packed_of_quad_[offset];
        for (int r = 0; r < rows; ++r) {
          for (int c = 0; c < cache.family->slot(s).tangent_size; ++c) {
            J_(row + r, column + c) = block[r * slot.row_stride + c];
          }
        }
      }
    }
  }
  // The strategies ask for gradient and column norms, which are of J and not of the damped rows.
  Eigen::Map<Eigen::VectorXd>(gradient_.data(), J_.cols()) = J_.transpose() * f_;
  Eigen::Map<Eigen::VectorXd>(diagonal_.data(), J_.cols()) = J_.colwise().squaredNorm().transpose();
  clock_->Charge(&seconds_->hessian);
}

Status DenseQrModel::Solve(const double* damping, double* step) {
  const Eigen::Index n = J_.cols();
  stacked_.resize(num_residuals_ + n, n);
  stacked_.topRows(num_residuals_) = J_;
  // √Λ below, with a right-hand side of zeros.
  stacked_.bottomRows(n) = Eigen::Map<const Eigen::VectorXd>(damping, n).cwiseSqrt().asDiagonal();
  Eigen::VectorXd rhs = Eigen::VectorXd::Zero(num_residuals_ + n);
  rhs.head(num_residuals_) = -f_;
  // In place: stacked_ is overwritten, J_ stays.
  const Eigen::HouseholderQR<Eigen::Ref<Eigen::MatrixXd>> qr(stacked_);
  Eigen::Map<Eigen::VectorXd> solution(step, n);
  solution = qr.solve(rhs);
  clock_->Charge(&seconds_->factorization);
  // No rank is estimated: a zero pivot gives infinity or NaN.
  if (!solution.allFinite()) {
    return Status::Error(StatusCode::kSingular,
                         "the columns of the Jacobian are linearly dependent");
  }
  return Status::Ok();
}

void DenseQrModel::Describe(WorkCounts* work) const {
  work->num_frames = static_cast<int>(evaluator_.layout().variables.size());
  work->reduced_size = static_cast<int>(J_.cols());
  work->bytes += static_cast<std::int64_t>(sizeof(double)) * (J_.size() + stacked_.size());
}

}  // namespace inceres::internal
