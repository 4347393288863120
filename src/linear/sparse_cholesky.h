#pragma once

#include <cstddef>
#include <vector>

#include "base/aligned_vector.h"
#include "base/executor.h"
#include "base/zeroed_array.h"
#include "inceres/linear/reduced_solver.h"
#include "linear/front_tree.h"

namespace inceres::internal {

/// L Lᵀ = S + diag, sparse, multifrontal, by our own kernels: dense fronts of whole blocks, in the order of BuildFrontTree. Where
/// the assembly tree branches into heavy subtrees these are tasks, and so are the strips of large fronts. The same bits for any
/// number of threads. Memory: the factor, and update matrices as long as they wait for their parent; no copy of S. A parent that
/// is smaller than what would wait for it takes each as it comes: a few points seen by a thousand cameras are one front with a
/// thousand children. Sources: Duff & Reid, ACM TOMS 9(3), 1983; Liu, SIAM Review 34(1), 1992.
class SparseCholesky final : public ReducedSolver {
 public:
  explicit SparseCholesky(const Executor& executor) : executor_(executor) {}

  const char* Name() const override;
  Status Analyze(const BlockPattern& pattern) override;
  /// What Analyze does, but for taking the memory, and for a dissection, which is for the threads and takes no fewer operations:
  /// for who only wants the predictions.
  Status Predict(const BlockPattern& pattern) { return Plan(pattern, /*may_dissect=*/false); }
  Status Factorize(const double* values, const double* diagonal) override;
  Status Solve(const double* b, double* x) override;

  /// Flops of one factorization.
  double PredictedFlops() const { return tree_.flops; }
  /// Entries of the factor.
  double PredictedEntries() const { return tree_.entries; }
  /// What a factorization takes, the tree included.
  double PredictedBytes() const;
  std::size_t Bytes() const;

 private:
  Status Plan(const BlockPattern& pattern, bool may_dissect);
  /// Fronts that one task takes one after the other, once those of the segments before it are done.
  struct Segment {
    std::vector<int> fronts;  // ascending
    std::vector<int> before;  // other segments, independent of each other
    int failed = -1;          // block of S; -1: none
  };

  void CutIntoSegments();
  void ChooseEarlyFronts();
  void PlanMemory();
  std::size_t PlanUpdates(const Segment& segment, std::size_t begin);
  void FactorSegment(Segment* segment, const double* values, const double* diagonal);
  void SolveForward(const Segment& segment, const double* b);
  void SolveBackward(const Segment& segment, double* x);
  void Open(int f, const double* values, const double* diagonal);
  void Assemble(int f, const double* values, const double* diagonal);
  void AddUpdate(int child, int f);
  /// The block of S at which the front is not positive definite; -1: it is.
  int Eliminate(int f);
  int BlockAtPivot(const Front& front, int pivot) const;
  void SolveForward(int f, const double* b);
  void SolveBackward(int f, double* x);

  template <typename Body>
  void ForSegmentsBefore(const Segment& segment, const Body& body) const;
  template <typename Body>
  void ForStrips(const Front& front, int begin, int end, int strip, const Body& body) const;

  std::size_t UpdateSize(int f) const {
    return static_cast<std::size_t>(tree_.fronts[f].update_stride()) * tree_.fronts[f].height;
  }
  /// Whether the front's update matrix is added to its parent as soon as it is there.
  bool IsTakenEarly(int f) const {
    const int parent = tree_.fronts[f].parent;
    return parent >= 0 && opened_by_[parent] >= 0 && segment_of_[parent] == segment_of_[f];
  }

  double* Column(int f, int j) {
    return L_.data() + factor_begin_[f] + static_cast<std::ptrdiff_t>(j) * tree_.fronts[f].stride();
  }
  double* Update(int f) { return updates_.data() + update_begin_[f]; }
  double* Vector(int f) { return vectors_.data() + vector_begin_[f]; }

  const Executor& executor_;
  const BlockPattern* pattern_ = nullptr;
  FrontTree tree_;
  std::size_t factor_size_ = 0, updates_size_ = 0, vectors_size_ = 0;
  std::vector<Segment> segments_;  // the last to be done first
  std::vector<int> segment_of_;    // per front
  std::vector<int> opened_by_;  // per front: its first child if it takes children's update matrices as they come; -1: it does not
  std::vector<std::size_t> factor_begin_, update_begin_, vector_begin_;  // per front
  ZeroedArray L_;                                                        // the pivots' columns of every front
  ZeroedArray updates_;                                                  // those that do not wait at the same time share memory
  AlignedVector<double> vectors_;                                        // per front: its part of y and x
};

}  // namespace inceres::internal
