#include "trust_region/dense_model.h"

#include <algorithm>
#include <cmath>
#include <string>

#include <Eigen/QR>

#include "inceres/problem/constant_size.h"
#include "linear/small_cholesky.h"
#include "trust_region/small_qr.h"

namespace inceres::internal {

// The small dense problem: J is one matrix of whole rows, turned into columns once a
// linearization. H and Jᵀf are dot products of columns, J v a sum of them, and with so few
// unknowns no symbolic work is needed. H is kept negative because the kernel subtracts.
//
// The models of DENSE_QR factor [J; √Λ], of whole rows or of Jacobians by slot: rounding acts on J
// and not on JᵀJ, so that a problem with condition number κ loses digits by κ and not by κ².

namespace {

// Full rank is not tested for: a zero on the diagonal of R gives a step that is not finite.
Status StatusOfQr(const double* step, int size) {
  return std::all_of(step, step + size, [](double entry) { return std::isfinite(entry); })
             ? Status::Ok()
             : Status::Error(StatusCode::kSingular,
                             "the columns of the Jacobian are linearly dependent");
}

}  // namespace

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
  return StatusOfQr(step, size_);
}

// J is formed dense at each linearization, and copied for each damping.
DenseQrModel::DenseQrModel(const Evaluator& evaluator) : LinearModel(evaluator) {
  for (const Linearization& cache : evaluator.families()) {
    num_residuals_ += cache.num_factors * cache.residual_size;
  }
  J_.resize(num_residuals_, evaluator.layout().size());
  f_.resize(num_residuals_);
  gradient_.resize(evaluator.layout().size());
  diagonal_.resize(gradient_.size());
}

// J row by row, family by family: entries of factors go to the columns of their variables.
void DenseQrModel::Refresh() {
  const Layout& layout = evaluator_.layout();
  // Blocks between are zero; blocks that are there are written over.
  J_.setZero();
  int row = 0;
  for (const Linearization& cache : evaluator_.families()) {
    const int rows = cache.residual_size;
    for (int i = 0; i < cache.num_factors; ++i, row += rows) {
      f_.segment(row, rows) = Eigen::Map<const Eigen::VectorXd>(
          cache.residuals.data() + static_cast<std::ptrdiff_t>(i) * rows, rows);
      for (int s = 0; s < cache.num_slots; ++s) {
        const int position = layout.Position(cache.graph->Variables(cache.id, i)[s]);
        // A constant has no columns.
        if (position < 0) {
          continue;
        }
        const SlotJacobians& slot = cache.slots[s];
        const double* block = slot.data + i * slot.factor_stride;
        const int column = layout.packed_offset[position];
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
  Eigen::Map<Eigen::VectorXd>(step, n) = qr.solve(rhs);
  clock_->Charge(&seconds_->factorization);
  return StatusOfQr(step, static_cast<int>(n));
}

void DenseQrModel::Describe(WorkCounts* work) const {
  work->num_frames = static_cast<int>(evaluator_.layout().variables.size());
  work->reduced_size = static_cast<int>(J_.cols());
  work->bytes += static_cast<std::int64_t>(sizeof(double)) * (J_.size() + stacked_.size());
}

}  // namespace inceres::internal
