// Products with the inverse of a matrix that has gone on since it was factored.
#include "linear/pending_rows.h"

#include <algorithm>

#include <Eigen/Cholesky>
#include <gtest/gtest.h>

#include "base/executor.h"
#include "linear/growing_system.h"
#include "support/dense_oracle.h"

namespace inceres::internal {
namespace {

// A growing S without damping, its factor of before, and what has changed since.
class Pending {
 public:
  explicit Pending(unsigned seed) : system_(seed), tree_(executor_) {
    for (int k = 0; k < 12; ++k) {
      AddRow();
    }
    Factorize();
  }

  void Change() {
    const int row = system_.random.Below(system_.num_rows());
    switch (system_.random.Below(3)) {
      case 0:
        return AddRow();
      case 1:
        system_.Perturb(row);
        return Note(row);
      default:
        Couple(row, system_.random.Below(system_.num_rows()));
    }
  }
  bool TakeUp() { return pending_.TakeUp(system_.S, tree_, rows_); }
  void Factorize() {
    ASSERT_TRUE(system_.Factorize({}, &tree_).ok());
    rows_.clear();
    pending_.Forget();
  }
  // Of all columns of one row, and of a mixture of it and another.
  void ExpectProducts() {
    const Eigen::MatrixXd inverse =
        system_.Dense().llt().solve(Eigen::MatrixXd::Identity(system_.size(), system_.size()));
    std::vector<int> offsets;
    for (int row = 0; row <= system_.num_rows(); ++row) {
      offsets.push_back(system_.OffsetOf(row));
    }
    for (int row = 0; row < system_.num_rows(); ++row) {
      const int other = (row + 5) % system_.num_rows();
      const int size = system_.S.size_of(row), end = size + system_.S.size_of(other);
      SparseColumns V{{row, other}, {0, size}, Eigen::MatrixXd::Zero(end, 2)};
      V.values.col(0).head(size).setLinSpaced(1.0, 2.0);
      V.values.col(1).tail(end - size).setConstant(-0.5);
      Eigen::MatrixXd whole = Eigen::MatrixXd::Zero(system_.size(), 2), product;
      whole.middleRows(offsets[static_cast<std::size_t>(row)], size) = V.values.topRows(size);
      whole.middleRows(offsets[static_cast<std::size_t>(other)], end - size) =
          V.values.bottomRows(end - size);
      ASSERT_TRUE(pending_.Product(V, offsets, tree_.tree(), &product).ok());
      ASSERT_LE(test::RelativeError(product, whole.transpose() * inverse * whole), 1e-12) << row;
    }
  }

 private:
  void AddRow() {
    system_.AddRow(1 + system_.random.Below(6), 1, false);
    std::fill(system_.damping.begin(), system_.damping.end(), 0.0);
    Note(system_.num_rows() - 1);
    Note(std::max(0, system_.num_rows() - 2));
  }
  void Couple(int a, int b) {
    if (a != b) {
      system_.Couple(std::max(a, b), std::min(a, b));
      Note(a);
      Note(b);
    }
  }
  void Note(int row) {
    const auto at = std::lower_bound(rows_.begin(), rows_.end(), row);
    if (at == rows_.end() || *at != row) {
      rows_.insert(at, row);
    }
  }

  GrowingSystem system_;
  const Executor executor_{1};
  BayesTree tree_;
  PendingRows pending_;
  std::vector<int> rows_;
};

TEST(PendingRows, AgreeWithADenseOracleUnderManyRandomChanges) {
  int num_taken_up = 0;
  for (unsigned seed = 1; seed <= 6; ++seed) {
    Pending system(seed);
    for (int step = 0; step < 40; ++step) {
      system.Change();
      if (system.TakeUp()) {
        ++num_taken_up;
        ASSERT_NO_FATAL_FAILURE(system.ExpectProducts()) << "seed " << seed << ", step " << step;
      } else {
        system.Factorize();
      }
    }
  }
  EXPECT_GT(num_taken_up, 100);
}

}  // namespace
}  // namespace inceres::internal
