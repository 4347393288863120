#pragma once

#include <cstddef>
#include <vector>

#include "base/aligned_vector.h"
#include "base/executor.h"
#include "base/zeroed_array.h"
#include "inceres/linear/reduced_solver.h"
#include "linear/dense_order.h"

namespace inceres::internal {

/// L Lᵀ = S + diag, dense, column-major lower triangle, by panels of our own kernels: no BLAS,
/// whose threads are process-wide and would break both "one thread" and "same bits". Left-looking;
/// the row strips of a panel are independent tasks. What stays zero ahead of each row's first block
/// is left out, in the order of OrderForEnvelope. Cost: at most n³/3 flops. Source: Golub & Van
/// Loan, section 4.2.
class DenseCholesky final : public ReducedSolver {
 public:
  explicit DenseCholesky(const Executor& executor) : executor_(executor) {}

  const char* Name() const override { return "dense Cholesky"; }
  Status Analyze(const ReducedMatrix& A) override;
  Status Factorize(const ReducedMatrix& A, const Rows& changed) override;
  Status Solve(const double* b, const Rows& changed_b, const Truncation& truncation,
               double* x) override;
  std::size_t Bytes() const override { return L_.size() * sizeof(double); }

  /// The block rows of the pattern as they are eliminated.
  const std::vector<int>& order() const { return order_.blocks; }
  /// Flops of one factorization.
  double PredictedFlops() const { return order_.flops; }
  /// Entries of the factor that may not be zero.
  double PredictedEntries() const { return order_.entries; }
  /// Flops of the products with columns ahead of each panel as they are carried out: tiles reach
  /// beyond the envelope.
  double ProductFlops() const;

 private:
  /// Rows [top, bottom), in whole quads, that have something from column start on.
  struct Strip {
    int top, bottom, start;
  };
  /// Columns [left, right) of a panel.
  struct Group {
    int left, right;
    std::vector<Strip> updated;  // by the columns ahead of the panel
  };
  struct Panel {
    std::vector<Group> groups;
    std::vector<Strip> below;  // of its own columns
  };

  bool IsSmall() const;
  void FindRowStarts();
  int StartOf(int top, int bottom) const;
  static void Append(const Strip& granule, std::vector<Strip>* strips);
  void CutGroup(int first, Group* group) const;
  void CutBelow(int first, int end, std::vector<Strip>* strips) const;
  void CutPanels();
  const Panel& PanelAt(int first) const {
    return panels_[static_cast<std::size_t>(first / panel_)];
  }
  void CopyIn(const ReducedMatrix& A);
  void UpdateGroup(int first, const Group& group);
  void SolvePanel(int first, int width);
  double* Column(int j) { return L_.data() + static_cast<std::ptrdiff_t>(j) * stride_; }

  const Executor& executor_;
  const BlockPattern* pattern_ = nullptr;
  Status factored_ = Status::Error(StatusCode::kInvalidArgument, "not factored yet");
  DenseOrder order_;
  std::vector<int> offset_of_;   // per block of the pattern: its first scalar row in the order
  std::vector<int> quad_start_;  // per quad of rows: the first column that has something
  std::vector<Panel> panels_;
  int size_ = 0;
  int padded_size_ = 0;  // to whole quads; below size_ the columns are zero
  int stride_ = 0;
  int panel_ = 0;
  ZeroedArray L_;
  AlignedVector<double> right_side_;
};

}  // namespace inceres::internal
