#pragma once

#include <cstdint>
#include <memory>
#include <vector>

#include "distributed/communicator.h"
#include "distributed/shared_frames.h"
#include "linear/cluster_cholesky.h"

namespace inceres::internal {

/// The fine part of a two-level preconditioner: those blocks of S + Λ_c whose frames are of one
/// aggregate and have one owner, which sums them and factors them. On one rank that are the blocks
/// of aggregates. Calls are collective, but for Apply.
class FineBlocks {
 public:
  /// `pattern`: of S, of the frames here. `clusters`: of these (RankedAggregates::by_owner). Fails,
  /// on all ranks, as the analysis.
  FineBlocks(const Communicator& ranks, const SharedFrames& frames, const BlockPattern& pattern,
             const FrameClusters& clusters, const Executor& executor, Status* status);

  /// `S`: what factors and landmarks here add to it. kSingular is that of all ranks.
  Status Factorize(const double* S, const std::vector<double>& owned_damping);
  /// z = D⁻¹ r, of the frames owned here, padded.
  void Apply(const double* r, double* z) { factor_->Apply(r, z); }
  std::int64_t Bytes() const;

 private:
  // A block of S, as an owner has it, and whether it lies the other way around here.
  struct Part {
    int block;
    int row;  // number of the frame
    int column;
    bool is_transposed;
  };
  void CollectParts(const FrameClusters& clusters);
  FrameClusters BuildOwned();
  int FindOwned(int row, int column) const;
  void Append(const double* S, const Part& part, std::vector<double>* values) const;
  void Add(const double* values, int block);

  const Communicator& ranks_;
  const SharedFrames& frames_;
  const BlockPattern& pattern_;
  std::vector<Part> own_;
  std::vector<int> own_to_;  // blocks of the owned pattern
  std::vector<std::vector<Part>> sent_;
  std::vector<int> received_to_;
  std::vector<int> row_of_number_;  // per frame of all ranks: its row; −1: not owned here
  BlockPattern owned_;
  std::vector<double> values_;
  std::unique_ptr<ClusterCholesky> factor_;
};

}  // namespace inceres::internal
