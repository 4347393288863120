#include "solver/dense_model.h"

#include <algorithm>
#include <cmath>
#include <string>

#include "linear/small_cholesky.h"
#include "solver/small_qr.h"

namespace inceres::internal {

DenseModel::DenseModel(const Evaluator& evaluator)
    : LinearModel(evaluator), size_(evaluator.layout().size()), stride_(PadToQuad(size_)) {
  H_.resize(static_cast<std::size_t>(size_ + 1) * stride_);
  L_.resize(static_cast<std::size_t>(size_) * stride_);
  inverse_pivots_.resize(size_);
  gradient_.resize(size_);
  diagonal_.resize(size_);
}

void DenseModel::Refresh() {
  const Kernels& kernels = BestKernels();
  double* const g = H_.data() + static_cast<std::ptrdiff_t>(size_) * stride_;
  std::fill(H_.begin(), H_.end(), 0.0);
  for (const FamilyCache& cache : evaluator_.families()) {
    const double* J = cache.slots[0].data;
    const ProductTerm whole{0, 0};
    const VectorTerm all{0, 0};
    const int rows = cache.rows_per_block();
    kernels.accumulate_products({J, J, &whole, cache.num_blocks(), rows, size_, size_}, 1.0, H_.data());
    kernels.accumulate_vectors({J, cache.residuals.data(), &all, cache.num_blocks(), rows, size_}, 1.0, g);
  }
  std::copy_n(g, size_, gradient_.begin());
  for (int k = 0; k < size_; ++k) {
    diagonal_[k] = H_[k * (stride_ + 1)];
  }
  clock_->Charge(&seconds_->hessian);
}

Status DenseModel::Solve(const double* damping, double* step) {
  std::copy_n(H_.begin(), L_.size(), L_.begin());
  for (int k = 0; k < size_; ++k) {
    L_[k * (stride_ + 1)] += damping[k];
  }
  std::fill(inverse_pivots_.begin(), inverse_pivots_.end(), 0.0);
  const bool factored = FactorSmall(size_, L_.data(), stride_, inverse_pivots_.data());
  if (factored) {
    std::transform(gradient_.begin(), gradient_.end(), step, [](double entry) { return -entry; });
    SolveSmall(size_, L_.data(), stride_, inverse_pivots_.data(), step);
  }
  clock_->Charge(&seconds_->factorization);
  if (factored) {
    return Status::Ok();
  }
  const auto failed = std::find(inverse_pivots_.begin(), inverse_pivots_.end(), 0.0) - inverse_pivots_.begin();
  return Status::Error(StatusCode::kSingular, "the normal equations are not positive definite at variable " +
                                                  std::to_string(VariableAt(static_cast<int>(failed))));
}

VariableId DenseModel::VariableAt(int column) const {
  const Layout& layout = evaluator_.layout();
  const auto after = std::upper_bound(layout.packed_offset.begin(), layout.packed_offset.end(), column);
  return layout.variables[after - layout.packed_offset.begin() - 1];
}

void DenseModel::Describe(WorkCounts* work) const {
  work->num_frames = static_cast<int>(evaluator_.layout().variables.size());
  work->reduced_size = size_;
  work->bytes += static_cast<std::int64_t>(sizeof(double) * (H_.size() + L_.size()));
}

DenseRowsQrModel::DenseRowsQrModel(const Evaluator& evaluator) : DenseModel(evaluator), stride_(PadToQuad(size_ + 1)) {
  for (const FamilyCache& cache : evaluator.families()) {
    num_rows_ += cache.num_blocks() * cache.rows_per_block();
  }
  rows_.resize(static_cast<std::size_t>(num_rows_ + size_) * stride_);
  scratch_.resize(num_rows_ + size_);
}

Status DenseRowsQrModel::Solve(const double* damping, double* step) {
  double* row = rows_.data();
  for (const FamilyCache& cache : evaluator_.families()) {
    const double* J = cache.slots[0].data;
    for (int r = 0; r < cache.num_blocks() * cache.rows_per_block(); ++r, J += cache.slots[0].row_stride, row += stride_) {
      std::copy_n(J, size_, row);
      row[size_] = cache.residuals.data()[r];
    }
  }
  std::fill(row, rows_.data() + rows_.size(), 0.0);
  for (int k = 0; k < size_; ++k, row += stride_) {
    row[k] = std::sqrt(damping[k]);
  }
  SolveDampedRows(num_rows_, size_, rows_.data(), stride_, scratch_.data(), step);
  clock_->Charge(&seconds_->factorization);
  if (!std::all_of(step, step + size_, [](double entry) { return std::isfinite(entry); })) {
    return Status::Error(StatusCode::kSingular, "the columns of the Jacobian are linearly dependent");
  }
  return Status::Ok();
}

}  // namespace inceres::internal
