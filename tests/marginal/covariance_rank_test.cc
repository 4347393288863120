// Whether landmarks leave a frame anything of what its factors say of it.
#include <Eigen/Dense>
#include <gtest/gtest.h>

#include "inceres/solver/covariance.h"
#include "marginal/linear_world.h"

namespace inceres::test {
namespace {

using Eigen::MatrixXd;
using Eigen::VectorXd;
using RowMajor = Eigen::Matrix<double, Eigen::Dynamic, Eigen::Dynamic, Eigen::RowMajor>;

constexpr int kPoint = 3;
// A landmark with so many rows as it has coordinates uses them up. With more it does where moving
// the frame is moving the landmark.
constexpr int kJustEnough = 3;
constexpr int kMore = 6;

struct OwnLandmarks {
  int frame_size;
  int num_landmarks;
  int num_rows;
  double third = 1.0;  // how much of its third column is not a combination of the others
};

// Rows of a landmark alone: well-conditioned but for the third column.
MatrixXd RowsOfLandmark(const OwnLandmarks& own, Random* random) {
  MatrixXd J = 0.2 * RandomMatrix(random, own.num_rows, kPoint);
  for (int r = 0; r < own.num_rows; ++r) {
    J(r, r % kPoint) += 1.0;
  }
  J.col(2) = own.third * J.col(2) + (1.0 - own.third) * (J.col(0) - J.col(1));
  return J;
}

// `stiff`: the weight of the rows.
VariableId AddFrameOf(const OwnLandmarks& own, double stiff, Random* random, LinearWorld* world) {
  const VariableId frame = world->AddVariable(VectorXd::Zero(own.frame_size));
  for (int l = 0; l < own.num_landmarks; ++l) {
    const VariableId landmark = world->AddVariable(VectorXd::Zero(kPoint), Role::kLandmark);
    MatrixXd J(own.num_rows, own.frame_size + kPoint);
    J.rightCols(kPoint) = RowsOfLandmark(own, random);
    MatrixXd moves = RandomMatrix(random, kPoint, own.frame_size);
    moves.row(2) /= own.third;
    J.leftCols(own.frame_size) = own.num_rows > kPoint
                                     ? MatrixXd(J.rightCols(kPoint) * moves)
                                     : RandomMatrix(random, own.num_rows, own.frame_size);
    world->AddFactor({frame, landmark}, stiff * J, VectorXd::Zero(own.num_rows));
  }
  return frame;
}

GraphCovariance By(CovarianceAlgorithm algorithm, double max_inflation = 1e12) {
  CovarianceOptions options;
  options.algorithm = algorithm;
  options.max_inflation = max_inflation;
  return GraphCovariance(options);
}

MatrixXd BlockOf(const GraphCovariance& covariance, VariableId id, int size) {
  RowMajor block(size, size);
  EXPECT_TRUE(covariance.Get(id, id, block.data()));
  return block;
}

testing::Message Describe(const OwnLandmarks& own, unsigned seed) {
  return testing::Message() << own.frame_size << " by " << own.num_landmarks << " of "
                            << own.num_rows << " rows, third " << own.third << ", seed " << seed;
}

// S is rounding, positive in half of the seeds. Held against itself it would be a determined
// variance.
TEST(CovarianceRank, FramesThatTheirLandmarksUseUpAreOpen) {
  for (const OwnLandmarks& own :
       {OwnLandmarks{1, 3, kJustEnough}, OwnLandmarks{1, 100, kJustEnough},
        OwnLandmarks{2, 10, kJustEnough}, OwnLandmarks{3, 30, kJustEnough},
        OwnLandmarks{1, 3, kMore}, OwnLandmarks{1, 100, kMore}, OwnLandmarks{2, 10, kMore}}) {
    for (unsigned seed = 0; seed < 60; ++seed) {
      SCOPED_TRACE(Describe(own, seed));
      Random random(seed);
      LinearWorld world;
      const VariableId frame = AddFrameOf(own, 1.0, &random, &world);
      AddFrameOf(own, 1.0, &random, &world);
      GraphCovariance normal = By(CovarianceAlgorithm::kSchur);
      EXPECT_EQ(normal.Compute(world.graph, {{frame, frame}}).code, StatusCode::kSingular);
      EXPECT_EQ(normal.deficiency().directions.size(), std::size_t{2} * own.frame_size)
          << normal.deficiency().ToString();
      EXPECT_EQ(By(CovarianceAlgorithm::kQr).Compute(world.graph, {{frame, frame}}).code,
                StatusCode::kSingular);
    }
  }
}

// The rounding that a landmark leaves is as much larger as the landmark is inflated.
TEST(CovarianceRank, FramesThatWeakLandmarksUseUpAreOpen) {
  for (const double third : {1e-1, 1e-2, 1e-3, 1e-4, 1e-5}) {
    for (const OwnLandmarks& own :
         {OwnLandmarks{1, 1, kJustEnough, third}, OwnLandmarks{1, 20, kJustEnough, third},
          OwnLandmarks{1, 1, kMore, third}, OwnLandmarks{2, 20, kMore, third}}) {
      for (unsigned seed = 0; seed < 60; ++seed) {
        SCOPED_TRACE(Describe(own, seed));
        Random random(seed);
        LinearWorld world;
        const VariableId frame = AddFrameOf(own, 1.0, &random, &world);
        const VariableId held = world.AddVariable(VectorXd::Zero(1));
        world.AddFactor({held}, MatrixXd::Identity(1, 1), VectorXd::Zero(1));
        for (const VariableId asked : {frame, held}) {
          for (const auto algorithm : {CovarianceAlgorithm::kSchur, CovarianceAlgorithm::kQr}) {
            EXPECT_EQ(By(algorithm).Compute(world.graph, {{asked, asked}}).code,
                      StatusCode::kSingular)
                << asked;
          }
        }
      }
    }
  }
}

// A focal length that all points share, each seen once, beside a camera that a prior holds. Whoever
// of the two is asked for.
TEST(CovarianceRank, AScalarThatAllLandmarksUseUpIsOpen) {
  for (unsigned seed = 0; seed < 100; ++seed) {
    SCOPED_TRACE(seed);
    Random random(seed);
    LinearWorld world;
    const VariableId camera = world.AddVariable(VectorXd::Zero(6));
    const VariableId scalar = world.AddVariable(VectorXd::Zero(1));
    world.AddFactor({camera}, RandomMatrix(&random, 8, 6), VectorXd::Zero(8));
    for (int l = 0; l < 50; ++l) {
      const VariableId point = world.AddVariable(VectorXd::Zero(kPoint), Role::kLandmark);
      world.AddFactor({camera, scalar, point}, RandomMatrix(&random, 3, 10), VectorXd::Zero(3));
    }
    for (const VariableId asked : {camera, scalar}) {
      GraphCovariance normal = By(CovarianceAlgorithm::kSchur);
      EXPECT_EQ(normal.Compute(world.graph, {{asked, asked}}).code, StatusCode::kSingular);
      ASSERT_EQ(normal.deficiency().directions.size(), 1u);
      EXPECT_EQ(normal.deficiency().directions[0].shares[0].first, scalar);
      EXPECT_EQ(By(CovarianceAlgorithm::kQr).Compute(world.graph, {{asked, asked}}).code,
                StatusCode::kSingular);
    }
  }
}

// Nothing of stiff rows is left for the frame, and a weak factor is all that holds it: as
// determined as that factor says, by rows to the last digits. S of normal equations is rounding of
// C, and they say so.
TEST(CovarianceRank, AWeakFactorBesideStiffLandmarksIsWhatDetermines) {
  for (const int num_rows : {kJustEnough, kMore}) {
    for (unsigned seed = 0; seed < 30; ++seed) {
      SCOPED_TRACE(testing::Message() << num_rows << " rows, seed " << seed);
      Random random(seed);
      LinearWorld world;
      const VariableId frame = AddFrameOf({2, 20, num_rows}, 1e7, &random, &world);
      const MatrixXd weak = RandomMatrix(&random, 4, 2);
      world.AddFactor({frame}, weak, VectorXd::Zero(4));
      GraphCovariance by_rows = By(CovarianceAlgorithm::kQr);
      const Status status = by_rows.Compute(world.graph, {{frame, frame}});
      ASSERT_TRUE(status.ok()) << status.message;
      const MatrixXd expected = (weak.transpose() * weak).inverse();
      EXPECT_LT((BlockOf(by_rows, frame, 2) - expected).norm(), 1e-9 * expected.norm());
      EXPECT_EQ(By(CovarianceAlgorithm::kSchur).Compute(world.graph, {{frame, frame}}).code,
                StatusCode::kSingular);
    }
  }
}

// Neither a stiff prior on one frame nor stiff measurements throughout make others doubtful.
TEST(CovarianceRank, StiffPriorsLeaveTheOthersDetermined) {
  for (const double prior : {1e-3, 1.0, 1e7}) {
    for (const double weight : {1.0, 1e7}) {
      SCOPED_TRACE(testing::Message() << "prior " << prior << ", weight " << weight);
      Random random(3);
      LinearWorld world;
      std::vector<VariableId> frames;
      for (int i = 0; i < 4; ++i) {
        frames.push_back(world.AddVariable(VectorXd::Zero(6)));
      }
      world.AddFactor({frames[0]}, weight * prior * MatrixXd::Identity(6, 6), VectorXd::Zero(6));
      for (int l = 0; l < 40; ++l) {
        const VariableId landmark = world.AddVariable(VectorXd::Zero(kPoint), Role::kLandmark);
        for (const VariableId frame : frames) {
          world.AddFactor({frame, landmark}, weight * RandomMatrix(&random, 2, 9),
                          VectorXd::Zero(2));
        }
      }
      GraphCovariance normal = By(CovarianceAlgorithm::kSchur, 1e8);
      Status status = normal.Compute(world.graph, {{frames[1], frames[1]}});
      ASSERT_TRUE(status.ok()) << status.message;
      GraphCovariance by_rows = By(CovarianceAlgorithm::kQr);
      status = by_rows.Compute(world.graph, {{frames[1], frames[1]}});
      ASSERT_TRUE(status.ok()) << status.message;
      const MatrixXd expected = BlockOf(by_rows, frames[1], 6);
      EXPECT_LT((BlockOf(normal, frames[1], 6) - expected).norm(), 1e-10 * expected.norm());
    }
  }
}

}  // namespace
}  // namespace inceres::test
