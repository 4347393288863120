// Products by block are listed alike, whether a counter is kept for each block or few are sorted.
#include "schur/product_lists.h"

#include <algorithm>
#include <random>
#include <tuple>
#include <vector>

#include <gtest/gtest.h>

namespace inceres::internal {
namespace {

using Listed = std::vector<std::tuple<int, int, int>>;  // block, a, b

Listed All(ProductLists* lists) {
  Listed all;
  for (const ProductLists::List& list : lists->Sort()) {
    for (int k = 0; k < list.count; ++k) {
      const ProductTerm& term = lists->terms()[list.first_term + k];
      all.emplace_back(list.block, static_cast<int>(term.a), static_cast<int>(term.b));
    }
  }
  return all;
}

TEST(ProductLists, AreThoseOfEachBlockInTheOrderInWhichTheyCame) {
  constexpr int kBlocks = 50;
  ProductLists counted(kBlocks), sorted(0);
  std::mt19937 random(5);
  for (int round = 0; round < 3; ++round) {
    Listed expected;
    std::vector<Listed> of_block(kBlocks);
    for (int k = 0; k < 40 * round; ++k) {
      const int block = static_cast<int>(random() % kBlocks);
      const ProductTerm term{k, 2 * k};
      counted.Add(block, term);
      sorted.Add(block, term);
      of_block[static_cast<std::size_t>(block)].emplace_back(block, k, 2 * k);
    }
    for (const Listed& listed : of_block) {
      expected.insert(expected.end(), listed.begin(), listed.end());
    }
    Listed by_count = All(&counted);
    // Blocks come in any order there, the products of one in theirs.
    std::stable_sort(by_count.begin(), by_count.end(),
                     [](const auto& a, const auto& b) { return std::get<0>(a) < std::get<0>(b); });
    EXPECT_EQ(by_count, expected);
    EXPECT_EQ(All(&sorted), expected);
    counted.Clear();
    sorted.Clear();
  }
}

}  // namespace
}  // namespace inceres::internal
