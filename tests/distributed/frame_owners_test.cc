// Who owns a frame: what ranks send is balanced.
#include <algorithm>
#include <vector>

#include <gtest/gtest.h>

#include "distributed/shared_frames.h"
#include "support/random_values.h"

namespace inceres::test {
namespace {

using internal::ChooseFrameOwners;
using internal::FrameSharer;

// What each rank sends in a product over the entries of the frames it shares.
std::vector<double> Ratios(const std::vector<int>& sizes, const std::vector<FrameSharer>& sharers,
                           const std::vector<int>& owners, int num_ranks) {
  std::vector<int> sharers_of(sizes.size(), 0);
  for (const FrameSharer& sharer : sharers) {
    ++sharers_of[static_cast<std::size_t>(sharer.frame)];
  }
  std::vector<double> sent(static_cast<std::size_t>(num_ranks), 0.0), shared(sent);
  for (const FrameSharer& sharer : sharers) {
    const auto frame = static_cast<std::size_t>(sharer.frame);
    const auto rank = static_cast<std::size_t>(sharer.rank);
    if (sharers_of[frame] > 1) {
      shared[rank] += sizes[frame];
      sent[rank] += sizes[frame] * (owners[frame] == sharer.rank ? sharers_of[frame] - 1 : 1);
    }
  }
  for (std::size_t r = 0; r < sent.size(); ++r) {
    sent[r] = shared[r] > 0.0 ? sent[r] / shared[r] : 0.0;
  }
  return sent;
}

TEST(FrameOwners, AllFramesOnAllRanks) {
  const std::vector<int> sizes(50, 9);
  std::vector<FrameSharer> sharers;
  for (int frame = 0; frame < 50; ++frame) {
    for (int rank = 0; rank < 5; ++rank) {
      sharers.push_back({frame, rank, 10 + (frame * 7 + rank * 3) % 11});
    }
  }
  const std::vector<int> owners = ChooseFrameOwners(sizes, sharers, 5);
  for (int rank = 0; rank < 5; ++rank) {
    EXPECT_EQ(std::count(owners.begin(), owners.end(), rank), 10);
  }
  for (const double ratio : Ratios(sizes, sharers, owners, 5)) {
    EXPECT_NEAR(ratio, 2.0 * 4 / 5, 1e-12);  // 2 (h − 1) / h
  }
}

TEST(FrameOwners, SomeFramesOnSomeRanks) {
  std::vector<int> sizes;
  std::vector<FrameSharer> sharers;
  Random random(7);
  for (int frame = 0; frame < 400; ++frame) {
    sizes.push_back(frame % 3 == 0 ? 6 : 9);
    for (int rank = 0; rank < 4; ++rank) {
      if (rank == frame % 4 || random.Unit() > 0.2) {
        sharers.push_back({frame, rank, 5});
      }
    }
  }
  const std::vector<int> owners = ChooseFrameOwners(sizes, sharers, 4);
  const std::vector<double> ratios = Ratios(sizes, sharers, owners, 4);
  const auto [least, most] = std::minmax_element(ratios.begin(), ratios.end());
  EXPECT_LT(*most - *least, 0.05);
  std::vector<int> owned(4, 0);
  for (std::size_t i = 0; i < owners.size(); ++i) {
    EXPECT_TRUE(std::any_of(sharers.begin(), sharers.end(), [&](const FrameSharer& sharer) {
      return sharer.frame == static_cast<int>(i) && sharer.rank == owners[i];
    })) << i;
    owned[static_cast<std::size_t>(owners[i])] += sizes[i];
  }
  EXPECT_LT(*std::max_element(owned.begin(), owned.end()),
            1.2 * *std::min_element(owned.begin(), owned.end()));
}

TEST(FrameOwners, OfEqualsTheOneWithMoreFactors) {
  EXPECT_EQ(ChooseFrameOwners({9}, {{0, 0, 3}, {0, 1, 4}}, 2), std::vector<int>{1});
  EXPECT_EQ(ChooseFrameOwners({}, {}, 3), std::vector<int>{});
}

}  // namespace
}  // namespace inceres::test
