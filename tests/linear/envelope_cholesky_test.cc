// The Cholesky factor that resumes: right against a dense oracle, and the same to the last bit as
// one from scratch.

#include "linear/envelope_cholesky.h"

#include <random>
#include <vector>

#include <Eigen/Cholesky>
#include <Eigen/Core>
#include <gtest/gtest.h>

#include "linear/growing_system.h"

namespace inceres::internal {
namespace {

// A symmetric positive definite matrix of mixed block sizes: a band of couplings to recent rows and
// a few to far ones.
class GrowingEnvelope {
 public:
  explicit GrowingEnvelope(unsigned seed) : engine_(seed) {}

  void AddRow(int size, int band, bool loop) {
    const int row = S_.AddRow(size);
    for (int column = std::max(0, row - band); column < row; ++column) {
      Couple(row, column);
    }
    if (loop && row > band) {
      Couple(row, static_cast<int>(engine_() % static_cast<unsigned>(row)));
    }
    Perturb(row);
  }

  // Changes the diagonal block of a row, keeping it dominant.
  void Perturb(int row) {
    double* block = S_.values(S_.FindOrAdd(row, row));
    const int stride = PadToQuad(S_.size_of(row));
    for (int r = 0; r < S_.size_of(row); ++r) {
      for (int c = 0; c < S_.size_of(row); ++c) {
        block[r * stride + c] = r == c ? 50.0 + Uniform() : 0.3;
      }
    }
  }

  const SymmetricBlockRows& S() const { return S_; }
  SymmetricBlockRows& S() { return S_; }

  int size() const {
    int sum = 0;
    for (int i = 0; i < S_.num_rows(); ++i) {
      sum += S_.size_of(i);
    }
    return sum;
  }

  Eigen::MatrixXd Dense() const {
    std::vector<int> offsets{0};
    for (int i = 0; i < S_.num_rows(); ++i) {
      offsets.push_back(offsets.back() + S_.size_of(i));
    }
    Eigen::MatrixXd dense = Eigen::MatrixXd::Zero(size(), size());
    for (int i = 0; i < S_.num_rows(); ++i) {
      for (const auto& entry : S_.row(i)) {
        const int stride = PadToQuad(S_.size_of(entry.column));
        for (int r = 0; r < S_.size_of(i); ++r) {
          for (int c = 0; c < S_.size_of(entry.column); ++c) {
            const double value = S_.values(entry.offset)[r * stride + c];
            dense(offsets[i] + r, offsets[entry.column] + c) = value;
            dense(offsets[entry.column] + c, offsets[i] + r) = value;
          }
        }
      }
    }
    return dense;
  }

  Eigen::VectorXd RandomVector() {
    Eigen::VectorXd v(size());
    for (double& entry : v) {
      entry = Uniform();
    }
    return v;
  }

 private:
  double Uniform() { return std::uniform_real_distribution<double>(-1.0, 1.0)(engine_); }

  void Couple(int row, int column) {
    double* block = S_.values(S_.FindOrAdd(row, column));
    for (int r = 0; r < S_.size_of(row); ++r) {
      for (int c = 0; c < S_.size_of(column); ++c) {
        block[r * PadToQuad(S_.size_of(column)) + c] = 0.2 * Uniform();
      }
    }
  }

