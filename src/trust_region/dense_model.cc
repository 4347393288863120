#include "trust_region/dense_model.h"

#include <algorithm>
#include <cmath>
#include <string>

#include "inceres/problem/constant_size.h"
#include "linear/small_cholesky.h"
#include "trust_region/small_qr.h"

namespace inceres::internal {

// The small dense problem: J is one matrix of whole rows, turned into columns once a
// linearization. H and Jᵀf are dot products of columns, J v a sum of them, and with so few
// unknowns no symbolic work is needed. H is kept negative because the kernel subtracts.

DenseModel::DenseModel(const Evaluator& evaluator)
    : LinearModel(evaluator), size_(evaluator.layout().size()) {
  for (const Linearization& cache : evaluator.families()) {
    num_rows_ += cache.num_blocks() * cache.rows_per_block();
  }
  // Room below for √Λ, which the QR of the derived class puts there.
  stride_ = DampedColumnStride(num_rows_, size_);
  const auto size = static_cast<std::size_t>(size_);
  columns_.resize((size + 1) * stride_);
  H_.resize((size + 1) * size);
  L_.resize(size * size);
  inverse_pivots_.resize(size);
  gradient_.resize(size);
  diagonal_.resize(size);
}

// One pass turns rows into columns, one sums all products of columns.
void DenseModel::Refresh() {
  double* top = columns_.data();
  const int stride = stride_;
  // Families one below the other, in their order.
  for (const Linearization& cache : evaluator_.families()) {
    // A family of whole rows is one block of so many rows.
    const int rows = cache.num_blocks() * cache.rows_per_block();
    BestKernels().rows_to_columns(rows, size_, cache.slots[0].data, cache.slots[0].row_stride, top,
                                  stride);
    std::copy_n(cache.residuals.data(), rows, top + static_cast<std::ptrdiff_t>(size_) * stride);
    top += rows;
  }
  std::fill(H_.begin(), H_.end(), 0.0);
  // The last column is f: row size_ of H is −fᵀJ.
  BestKernels().subtract_row_dots(size_ + 1, size_, PadToQuad(num_rows_), columns_.data(), stride,
                                  columns_.data(), stride, H_.data(), size_);
  for (int k = 0; k < size_; ++k) {
    gradient_[k] = -H_[size_ * size_ + k];
    diagonal_[k] = -H_[k * (size_ + 1)];
  }
  clock_->Charge(&seconds_->hessian);
}

// Both sums come from one pass over the columns.
RowProducts DenseModel::MultiplyJacobian(const double* v) {
  return BestKernels().column_products(PadToQuad(num_rows_), size_, columns_.data(), stride_, v);
}

Status DenseModel::Solve(const double* damping, double* step) {
  bool factored = false;
  // With a constant size the loops of the small factorization unroll.
  WithConstantSize(size_, [&](auto size) { factored = FactorAndSolve(size, damping, step); });
  clock_->Charge(&seconds_->factorization);
  if (factored) {
    return Status::Ok();
  }
  // Inverse pivots are zero from the one on that failed.
  const auto failed =
      std::find(inverse_pivots_.begin(), inverse_pivots_.end(), 0.0) - inverse_pivots_.begin();
  return Status::Error(StatusCode::kSingular,
                       "the normal equations are not positive definite at variable " +
                           std::to_string(VariableAt(static_cast<int>(failed))));
}

// L Lᵀ = H + Λ and the step; false, with the inverse pivots up to there, at a pivot that is not
// positive and finite. Size is an int or a constant.
template <typename Size>
bool DenseModel::FactorAndSolve(Size size, const double* damping, double* step) {
  // A copy: the same H is solved with several dampings.
  for (int k = 0; k < size * size; ++k) {
    L_[k] = -H_[k];
  }
  for (int k = 0; k < size; ++k) {
    L_[k * (size + 1)] += damping[k];
    inverse_pivots_[k] = 0.0;
  }
  if (!FactorSmall(size, L_.data(), size, inverse_pivots_.data())) {
    return false;
  }
  for (int k = 0; k < size; ++k) {
    step[k] = -gradient_[k];
  }
  SolveSmall(size, L_.data(), size, inverse_pivots_.data(), step);
  return true;
}

// For the message: a column belongs to a variable.
VariableId DenseModel::VariableAt(int column) const {
  const Layout& layout = evaluator_.layout();
  // The last variable that begins at or before the column.
  const auto after =
      std::upper_bound(layout.packed_offset.begin(), layout.packed_offset.end(), column);
  return layout.variables[after - layout.packed_offset.begin() - 1];
}

void DenseModel::Describe(WorkCounts* work) const {
  work->num_frames = static_cast<int>(evaluator_.layout().variables.size());
  work->reduced_size = size_;
  work->bytes +=
      static_cast<std::int64_t>(sizeof(double) * (columns_.size() + H_.size() + L_.size()));
}

DenseColumnsQrModel::DenseColumnsQrModel(const Evaluator& evaluator) : DenseModel(evaluator) {
  reflected_.resize(static_cast<std::size_t>(size_ + 1) * stride_);
  scratch_.resize(2 * size_ + 1);
}

Status DenseColumnsQrModel::Solve(const double* damping, double* step) {
  // All of [J f; 0 0]: the reflections overwrite it.
  std::copy_n(columns_.begin(), reflected_.size(), reflected_.begin());
  for (int k = 0; k < size_; ++k) {
    reflected_[static_cast<std::size_t>(k) * stride_ + num_rows_ + k] = std::sqrt(damping[k]);
  }
  SolveDampedColumns(num_rows_, size_, reflected_.data(), scratch_.data(), step);
  clock_->Charge(&seconds_->factorization);
  // Full rank is not tested for: a zero on the diagonal of R gives a step that is not finite.
  if (!std::all_of(step, step + size_, [](double entry) { return std::isfinite(entry); })) {
    return Status::Error(StatusCode::kSingular,
                         "the columns of the Jacobian are linearly dependent");
  }
  return Status::Ok();
}

}  // namespace inceres::internal
