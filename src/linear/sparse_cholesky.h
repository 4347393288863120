#pragma once

#include <cstddef>
#include <vector>

#include "base/aligned_vector.h"
#include "base/executor.h"
#include "base/zeroed_array.h"
#include "inceres/linear/reduced_solver.h"
#include "linear/front_tree.h"

namespace inceres::internal {

/// L Lᵀ = S + diag, sparse, multifrontal, by our own kernels: dense fronts of whole blocks, in the
/// order of BuildFrontTree. Where the assembly tree branches into heavy subtrees these are tasks,
/// and so are the strips of large fronts. The same bits for any number of threads. Memory: the
/// factor, and update matrices as long as they wait for their parent; no copy of S. Sources: Duff &
/// Reid, ACM TOMS 9(3), 1983; Liu, SIAM Review 34(1), 1992.
class SparseCholesky final : public ReducedSolver {
 public:
  explicit SparseCholesky(const Executor& executor) : executor_(executor) {}

  const char* Name() const override;
  Status Analyze(const ReducedMatrix& A) override;
  /// What Analyze does, but for taking the memory, and for a dissection, which is for the threads
  /// and takes no fewer operations: for who only wants the predictions.
  Status Predict(const BlockPattern& pattern) {
    return BuildFrontTree(pattern, &tree_, /*may_dissect=*/false);
  }
  /// For who forms S anew for each factorization, and reads none of it afterwards: from now on its
  /// values are in the returned memory, that of the factor, where pattern->value_begin says
  /// (PlaceValuesInFactor). The pattern is the one that was analyzed. Before any factorization.
  double* PlaceValues(BlockPattern* pattern);
  Status Factorize(const ReducedMatrix& A, const Rows& changed) override;
  Status Solve(const double* b, const Rows& changed_b, const Truncation& truncation,
               double* x) override;
  std::size_t Bytes() const override;
  /// A factor from elsewhere, of what was analyzed: fill(f, L), front by front, children first,
  /// writes the columns of the front's pivots, and returns the pivot that it fails at, or −1.
  template <typename Fill>
  Status FactorizeBy(const Fill& fill) {
    int failed = FrontTree::kNone;
    for (int f = 0; f < static_cast<int>(tree_.fronts.size()) && failed == FrontTree::kNone; ++f) {
      const int pivot = fill(f, Column(f, 0));
      failed = pivot < 0 ? FrontTree::kNone : BlockAtPivot(tree_.fronts[f], pivot);
    }
    return End(failed, failed);
  }

  /// The block of S at which the last factorization failed; -1: it did not.
  int failed() const { return failed_at_; }
  /// Flops of one factorization.
  double PredictedFlops() const { return tree_.flops; }
  /// Entries of the factor.
  double PredictedEntries() const { return tree_.entries; }
  /// What a factorization takes, the tree included.
  double PredictedBytes() const;

  /// What was analyzed, and column j of front f of the last factor, its pivots' rows first: for who
  /// goes on from the factor.
  const FrontTree& tree() const { return tree_; }
  const double* Column(int f, int j) const {
    return L_.data() + tree_.factor_begin[f] +
           static_cast<std::ptrdiff_t>(j) * tree_.fronts[f].stride();
  }

 private:
  Status End(int failed, int row);
  /// The block of S at which it fails; -1: it does not.
  int FactorSegment(int index, const ReducedMatrix& A);
  void SolveForward(const FrontSegment& segment, const double* b);
  void SolveBackward(const FrontSegment& segment, double* x);
  void Open(int f, const ReducedMatrix& A);
  void Assemble(int f, const ReducedMatrix& A);
  void AddUpdate(int child, int f);
  /// The block of S at which the front is not positive definite; -1: it is.
  int Eliminate(int f);
  int BlockAtPivot(const Front& front, int pivot) const;
  void SolveForward(int f, const double* b);
  void SolveBackward(int f, double* x);

  template <typename Body>
  void ForSegmentsBefore(const FrontSegment& segment, const Body& body) const;

  double* Column(int f, int j) {
    return L_.data() + tree_.factor_begin[f] +
           static_cast<std::ptrdiff_t>(j) * tree_.fronts[f].stride();
  }
  double* Update(int f) { return updates_.data() + tree_.update_begin[f]; }
  double* Vector(int f) { return vectors_.data() + tree_.vector_begin[f]; }

  const Executor& executor_;
  const BlockPattern* pattern_ = nullptr;
  Status factored_ = Status::Error(StatusCode::kInvalidArgument, "not factored yet");
  FrontTree tree_;
  int failed_at_ = FrontTree::kNone;
  std::vector<int> failed_;        // per segment: block of S; -1: none
  ZeroedArray L_;                  // the pivots' columns of every front
  ZeroedArray updates_;            // those that do not wait at the same time share memory
  AlignedVector<double> vectors_;  // per front: its part of y and x
};

}  // namespace inceres::internal
