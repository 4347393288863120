// A two-level preconditioner against its formula, with dense matrices.
#include "linear/coarse_space.h"

#include <cmath>
#include <limits>
#include <string>
#include <vector>

#include <Eigen/Cholesky>
#include <Eigen/Core>
#include <Eigen/Eigenvalues>
#include <gtest/gtest.h>

#include "linear/cluster_cholesky.h"
#include "linear/random_system.h"
#include "support/core_pipeline.h"
#include "support/dense_oracle.h"

namespace inceres::internal {
namespace {

using Matrix = Eigen::MatrixXd;

// Twelve rows in aggregates of 3, 3, 1 and 5, with 4, 2, 6 and 4 columns.
class CoarseSpaceTest : public ::testing::TestWithParam<int> {  // threads
 protected:
  CoarseSpaceTest() : system_({6, 3, 6, 6, 9, 2, 6, 6, 5, 3, 6, 6}, RandomSystem::Fill::kBand) {
    aggregate_of_ = {0, 0, 0, 1, 1, 1, 2, 3, 3, 3, 3, 3};
    A_ = test::ToDense(system_.pattern, system_.values.data());
    A_.diagonal() += Eigen::Map<const Eigen::VectorXd>(system_.diagonal.data(), A_.rows());
    CoarseShape shape;
    shape.aggregate_of = aggregate_of_;
    shape.widths = {4, 2, 6, 4};
    shape.coupled_begin = {0};
    for (int a = 0; a < 4; ++a) {  // all of them: more than there is does no harm
      for (int i = 0; i < 12; ++i) {
        shape.coupled.push_back(i);
      }
      shape.coupled_begin.push_back(12 * (a + 1));
    }
    Status status;
    space_ = std::make_unique<CoarseSpace>(system_.pattern.offsets, shape, executor_, &status);
    EXPECT_TRUE(status.ok()) << status.message;
    for (int i = 0; i < 12; ++i) {
      padded_.push_back(padded_.back() + PadToQuad(system_.pattern.block_size(i)));
    }
    Fill(/*dependent=*/false);
  }

  // Random columns; dependent: the last one of the first aggregate is the sum of two others, times
  // `spoil` in its first row.
  void Fill(bool dependent, double spoil = 1.0) {
    test::Random random(3);
    for (int i = 0; i < 12; ++i) {
      const int a = aggregate_of_[static_cast<std::size_t>(i)];
      const int width = space_->shape().widths[static_cast<std::size_t>(a)];
      for (int r = 0; r < space_->block_size(i); ++r) {
        double* const v = space_->V(i) + r * space_->stride(a);
        for (int k = 0; k < width; ++k) {
          v[k] = random.Between(-1.0, 1.0);
        }
        v[3] = dependent && a == 0 ? (i + r == 0 ? spoil : 1.0) * (v[0] + v[1]) : v[3];
      }
    }
    std::vector<const double*> N;
    for (int i = 0; i < 12; ++i) {
      const int k = system_.pattern.row_begin[static_cast<std::size_t>(i) + 1] - 1;
      N.push_back(system_.values.data() + system_.pattern.value_begin[static_cast<std::size_t>(k)]);
    }
    space_->Orthonormalize(N);
    const Matrix AV = A_ * V();
    int column = 0;
    for (int a = 0; a < 4; ++a) {
      const int width = space_->shape().widths[static_cast<std::size_t>(a)];
      for (int i = 0; i < 12; ++i) {
        for (int r = 0; r < space_->block_size(i); ++r) {
          for (int k = 0; k < width; ++k) {
            space_->AV(12 * a + i)[r * space_->stride(a) + k] =
                AV(system_.pattern.offsets[static_cast<std::size_t>(i)] + r, column + k);
          }
        }
      }
      column += width;
    }
  }

  Matrix V() const {
    Matrix V = Matrix::Zero(A_.rows(), 16);
    const int first[] = {0, 4, 6, 12};
    for (int i = 0; i < 12; ++i) {
      const int a = aggregate_of_[static_cast<std::size_t>(i)];
      for (int r = 0; r < space_->block_size(i); ++r) {
        for (int k = 0; k < space_->shape().widths[static_cast<std::size_t>(a)]; ++k) {
          V(system_.pattern.offsets[static_cast<std::size_t>(i)] + r, first[a] + k) =
              space_->V(i)[r * space_->stride(a) + k];
        }
      }
    }
    return V;
  }

