#pragma once

#include <cstdint>
#include <vector>

namespace inceres::internal {

/// A rank that has factors of a frame.
struct FrameSharer {
  int frame;
  int rank;
  std::int64_t num_factors;
};

/// Which of the ranks that share a frame sums its rows: the owner. In a product a rank sends its
/// part of each frame that it shares to the owner, or, of those it owns, the sum to all others: of
/// a frame that h ranks share 2 (h − 1) times its entries are sent, whoever owns it. Owners are
/// such that what a rank sends, over the entries of the frames it shares, is about the same for
/// all, and of the rest that all own as much. `sizes`: entries of each frame. `sharers`: by
/// ascending frame, at least one of each.
std::vector<int> ChooseFrameOwners(const std::vector<int>& sizes,
                                   const std::vector<FrameSharer>& sharers, int num_ranks);

}  // namespace inceres::internal
