// The marginal that goes along with the newest row of a matrix that grows.
#include "linear/tip_marginal.h"

#include <algorithm>

#include <Eigen/Cholesky>
#include <gtest/gtest.h>

#include "linear/growing_system.h"
#include "support/dense_oracle.h"

namespace inceres::internal {
namespace {

// A growing S without damping, and the tip that follows it.
class GrowingPath {
 public:
  explicit GrowingPath(unsigned seed) : system_(seed) {
    for (int k = 0; k < 8; ++k) {
      AddRow(2, 1 + system_.random.Below(6));
    }
    SetTip();
  }

  GrowingSystem& system() { return system_; }
  TipMarginal& tip() { return tip_; }
  int newest() const { return system_.num_rows() - 1; }

  void AddRow(int band, int size) {
    system_.AddRow(size, band, false);
    std::fill(system_.damping.begin(), system_.damping.end(), 0.0);
  }
  // What a factor between the two newest rows adds to the older one; nothing that it tells of that
  // alone, as odometry, if `k_share` is 0.
  void AddOdometry(int size, double k_share) {
    AddRow(1, size);
    const int n = newest(), p = n - 1;
    const Eigen::MatrixXd dense = system_.Dense();
    const int at_n = system_.OffsetOf(n), at_p = system_.OffsetOf(p), rows = system_.S.size_of(p);
    const Eigen::MatrixXd B = dense.block(at_p, at_n, rows, size);
    Eigen::MatrixXd gain =
        B * dense.bottomRightCorner(size, size).llt().solve(B.transpose().eval());
    gain.diagonal().array() += k_share * dense(at_p, at_p);
    double* const block = system_.S.values(system_.S.FindOrAdd(p, p));
    for (int i = 0; i < rows; ++i) {
      for (int j = 0; j < rows; ++j) {
        block[i * PadToQuad(rows) + j] += gain(i, j);
      }
    }
    tip_.Follow(system_.S, {p, n});
  }
  Eigen::MatrixXd MarginalOf(int row) const {
    const int size = system_.S.size_of(row), at = system_.OffsetOf(row);
    const Eigen::MatrixXd inverse =
        system_.Dense().llt().solve(Eigen::MatrixXd::Identity(system_.size(), system_.size()));
    return inverse.block(at, at, size, size);
  }
  void SetTip() { tip_.Set(system_.S, newest(), MarginalOf(newest())); }

 private:
  GrowingSystem system_;
  TipMarginal tip_;
};

TEST(TipMarginal, IsThatOfADenseInverseAlongAPath) {
  for (unsigned seed = 1; seed <= 5; ++seed) {
    GrowingPath path(seed);
    for (int step = 0; step < 40; ++step) {
      // Now and then what is new tells something of the row before, more or less than it had.
      const double k_share = step % 5 == 3 ? 0.5 : step % 5 == 4 ? -0.2 : 0.0;
      // Poses of one kind, in the plane or in space, or rows of any size.
      const int size = seed == 1 ? 3 : seed == 2 ? 6 : 1 + path.system().random.Below(6);
      path.AddOdometry(size, k_share);
      ASSERT_TRUE(path.tip().Knows(path.newest())) << seed << ", " << step;
      ASSERT_LE(
          test::RelativeError(Eigen::MatrixXd(path.tip().sigma()), path.MarginalOf(path.newest())),
          1e-12)
          << seed << ", " << step;
    }
  }
}

TEST(TipMarginal, IsNotKnownAfterAnythingElse) {
  const auto knows_after = [](auto change) {
    GrowingPath path(7);
    change(&path);
    return path.tip().Knows(path.newest());
  };
  EXPECT_TRUE(knows_after([](GrowingPath* path) { path->AddOdometry(3, 0.0); }));
  // A loop.
  EXPECT_FALSE(knows_after([](GrowingPath* path) {
    path->AddRow(1, 3);
    path->system().Couple(path->newest(), 2);
    path->tip().Follow(path->system().S, {2, path->newest() - 1, path->newest()});
  }));
  // One that was not told of with its rows.
  EXPECT_FALSE(knows_after([](GrowingPath* path) {
    path->AddRow(1, 3);
    path->system().Couple(path->newest(), 2);
    path->tip().Follow(path->system().S, {path->newest() - 1, path->newest()});
  }));
  // Another block of the row before was summed anew.
  EXPECT_FALSE(knows_after([](GrowingPath* path) {
    path->AddRow(1, 3);
    path->system().Couple(path->newest() - 1, path->newest() - 2);
    path->tip().Follow(path->system().S, {path->newest() - 1, path->newest()});
  }));
  // The tip has changed by itself.
  EXPECT_FALSE(knows_after([](GrowingPath* path) {
    path->system().Perturb(path->newest());
    path->tip().Follow(path->system().S, {path->newest()});
  }));
  // A row has gone.
  EXPECT_FALSE(knows_after([](GrowingPath* path) {
    path->system().RemoveRow(0);
    path->AddOdometry(3, 0.0);
  }));
  // A row that grows from another than the tip.
  EXPECT_FALSE(knows_after([](GrowingPath* path) {
    path->AddRow(0, 3);
    path->system().Couple(path->newest(), 2);
    path->tip().Follow(path->system().S, {2, path->newest()});
  }));
  // Rows that are larger than those it follows.
  EXPECT_FALSE(knows_after([](GrowingPath* path) { path->AddOdometry(16, 0.0); }));
}

// Almost all information goes: what is left of the digits is too little.
TEST(TipMarginal, IsGivenUpWhereDigitsGo) {
  GrowingPath path(3);
  path.AddOdometry(3, 1e6);
  EXPECT_FALSE(path.tip().Knows(path.newest()));
}

}  // namespace
}  // namespace inceres::internal