  std::mt19937 engine_;
  SymmetricBlockRows S_;
};

void ExpectSolves(const EnvelopeCholesky& cholesky, GrowingEnvelope& system,
                  const Eigen::VectorXd& damping) {
  const Eigen::VectorXd b = system.RandomVector();
  Eigen::VectorXd x(b.size());
  cholesky.Solve(b.data(), x.data());
  Eigen::MatrixXd damped = system.Dense();
  damped.diagonal() += damping;
  const Eigen::VectorXd expected = damped.llt().solve(b);
  EXPECT_LE((x - expected).norm(), 1e-12 * expected.norm());
}

TEST(EnvelopeCholesky, SolvesLikeTheDenseOracle) {
  for (const int num_rows : {1, 2, 7, 40}) {
    GrowingEnvelope system(static_cast<unsigned>(num_rows));
    for (int i = 0; i < num_rows; ++i) {
      system.AddRow(1 + i * 5 % 9, 3, i % 6 == 5);
    }
    const Eigen::VectorXd damping = Eigen::VectorXd::Constant(system.size(), 0.25);
    EnvelopeCholesky cholesky;
    ASSERT_TRUE(cholesky.Factorize(system.S(), ArrivalOrder(system.S()), damping.data(), 0));
    ExpectSolves(cholesky, system, damping);
  }
}

TEST(EnvelopeCholesky, ResumedIsBitwiseTheSameAsFromScratch) {
  GrowingEnvelope system(7);
  EnvelopeCholesky resumed;
  std::mt19937 engine(3);
  for (int step = 0; step < 60; ++step) {
    system.AddRow(step % 4 == 0 ? 9 : 6, 5, step % 9 == 8);
    const int changed = static_cast<int>(engine() % static_cast<unsigned>(system.S().num_rows()));
    system.Perturb(changed);
    const Eigen::VectorXd damping = Eigen::VectorXd::Constant(system.size(), 1e-3);
    ASSERT_TRUE(resumed.Factorize(system.S(), ArrivalOrder(system.S()), damping.data(), changed));
    EnvelopeCholesky scratch;
    ASSERT_TRUE(scratch.Factorize(system.S(), ArrivalOrder(system.S()), damping.data(), 0));
    const Eigen::VectorXd b = system.RandomVector();
    Eigen::VectorXd x(b.size());
    Eigen::VectorXd y(b.size());
    resumed.Solve(b.data(), x.data());
    scratch.Solve(b.data(), y.data());
    ASSERT_EQ(x, y) << "after step " << step;
    ExpectSolves(resumed, system, damping);
  }
}

TEST(EnvelopeCholesky, ALoopLengthensOnlyItsOwnRow) {
  GrowingEnvelope chain(1);
  GrowingEnvelope loop(1);
  for (int i = 0; i < 100; ++i) {
    chain.AddRow(6, 2, false);
    loop.AddRow(6, 2, false);
  }
  EnvelopeCholesky chain_factor;
  EnvelopeCholesky loop_factor;
  const std::vector<double> damping(600, 0.0);
  ASSERT_TRUE(chain_factor.Factorize(chain.S(), ArrivalOrder(chain.S()), damping.data(), 0));
  double* block = loop.S().values(loop.S().FindOrAdd(60, 0));
  block[0] = 0.1;
  ASSERT_TRUE(loop_factor.Factorize(loop.S(), ArrivalOrder(loop.S()), damping.data(), 0));
  for (int i = 0; i < 100; ++i) {
    EXPECT_EQ(loop_factor.FirstColumn(i), i == 60 ? 0 : chain_factor.FirstColumn(i));
  }
}

TEST(EnvelopeCholesky, NamesTheSingularRowAndRecovers) {
  GrowingEnvelope system(5);
  for (int i = 0; i < 12; ++i) {
    system.AddRow(3, 2, false);
  }
  const std::vector<double> damping(36, 0.0);
  EnvelopeCholesky cholesky;
  double& pivot = system.S().values(system.S().FindOrAdd(8, 8))[0];
  const double good = pivot;
  pivot = -1.0;
  EXPECT_FALSE(cholesky.Factorize(system.S(), ArrivalOrder(system.S()), damping.data(), 0));
  EXPECT_EQ(cholesky.num_valid_rows(), 8);
  pivot = good;
  ASSERT_TRUE(cholesky.Factorize(system.S(), ArrivalOrder(system.S()), damping.data(), 8));
  ExpectSolves(cholesky, system, Eigen::VectorXd::Zero(36));
}

TEST(EnvelopeCholesky, SkipsRemovedRows) {
  GrowingEnvelope system(9);
  for (int i = 0; i < 15; ++i) {
    system.AddRow(1 + i % 7, 4, false);
  }
  system.S().RemoveRow(6);
  const Eigen::VectorXd damping = Eigen::VectorXd::Zero(system.size());
  EnvelopeCholesky cholesky;
  ASSERT_TRUE(cholesky.Factorize(system.S(), ArrivalOrder(system.S()), damping.data(), 0));
  ExpectSolves(cholesky, system, damping);
}

}  // namespace
}  // namespace inceres::internal
