#include "linearize/tangent.h"

#include <utility>
#include <vector>

#include <gtest/gtest.h>

namespace inceres::internal {
namespace {

struct Classified {
  Classified(int ambient_size, int tangent_size, std::vector<double> M)
      : plus_jacobian(std::move(M)), selection(tangent_size, -1) {
    map.ambient_size = ambient_size;
    map.tangent_size = tangent_size;
    map.plus_jacobian = plus_jacobian.data();
    ClassifyTangentMap(&map, selection.data());
  }
  std::vector<double> plus_jacobian;
  std::vector<int> selection;
  TangentMap map;
};

TEST(TangentClasses, IdentityAndSelection) {
  EXPECT_EQ(Classified(2, 2, {1, 0, 0, 1}).map.kind, TangentMap::Kind::kIdentity);
  const Classified permuted(3, 2, {0, 1, 0, 0, 1, 0});
  EXPECT_EQ(permuted.map.kind, TangentMap::Kind::kSelection);
  EXPECT_EQ(permuted.selection, (std::vector<int>{2, 0}));
  EXPECT_EQ(Classified(2, 2, {1, 0, 0, 0}).map.kind,
            TangentMap::Kind::kDense);  // a zero column selects nothing
}

TEST(TangentClasses, LeadingIdentityColumnsOfADenseMap) {
  // A pose: the translation as it is, the rest anything.
  EXPECT_EQ(Classified(5, 4, {1, 0, 0, 0, 0, 1, 0, 0, 0, 0, .5, .1, 0, 0, .2, .3, 0, 0, .4, .7})
                .map.num_identity_columns,
            2);
  // An entry beside the one in its row, or below it in its column: not a copy any more.
  EXPECT_EQ(Classified(3, 2, {1, 0.1, 0, 1, 0, 2}).map.num_identity_columns, 0);
  EXPECT_EQ(Classified(3, 2, {1, 0, 0, 2, 0.1, 1}).map.num_identity_columns, 0);
  // The identity further down does not count.
  EXPECT_EQ(Classified(3, 2, {2, 0, 0, 1, 0, 0}).map.num_identity_columns, 0);
}

// What a variable was classified as at one point must not linger at the next.
TEST(TangentClasses, AreFoundAnew) {
  Classified classified(3, 2, {1, 0, 0, 2, 0, 1});
  EXPECT_EQ(classified.map.num_identity_columns, 1);
  classified.plus_jacobian = {3, 0, 0, 2, 0, 1};
  classified.map.plus_jacobian = classified.plus_jacobian.data();
  ClassifyTangentMap(&classified.map, classified.selection.data());
  EXPECT_EQ(classified.map.num_identity_columns, 0);
}

}  // namespace
}  // namespace inceres::internal