  // M⁻¹ column by column, as a solve applies it.
  Matrix Apply(ClusterCholesky* fine) {
    const auto n = A_.rows();
    Matrix inverse(n, n);
    AlignedVector<double> r(static_cast<std::size_t>(padded_.back())), y(r.size()), z(r.size());
    for (int column = 0; column < n; ++column) {
      std::fill(r.begin(), r.end(), 0.0);
      r[Padded(column)] = 1.0;
      space_->Deflate(r.data(), y.data());
      fine->Apply(y.data(), z.data());
      space_->AddCoarse(z.data());
      for (int row = 0; row < n; ++row) {
        inverse(row, column) = z[Padded(row)];
      }
    }
    return inverse;
  }

  std::size_t Padded(int scalar) const {
    const std::vector<int>& offsets = system_.pattern.offsets;
    std::size_t i = 0;
    while (offsets[i + 1] <= scalar) {
      ++i;
    }
    return static_cast<std::size_t>(padded_[i] + scalar - offsets[i]);
  }

  Executor executor_{GetParam()};
  RandomSystem system_;
  std::vector<int> aggregate_of_;
  Matrix A_;
  std::unique_ptr<CoarseSpace> space_;
  std::vector<int> padded_{0};
};

TEST_P(CoarseSpaceTest, IsItsFormulaSymmetricAndPositiveDefinite) {
  for (const bool dependent : {false, true}) {
    Fill(dependent);
    ASSERT_TRUE(space_->Factorize().ok());
    Status status;
    ClusterCholesky fine(system_.pattern, {aggregate_of_, {}}, executor_, &status);
    ASSERT_TRUE(status.ok()) << status.message;
    ASSERT_TRUE(fine.Factorize(system_.values.data(), system_.diagonal.data()).ok());
    const Matrix inverse = Apply(&fine);

    Matrix D = A_;
    for (int i = 0; i < 12; ++i) {
      for (int j = 0; j < 12; ++j) {
        if (aggregate_of_[static_cast<std::size_t>(i)] !=
            aggregate_of_[static_cast<std::size_t>(j)]) {
          const std::vector<int>& at = system_.pattern.offsets;
          D.block(at[static_cast<std::size_t>(i)], at[static_cast<std::size_t>(j)],
                  space_->block_size(i), space_->block_size(j))
              .setZero();
        }
      }
    }
    Matrix V = this->V();
    if (dependent) {
      EXPECT_EQ(V.col(3).norm(), 0.0);
      V.col(3) = V.col(15);
      V.conservativeResize(V.rows(), 15);
    }
    const Matrix Q = V * (V.transpose() * A_ * V).llt().solve(V.transpose());
    const Matrix I = Matrix::Identity(A_.rows(), A_.cols());
    const Matrix expected = (I - Q * A_) * D.llt().solve(I - A_ * Q) + Q;
    EXPECT_LT(test::RelativeError(inverse, expected), 1e-10);
    EXPECT_LT((inverse - inverse.transpose()).norm(), 1e-10 * inverse.norm());
    EXPECT_GT(Eigen::SelfAdjointEigenSolver<Matrix>(inverse).eigenvalues()(0), 0.0);
  }
}

// A column that is no number is left out like one that others hold: all others are as without it.
TEST_P(CoarseSpaceTest, AColumnThatIsNotFiniteIsSetToZero) {
  Fill(/*dependent=*/true);
  const Matrix expected = V();
  for (const double spoil : {std::numeric_limits<double>::quiet_NaN(), HUGE_VAL, 1e200}) {
    Fill(/*dependent=*/true, spoil);
    EXPECT_EQ(V(), expected) << spoil;
  }
}

TEST_P(CoarseSpaceTest, SolvesWhatItsColumnsHold) {
  ASSERT_TRUE(space_->Factorize().ok());
  Status status;
  ClusterCholesky fine(system_.pattern, {aggregate_of_, {}}, executor_, &status);
  ASSERT_TRUE(fine.Factorize(system_.values.data(), system_.diagonal.data()).ok());
  const Matrix V = this->V();
  EXPECT_LT(test::RelativeError(Apply(&fine) * A_ * V, V), 1e-9);
}

TEST_P(CoarseSpaceTest, RefusesAFinePartThatIsNotPositiveDefinite) {
  Status status;
  ClusterCholesky fine(system_.pattern, {aggregate_of_, {}}, executor_, &status);
  std::vector<double> diagonal = system_.diagonal;
  diagonal[static_cast<std::size_t>(system_.pattern.offsets[4])] = -1e9;
  const Status refused = fine.Factorize(system_.values.data(), diagonal.data());
  EXPECT_EQ(refused.code, StatusCode::kSingular);
  EXPECT_NE(refused.message.find("frame 4"), std::string::npos) << refused.message;
}

INSTANTIATE_TEST_SUITE_P(Threads, CoarseSpaceTest, ::testing::Values(1, 2));

}  // namespace
}  // namespace inceres::internal
