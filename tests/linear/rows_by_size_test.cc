// The order in which Householder reflections take rows.
#include "linear/rows_by_size.h"

#include <limits>
#include <vector>

#include <gtest/gtest.h>

namespace inceres::internal {
namespace {

using Order = std::vector<Eigen::Index>;

TEST(LargestRowsFirst, BySizeAndTiesInTheirOrder) {
  Eigen::MatrixXd rows(5, 3);
  rows << 1.0, -2.0, 0.5,  //
      0.0, 0.0, 0.0,       //
      7.0, 7.0, 7.0,       //
      2.0, 0.0, 0.0,       //
      0.0, 0.0, -1e9;
  EXPECT_EQ(LargestRowsFirst(rows), (Order{4, 2, 0, 3, 1}));
  // Also of a part of a larger matrix.
  EXPECT_EQ(LargestRowsFirst(rows.topLeftCorner(4, 2)), (Order{2, 0, 3, 1}));
  EXPECT_EQ(LargestRowsFirst(rows.topRows(0)), Order());
  EXPECT_EQ(LargestRowsFirst(rows.leftCols(0)), (Order{0, 1, 2, 3, 4}));
}

// Wherever in a row NaN stands, it does not spoil the order of the others.
TEST(LargestRowsFirst, RowsWithNaNComeFirst) {
  constexpr double kNaN = std::numeric_limits<double>::quiet_NaN();
  for (int place = 0; place < 3; ++place) {
    Eigen::MatrixXd rows = Eigen::MatrixXd::Zero(40, 3);
    Order expected;
    for (Eigen::Index i = 0; i < 40; ++i) {
      rows(i, (place + i) % 3) = static_cast<double>(i % 2 == 0 ? i : -i);
      if (i % 3 == 1) {
        rows(i, place) = kNaN;
        expected.push_back(i);
      }
    }
    for (Eigen::Index i = 39; i >= 0; --i) {
      if (i % 3 != 1) {
        expected.push_back(i);
      }
    }
    EXPECT_EQ(LargestRowsFirst(rows), expected) << place;
  }
}

}  // namespace
}  // namespace inceres::internal
