// FactoredNormals by orthogonal transformations of the Jacobian: CovarianceAlgorithm::kQr.

#include <algorithm>
#include <cmath>
#include <utility>

#include <Eigen/Dense>

#include "linear/front_qr.h"
#include "marginal/factored_normals.h"

namespace inceres::internal {

// Diagonal of S, from the rows of a root of it.
void FactoredNormals::AddSquares(const RowsOfBlocks& rows) {
  Eigen::Index column = 0;
  for (const int frame : rows.blocks) {
    for (int k = 0; k < layout_.TangentSize(frame); ++k, ++column) {
      diagonal_[layout_.packed_offset[frame] + k] += rows.values.col(column).squaredNorm();
    }
  }
}

// The rows that all landmarks and the other factors leave for the frames. A landmark that its own
// rows do not determine is an error.
Status FactoredNormals::EliminateByRows(double least, std::vector<RowsOfBlocks>* rows) {
  by_rows_ = std::make_unique<OrthogonalElimination>(graph_, layout_, evaluator_);
  const auto num_landmarks = static_cast<std::size_t>(layout_.num_landmarks());
  rows->resize(num_landmarks);
  std::vector<char> open(num_landmarks, 0);
  executor_.For(layout_.num_landmarks(), 16, [&](int begin, int end) {
    for (int l = begin; l < end; ++l) {
      OrthogonalElimination::Landmark landmark = by_rows_->Eliminate(l);
      const bool is_open = landmark.Inflation() > options_.max_inflation ||
                           !(landmark.R.diagonal().cwiseAbs().minCoeff() > least);
      open[static_cast<std::size_t>(l)] = is_open ? 1 : 0;
      (*rows)[static_cast<std::size_t>(l)] = std::move(landmark.rest);
    }
  });
  for (int l = 0; l < layout_.num_landmarks(); ++l) {
    if (open[static_cast<std::size_t>(l)] != 0) {
      deficiency_.landmarks.push_back(layout_.variables[layout_.num_frames + l]);
    }
  }
  if (!deficiency_.landmarks.empty()) {
    return NotDetermined(deficiency_.landmarks.front(),
                         "the landmark is not determined by its factors");
  }
  for (RowsOfBlocks& others : by_rows_->OtherRows()) {
    rows->push_back(std::move(others));
  }
  return Status::Ok();
}

Status FactoredNormals::FactorizeRows() {
  hessian_.Accumulate();
  const std::vector<double>& squares = hessian_.diagonal();
  const double least =
      options_.min_column_remainder * std::sqrt(*std::max_element(squares.begin(), squares.end()));
  std::vector<RowsOfBlocks> rows;
  Status status = EliminateByRows(least, &rows);
  if (!status.ok() || layout_.num_frames == 0) {
    return status;
  }
  diagonal_.setZero(plans_.pattern.size());
  const std::vector<double> no_damping(static_cast<std::size_t>(layout_.size()), 0.0);
  status = factor_.Analyze(ReducedMatrix(plans_.pattern, elimination_.S(), no_damping.data()));
  if (!status.ok()) {
    return status;
  }
  FrontQr qr(factor_.tree(), plans_.pattern, least);
  for (RowsOfBlocks& each : rows) {
    AddSquares(each);
    qr.Add(std::move(each));
  }
  status = factor_.FactorizeBy([&qr](int f, double* L) { return qr.Eliminate(f, L); });
  return status.ok() ? CheckGauge()
                     : Status::Error(status.code,
                                     "there is no covariance: the gauge is free, or a variable is "
                                     "not determined (" +
                                         status.message + ")");
}

}  // namespace inceres::internal
