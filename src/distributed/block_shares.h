#pragma once

#include <cstdint>
#include <vector>

#include "distributed/communicator.h"
#include "distributed/reduced_system.h"
#include "linear/aggregation.h"

namespace inceres::internal {

/// Blocks of S summed over ranks. Each rank forms its share of a block; shares go to the owner of
/// the block's row by one exchange that is planned once, and are summed there.
class BlockShares {
 public:
  enum class Form {
    kUpper,  ///< the blocks on the diagonal and above it
    kLower,  ///< those on it and below
    kWhole,  ///< all
  };
  /// Of the sums: by rank, or the owner's own share first, and then the others by rank.
  enum class Order { kByRank, kOwnFirst };

  /// A block by the numbers of its rows and columns in the matrix of all ranks, of which the first
  /// one is given.
  struct Place {
    std::int64_t row;
    std::int64_t column;
    std::int32_t rows;
    std::int32_t columns;
  };
  struct OwnedBlock {
    Place place;
    std::int64_t begin;  ///< of its values
  };

  /// `clusters`: of the frames here, which keep the blocks that count; null: all do. Collective, as
  /// all calls. Throws AgreedFailure, on all ranks, if one cannot plan its shares.
  BlockShares(const RankedParts& parts, const FrameClusters* clusters, Form form, Order order);

  /// Ascending by row and column.
  const std::vector<OwnedBlock>& owned() const { return owned_; }
  std::int64_t num_values() const { return static_cast<std::int64_t>(sums_.size()); }
  /// Sums the S of the last elimination: the owned blocks one after the other, each row-major. They
  /// may be changed until the next call.
  std::vector<double>& Sum();
  std::int64_t Bytes() const;

 private:
  // A block that is formed here, and goes to a rank.
  struct Share {
    Place place;
    int block;  // of the pattern
    bool transposed;
  };
  // One that is received: where its values are, and where they are summed.
  struct Term {
    std::int64_t from;
    std::int64_t to;
    std::int64_t size;
  };

  std::vector<std::vector<Share>> CollectShares(const FrameClusters* clusters, Form form) const;
  void NumberShares(const std::vector<std::vector<Share>>& of_rank,
                    std::vector<std::vector<Place>>* places);
  std::vector<Place> PlanExchange(std::vector<std::vector<Place>> places);
  void PlanSums(const std::vector<Place>& received, Order order);
  void PackShares();

  const RankedParts& parts_;
  std::vector<Share> shares_;                  // by rank
  Communicator::Parts to_ranks_, from_ranks_;  // values
  std::vector<Term> terms_;                    // in the order of the sums
  std::vector<OwnedBlock> owned_;
  std::vector<double> sent_, received_, sums_;
};

}  // namespace inceres::internal
