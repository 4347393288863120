#include "linear/reduced_prediction.h"

#include "linear/sparse_cholesky.h"

namespace inceres::internal {

// What factoring S will cost, before anything is factored: the batch choice between dense and
// sparse (docs/algorithms.md, "Reduced linear systems"), and what a choice of landmarks to
// eliminate is compared by. A prediction is made of counts, with constants for how fast they are
// worked off.

namespace {

// Both factor with the same kernels, 14 to 25 GFlop/s on one thread; the sparse one takes fewer
// flops but where most blocks are there, the dense one less analysis and no lists, which shows up
// to this size (windows, paths, full systems of 75 to 1,500).
constexpr double kAlwaysDenseSize = 300.0;
constexpr double kAlwaysDenseFill = 0.5;

// A flop of the sparse factorization takes so much longer, and a block of S so many flops to be
// found, placed and solved with.
constexpr double kSparsePenalty = 1.5;
constexpr double kFlopsPerBlock = 1000.0;

// Where an envelope is narrow, what the solver finds instead, with small fronts merged, may take
// more: 1.5 times as much on a street of 400 cameras.
constexpr double kEnvelopeSlack = 2.0;
// Of what lies in the envelope: S, the factor with what its fronts pass on, and as much again.
constexpr double kEnvelopeCopies = 4.0;

}  // namespace

bool IsSolvedDensely(double size, double fill) {
  return size <= kAlwaysDenseSize || fill >= kAlwaysDenseFill;
}

double FillOf(const BlockPattern& pattern) {
  const auto n = static_cast<double>(pattern.size());
  // Diagonal blocks are stored whole, so a full S of few blocks comes out a little above 1.
  return static_cast<double>(pattern.value_begin.back()) / (0.5 * n * (n + 1.0));
}

ReducedPrediction PredictFullSystem(double size) {
  return {size * size * size / 3.0,
          1.5 * sizeof(double) * size * size};  // a square for the factor, half of one for S
}

// Row i of the factor, of w entries, takes w² flops: w dot products of w entries at most.
void EnvelopeCost::AddRows(int num_blocks, int num_entries, int num_rows) {
  const double entries = static_cast<double>(num_rows) * num_entries;
  flops_ += entries * num_entries;
  blocks_ += num_blocks;
  entries_ += entries;
}

ReducedPrediction EnvelopeCost::prediction() const {
  return {kEnvelopeSlack * kSparsePenalty * flops_ + kFlopsPerBlock * blocks_,
          kEnvelopeCopies * sizeof(double) * entries_};
}

Status PredictReducedSolver(const BlockPattern& pattern, ReducedPrediction* prediction) {
  if (IsSolvedDensely(pattern.size(), FillOf(pattern))) {
    *prediction = PredictFullSystem(pattern.size());
    return Status::Ok();
  }
  // The symbolic analysis is all that is asked of the solver: no memory for values, no threads.
  const Executor executor(1);
  SparseCholesky solver(executor);
  const Status planned = solver.Predict(pattern);
  const auto entries = static_cast<double>(pattern.value_begin.back());
  prediction->cost = kSparsePenalty * solver.PredictedFlops() +
                     kFlopsPerBlock * static_cast<double>(pattern.columns.size());
  prediction->bytes = sizeof(double) * entries + solver.PredictedBytes();
  return planned;
}

}  // namespace inceres::internal
