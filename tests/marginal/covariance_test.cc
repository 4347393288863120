#include "inceres/solver/covariance.h"

#include <algorithm>

#include <Eigen/Dense>
#include <gtest/gtest.h>

#include "inceres/solver/incremental_solver.h"
#include "incremental/incremental_bundle.h"
#include "marginal/linear_world.h"
#include "support/dense_oracle.h"
#include "support/random_graph.h"
#include "support/values_held.h"

namespace inceres::test {
namespace {

using Eigen::MatrixXd;
using RowMajor = Eigen::Matrix<double, Eigen::Dynamic, Eigen::Dynamic, Eigen::RowMajor>;

// Every block, computed in one order and read in both, against the dense inverse of the oracle's
// Hessian.
void ExpectInverse(const FactorGraph& graph, const std::vector<VariableId>& moving,
                   const GraphCovariance& covariance) {
  const DenseOracle oracle(graph, moving);
  const MatrixXd inverse = oracle.H.inverse();
  Eigen::Index row = 0;
  for (const VariableId a : moving) {
    Eigen::Index column = 0;
    for (const VariableId b : moving) {
      RowMajor block(graph.TangentSize(a), graph.TangentSize(b));
      block.setConstant(1e30);
      ASSERT_TRUE(covariance.Get(a, b, block.data()));
      const MatrixXd expected = inverse.block(row, column, block.rows(), block.cols());
      const double scale =
          std::sqrt(inverse.block(row, row, block.rows(), block.rows()).norm() *
                    inverse.block(column, column, block.cols(), block.cols()).norm());
      EXPECT_LT((block - expected).norm(), 1e-10 * scale) << a << ", " << b;
      column += block.cols();
    }
    row += graph.TangentSize(a);
  }
}

GraphCovariance::Pairs AllPairs(const std::vector<VariableId>& ids) {
  GraphCovariance::Pairs pairs;
  for (std::size_t i = 0; i < ids.size(); ++i) {
    for (std::size_t k = i; k < ids.size(); ++k) {
      pairs.emplace_back((i + k) % 2 == 0 ? ids[i] : ids[k], (i + k) % 2 == 0 ? ids[k] : ids[i]);
    }
  }
  return pairs;
}

// Of everything there is in a graph, something for each seed.
std::unique_ptr<RandomGraph> MakeMixedBundle(unsigned seed) {
  BundleOptions options;
  options.seed = seed;
  options.num_frames = 5;
  options.num_landmarks = 12;
  options.frame_sizes = {6, 3};
  options.landmark_sizes = {3, 1, 2};
  options.manifolds = seed % 2 == 0;
  options.losses = seed % 3 == 0;
  options.constants = seed > 3;
  options.hosted = seed == 5;
  return MakeBundle(options);
}

TEST(Covariance, IsTheInverseOfTheHessian) {
  for (unsigned seed = 1; seed <= 6; ++seed) {
    const std::unique_ptr<RandomGraph> bundle = MakeMixedBundle(seed);
    const std::vector<VariableId> moving = MovingVariables(bundle->graph());
    GraphCovariance covariance;
    const Status status = covariance.Compute(bundle->graph(), AllPairs(moving));
    ASSERT_TRUE(status.ok()) << status.message;
    SCOPED_TRACE(seed);
    ExpectInverse(bundle->graph(), moving, covariance);
  }
}

TEST(Covariance, OfLandmarksAloneAndFramesAlone) {
  RandomGraph landmarks(3);
  for (int l = 0; l < 3; ++l) {
    landmarks.Connect(4, {landmarks.AddLandmark(2)});
  }
  GraphCovariance covariance;
  ASSERT_TRUE(covariance.Compute(landmarks.graph(), AllPairs({0, 1, 2})).ok());
  ExpectInverse(landmarks.graph(), {0, 1, 2}, covariance);
  RandomGraph frames(4);
  frames.AddFrame(3);
  frames.AddFrame(2);
  frames.Connect(4, {0});
  frames.Connect(4, {0, 1});
  ASSERT_TRUE(covariance.Compute(frames.graph(), AllPairs({0, 1})).ok());
  ExpectInverse(frames.graph(), {0, 1}, covariance);
}

TEST(Covariance, BlocksOfConstantsAreZero) {
  RandomGraph random(5);
  const VariableId held = random.AddFrame(2);
  const VariableId free = random.AddFrame(3);
  random.graph().SetConstant(held, true);
  random.Connect(4, {held, free});
  GraphCovariance covariance;
  ASSERT_TRUE(covariance.Compute(random.graph(), {{held, free}, {free, free}}).ok());
  double block[6] = {1.0, 1.0, 1.0, 1.0, 1.0, 1.0};
  ASSERT_TRUE(covariance.Get(held, free, block));
  EXPECT_EQ(*std::max_element(block, block + 6), 0.0);
  EXPECT_FALSE(covariance.Get(held, held, block));
}

// A chain without an anchor: rounding would give it a Cholesky factor, and numbers.
TEST(Covariance, AFreeGaugeIsAStatus) {
  for (int size = 1; size <= 40; size += 13) {
    LinearWorld world;
    Random random(static_cast<unsigned>(size));
    for (int i = 0; i <= size; ++i) {
      world.AddVariable(RandomMatrix(&random, 3, 1));
      if (i > 0) {
        MatrixXd A(3, 6);
        const MatrixXd weight = RandomMatrix(&random, 3, 3);
        A << -weight, weight;
        world.AddFactor({i - 1, i}, A, RandomMatrix(&random, 3, 1));
      }
    }
    GraphCovariance covariance;
    const Status status = covariance.Compute(world.graph, {{0, 0}});
    EXPECT_EQ(status.code, StatusCode::kSingular) << size;
    double block[9];
    EXPECT_FALSE(covariance.Get(0, 0, block));
    world.AddFactor({size / 2}, MatrixXd::Identity(3, 3), Eigen::VectorXd::Zero(3));
    const Status anchored = covariance.Compute(world.graph, AllPairs(MovingVariables(world.graph)));
    ASSERT_TRUE(anchored.ok()) << anchored.message;
    ExpectInverse(world.graph, MovingVariables(world.graph), covariance);
  }
}

// Constants have no rows in the system, whose rows are not the ids.
TEST(Covariance, WhereTheSystemHasNoFactorIsToldByTheVariable) {
  LinearWorld world;
  Random random(4);
  for (int i = 0; i < 6; ++i) {
    world.AddVariable(RandomMatrix(&random, 2, 1));
    world.graph.SetConstant(i, i < 3);
  }
  for (const int i : {3, 4}) {
    world.AddFactor({i}, MatrixXd::Identity(2, 2), Eigen::VectorXd::Zero(2));
  }
  MatrixXd A = MatrixXd::Zero(1, 2);
  A(0, 0) = 1.0;
  world.AddFactor({5}, A, Eigen::VectorXd::Zero(1));
  for (const auto algorithm : {CovarianceAlgorithm::kSchur, CovarianceAlgorithm::kQr}) {
    CovarianceOptions options;
    options.algorithm = algorithm;
    GraphCovariance covariance(options);
    const Status status = covariance.Compute(world.graph, {{4, 4}});
    EXPECT_EQ(status.code, StatusCode::kSingular);
    EXPECT_NE(status.message.find("not positive definite at variable 5"), std::string::npos)
        << status.message;
  }
}

// Frames along a path, each seen by the next few, and landmarks that three of them see: the factor
// has few of all pairs, and landmarks far apart share none.
struct Path {
  explicit Path(int num_frames, unsigned seed) : random(seed) {
    for (int i = 0; i < num_frames; ++i) {
      frames.push_back(random.AddFrame(i % 4 == 3 ? 3 : 6));
      random.Connect(6, {frames.back()});
    }
    for (int i = 0; i + 2 < num_frames; ++i) {
      landmarks.push_back(random.AddLandmark(1 + i % 3));
      for (int k = 0; k < 3; ++k) {
        random.Connect(4, {frames[static_cast<std::size_t>(i + k)], landmarks.back()});
      }
    }
  }
  RandomGraph random;
  std::vector<VariableId> frames, landmarks;
};

TEST(Covariance, OfAllOnAPathComesFromTheFactor) {
  Path path(30, 11);
  const std::vector<VariableId> moving = MovingVariables(path.random.graph());
  GraphCovariance covariance;
  // All pairs: what the factor does not have is solved for.
  const Status status = covariance.Compute(path.random.graph(), AllPairs(moving));
  ASSERT_TRUE(status.ok()) << status.message;
  ExpectInverse(path.random.graph(), moving, covariance);
  // The variances alone.
  GraphCovariance::Pairs own;
  for (const VariableId id : moving) {
    own.emplace_back(id, id);
  }
  GraphCovariance variances;
  ASSERT_TRUE(variances.Compute(path.random.graph(), own).ok());
  for (const VariableId id : moving) {
    double expected[36], found[36];
    const int size = path.random.graph().TangentSize(id);
    ASSERT_TRUE(covariance.Get(id, id, expected));
    ASSERT_TRUE(variances.Get(id, id, found));
    for (int k = 0; k < size * size; ++k) {
      EXPECT_NEAR(found[k], expected[k], 1e-12 * std::abs(expected[0])) << id;
    }
    EXPECT_FALSE(variances.Get(id, id == moving[0] ? moving[1] : moving[0], found));
  }
}

// Three coordinates of a chain without an anchor, and a fourth variable that only a sum determines.
TEST(Covariance, TellsWhatIsOpen) {
  LinearWorld world;
  Random random(3);
  for (int i = 0; i < 12; ++i) {
    world.AddVariable(RandomMatrix(&random, 3, 1));
    if (i > 0 && i != 8) {  // 0 to 7 are one chain, 8 to 11 another
      MatrixXd A(3, 6);
      A << -MatrixXd::Identity(3, 3), MatrixXd::Identity(3, 3);
      world.AddFactor({i - 1, i}, A, RandomMatrix(&random, 3, 1));
    }
  }
  world.AddFactor({0}, MatrixXd::Identity(3, 3), RandomMatrix(&random, 3, 1));
  GraphCovariance covariance;
  EXPECT_EQ(covariance.Compute(world.graph, {{0, 0}}).code, StatusCode::kSingular);
  const RankDeficiency& open = covariance.deficiency();
  ASSERT_EQ(open.directions.size(), 3u) << open.ToString();
  EXPECT_FALSE(open.has_more);
  for (const RankDeficiency::Direction& direction : open.directions) {
    ASSERT_EQ(direction.shares.size(), 4u) << open.ToString();
    for (const auto& [id, share] : direction.shares) {
      EXPECT_GE(id, 8);
      EXPECT_GT(share, 0.05);
    }
  }
  EXPECT_NE(open.ToString().find("3 directions are open: variable "), std::string::npos);
  world.AddFactor({9}, MatrixXd::Identity(3, 3), RandomMatrix(&random, 3, 1));
  ASSERT_TRUE(covariance.Compute(world.graph, {{0, 0}}).ok());
  EXPECT_TRUE(covariance.deficiency().directions.empty());
}

TEST(Covariance, ALandmarkSeenOnceIsAStatusThatNamesIt) {
  RandomGraph random(6);
  const VariableId frame = random.AddFrame(6);
  random.Connect(8, {frame});
  const VariableId landmark = random.AddLandmark(3);
  random.Connect(2, {frame, landmark});
  GraphCovariance covariance;
  const Status status = covariance.Compute(random.graph(), {{frame, frame}});
  EXPECT_EQ(status.code, StatusCode::kSingular);
  EXPECT_EQ(status.message,
            "variable 1 has no covariance: the landmark is not determined by its factors");
  EXPECT_EQ(covariance.deficiency().landmarks, std::vector<VariableId>{landmark});
  EXPECT_EQ(covariance.deficiency().ToString(),
            "1 landmarks are not determined by their factors, the first of them variable 1");
}

TEST(Covariance, BadIdsAndOptions) {
  RandomGraph random(7);
  random.AddFrame(2);
  random.AddFrame(2);
  random.Connect(3, {0});
  GraphCovariance covariance;
  EXPECT_EQ(covariance.Compute(random.graph(), {{0, 5}}).message, "variable 5 does not exist");
  EXPECT_EQ(covariance.Compute(random.graph(), {{0, 1}}).message,
            "variable 1 has no covariance: no factor touches it");
  CovarianceOptions options;
  options.num_threads = 0;
  EXPECT_EQ(GraphCovariance(options).Compute(random.graph(), {}).message,
            "CovarianceOptions::num_threads = 0 but must be >= 1");
  options.num_threads = 1;
  options.max_inflation = 1.0;
  EXPECT_EQ(GraphCovariance(options).Compute(random.graph(), {}).message,
            "CovarianceOptions::max_inflation = 1 but must be > 1");
  options.null_space_rank = -2;
  EXPECT_EQ(GraphCovariance(options).Compute(random.graph(), {}).message,
            "CovarianceOptions::null_space_rank = -2 but must be >= -1");
  options.null_space_rank = 0;
  options.min_column_remainder = 1.0;
  EXPECT_EQ(GraphCovariance(options).Compute(random.graph(), {}).message,
            "CovarianceOptions::min_column_remainder = 1 but must be in [0, 1)");
  options.min_column_remainder = 0.0;
  options.min_reciprocal_condition_number = 1.0;
  EXPECT_EQ(GraphCovariance(options).Compute(random.graph(), {}).message,
            "CovarianceOptions::min_reciprocal_condition_number = 1 but must be in [0, 1)");
}

// By singular values: the inverse where there is one, and the Moore–Penrose inverse without a
// gauge.
TEST(Covariance, ByDenseSingularValues) {
  BundleOptions bundle_options;
  bundle_options.num_frames = 4;
  bundle_options.num_landmarks = 10;
  const std::unique_ptr<RandomGraph> bundle = MakeBundle(bundle_options);
  CovarianceOptions options;
  options.algorithm = CovarianceAlgorithm::kDenseSvd;
  GraphCovariance covariance(options);
  const std::vector<VariableId> moving = MovingVariables(bundle->graph());
  ASSERT_TRUE(covariance.Compute(bundle->graph(), AllPairs(moving)).ok());
  ExpectInverse(bundle->graph(), moving, covariance);
  // Two differences of three numbers: (JᵀJ)⁺ of the second is that of its distance from the mean.
  LinearWorld world;
  for (int i = 0; i < 3; ++i) {
    world.AddVariable(Eigen::VectorXd::Zero(1));
    if (i > 0) {
      MatrixXd A(1, 2);
      A << -1.0, 1.0;
      world.AddFactor({i - 1, i}, A, Eigen::VectorXd::Zero(1));
    }
  }
  world.AddFactor({0, 1}, MatrixXd::Zero(1, 2), Eigen::VectorXd::Zero(1));
  const Status refused = covariance.Compute(world.graph, {{1, 1}});
  EXPECT_EQ(refused.code, StatusCode::kSingular);
  for (const int null_space_rank : {1, -1}) {
    options.null_space_rank = null_space_rank;
    GraphCovariance pseudo(options);
    ASSERT_TRUE(pseudo.Compute(world.graph, {{1, 1}, {0, 2}}).ok());
    const MatrixXd H = DenseOracle(world.graph, {0, 1, 2}).H;
    const MatrixXd expected = H.completeOrthogonalDecomposition().pseudoInverse();
    double variance = 0.0, across = 0.0;
    ASSERT_TRUE(pseudo.Get(1, 1, &variance));
    ASSERT_TRUE(pseudo.Get(0, 2, &across));
    EXPECT_NEAR(variance, expected(1, 1), 1e-12);
    EXPECT_NEAR(across, expected(0, 2), 1e-12);
  }
}

// The same blocks from the Jacobian, which is never squared: of everything there is in a graph.
TEST(Covariance, ByOrthogonalTransformations) {
  CovarianceOptions by_rows;
  by_rows.algorithm = CovarianceAlgorithm::kQr;
  for (unsigned seed = 1; seed <= 6; ++seed) {
    const std::unique_ptr<RandomGraph> bundle = MakeMixedBundle(seed);
    const std::vector<VariableId> moving = MovingVariables(bundle->graph());
    GraphCovariance covariance(by_rows);
    const Status status = covariance.Compute(bundle->graph(), AllPairs(moving));
    ASSERT_TRUE(status.ok()) << status.message;
    SCOPED_TRACE(seed);
    ExpectInverse(bundle->graph(), moving, covariance);
  }
  Path path(30, 11);
  const std::vector<VariableId> moving = MovingVariables(path.random.graph());
  GraphCovariance covariance(by_rows);
  const Status status = covariance.Compute(path.random.graph(), AllPairs(moving));
  ASSERT_TRUE(status.ok()) << status.message;
  ExpectInverse(path.random.graph(), moving, covariance);
}

// A chain of which second differences are measured, held at its beginning, with landmarks: what
// bends it at the beginning moves its end by its length squared. Against singular values.
struct OpenPath {
  explicit OpenPath(int length) {
    Random random(5);
    for (int i = 0; i < length; ++i) {
      frames.push_back(world.AddVariable(RandomMatrix(&random, 2, 1)));
      if (i < 2) {
        world.AddFactor({frames.back()}, MatrixXd::Identity(2, 2), Eigen::VectorXd::Zero(2));
        continue;
      }
      MatrixXd A(2, 6);
      A << MatrixXd::Identity(2, 2), -2.0 * MatrixXd::Identity(2, 2), MatrixXd::Identity(2, 2);
      world.AddFactor({frames[frames.size() - 3], frames[frames.size() - 2], frames.back()},
                      3e4 * A, Eigen::VectorXd::Zero(2));
      landmarks.push_back(world.AddVariable(RandomMatrix(&random, 2, 1), Role::kLandmark));
      for (const VariableId frame : {frames[frames.size() - 2], frames.back()}) {
        MatrixXd B(2, 4);
        B << RandomMatrix(&random, 2, 2), MatrixXd::Identity(2, 2);
        world.AddFactor({frame, landmarks.back()}, B, Eigen::VectorXd::Zero(2));
      }
    }
  }
  LinearWorld world;
  std::vector<VariableId> frames, landmarks;
};

// The largest difference of blocks, in units of √(Σ_ii Σ_jj).
double LargestDifference(const FactorGraph& graph, const std::vector<VariableId>& ids,
                         const GraphCovariance& a, const GraphCovariance& b) {
  double largest = 0.0;
  for (const auto& [i, j] : AllPairs(ids)) {
    const int rows = graph.TangentSize(i), columns = graph.TangentSize(j);
    RowMajor of_a(rows, columns), of_b(rows, columns), of_i(rows, rows), of_j(columns, columns);
    EXPECT_TRUE(a.Get(i, j, of_a.data()) && b.Get(i, j, of_b.data()));
    EXPECT_TRUE(b.Get(i, i, of_i.data()) && b.Get(j, j, of_j.data()));
    largest = std::max(largest, ((of_a - of_b).array() /
                                 (of_i.diagonal() * of_j.diagonal().transpose()).array().sqrt())
                                    .abs()
                                    .maxCoeff());
  }
  return largest;
}

TEST(Covariance, OfAnOpenPathHasItsDigitsByRows) {
  const OpenPath path(100);
  const FactorGraph& graph = path.world.graph;
  const std::vector<VariableId> moving = MovingVariables(graph);
  CovarianceOptions options;
  options.algorithm = CovarianceAlgorithm::kDenseSvd;
  options.min_reciprocal_condition_number = 0.0;
  GraphCovariance dense(options);
  ASSERT_TRUE(dense.Compute(graph, AllPairs(moving)).ok());
  options.algorithm = CovarianceAlgorithm::kSchur;
  options.max_inflation = 1e8;
  GraphCovariance doubtful(options);
  EXPECT_EQ(doubtful.Compute(graph, AllPairs(moving)).code, StatusCode::kSingular)
      << "it is as ill-conditioned as this test is about";
  options.max_inflation = 1e14;
  GraphCovariance normal(options);
  ASSERT_TRUE(normal.Compute(graph, AllPairs(moving)).ok());
  options.algorithm = CovarianceAlgorithm::kQr;
  GraphCovariance by_rows(options);
  const Status status = by_rows.Compute(graph, AllPairs(moving));
  ASSERT_TRUE(status.ok()) << status.message;
  const double difference = LargestDifference(graph, moving, by_rows, dense);
  EXPECT_LT(difference, 1e-9);
  EXPECT_GT(LargestDifference(graph, moving, normal, dense), 10.0 * difference);
}

// A stiff factor that hardly has the landmark's first column: eliminated in the order of the
// columns it would be mixed into weak ones, and 8 of their digits be rounded away.
TEST(Covariance, ByRowsWeakFactorsKeepTheirDigitsBesideAStiffOne) {
  MatrixXd rows(4, 3);    // of a frame, and of a landmark
  rows << 6e7, 0.7, 1e8,  //
      0.9, 0.8, 0.3,      //
      -0.4, 0.6, 0.5,     //
      0.2, -0.5, 0.7;
  LinearWorld world;
  const VariableId frame = world.AddVariable(Eigen::VectorXd::Zero(1));
  const VariableId landmark = world.AddVariable(Eigen::VectorXd::Zero(2), Role::kLandmark);
  world.AddFactor({frame, landmark}, rows, Eigen::VectorXd::Zero(4));
  CovarianceOptions options;
  options.algorithm = CovarianceAlgorithm::kQr;
  GraphCovariance covariance(options);
  const Status status = covariance.Compute(world.graph, AllPairs(MovingVariables(world.graph)));
  ASSERT_TRUE(status.ok()) << status.message;

  // In coordinates of which the stiff factor has one, in units of 1e-8, nothing is stiff.
  using Exact = Eigen::Matrix<long double, Eigen::Dynamic, Eigen::Dynamic>;
  Exact back = Exact::Identity(3, 3);
  back(2, 0) = -static_cast<long double>(rows(0, 0)) / static_cast<long double>(rows(0, 2));
  back(2, 1) = -static_cast<long double>(rows(0, 1)) / static_cast<long double>(rows(0, 2));
  back(2, 2) = 1e-8L;
  const Exact turned = rows.cast<long double>() * back;
  const Exact expected = back * (turned.transpose() * turned).inverse() * back.transpose();
  double of_frame = 0.0;
  RowMajor of_landmark(2, 2);
  ASSERT_TRUE(covariance.Get(frame, frame, &of_frame));
  ASSERT_TRUE(covariance.Get(landmark, landmark, of_landmark.data()));
  EXPECT_NEAR(of_frame / static_cast<double>(expected(0, 0)), 1.0, 1e-13);
  EXPECT_NEAR(of_landmark(0, 0) / static_cast<double>(expected(1, 1)), 1.0, 1e-13);
  EXPECT_NEAR(of_landmark(1, 1) / static_cast<double>(expected(2, 2)), 1.0, 1e-13);
}

TEST(Covariance, ByRowsTellsWhatIsNotDetermined) {
  CovarianceOptions options;
  options.algorithm = CovarianceAlgorithm::kQr;
  LinearWorld world;
  Random random(8);
  for (int i = 0; i < 10; ++i) {
    world.AddVariable(RandomMatrix(&random, 3, 1));
    if (i > 0) {
      MatrixXd A(3, 6);
      const MatrixXd weight = RandomMatrix(&random, 3, 3);
      A << -weight, weight;
      world.AddFactor({i - 1, i}, A, RandomMatrix(&random, 3, 1));
    }
  }
  GraphCovariance covariance(options);
  const Status open = covariance.Compute(world.graph, {{0, 0}});
  EXPECT_EQ(open.code, StatusCode::kSingular);
  EXPECT_NE(open.message.find("gauge"), std::string::npos) << open.message;
  double block[9];
  EXPECT_FALSE(covariance.Get(0, 0, block));
  world.AddFactor({4}, MatrixXd::Identity(3, 3), Eigen::VectorXd::Zero(3));
  ASSERT_TRUE(covariance.Compute(world.graph, AllPairs(MovingVariables(world.graph))).ok());
  ExpectInverse(world.graph, MovingVariables(world.graph), covariance);
  const VariableId landmark = world.AddVariable(Eigen::VectorXd::Zero(2), Role::kLandmark);
  world.AddFactor({0, landmark}, RandomMatrix(&random, 1, 5), Eigen::VectorXd::Zero(1));
  const Status seen_once = covariance.Compute(world.graph, {{0, 0}});
  EXPECT_EQ(seen_once.code, StatusCode::kSingular);
  EXPECT_EQ(covariance.deficiency().landmarks, std::vector<VariableId>{landmark});
}

// The rule of SuiteSparseQR goes by the units: a variable in large ones has short columns.
TEST(Covariance, ByRowsTheRemainderOfAColumnMayHaveToBeLarge) {
  for (const Role role : {Role::kFrame, Role::kLandmark}) {
    LinearWorld world;
    const VariableId near = world.AddVariable(Eigen::VectorXd::Zero(2));
    const VariableId small = world.AddVariable(Eigen::VectorXd::Zero(2), role);
    world.AddFactor({near}, MatrixXd::Identity(2, 2), Eigen::VectorXd::Zero(2));
    world.AddFactor({small}, 1e-6 * MatrixXd::Identity(2, 2), Eigen::VectorXd::Zero(2));
    CovarianceOptions options;
    options.algorithm = CovarianceAlgorithm::kQr;
    for (const double share : {0.0, 0.9e-6, 1.1e-6}) {
      options.min_column_remainder = share;
      GraphCovariance covariance(options);
      EXPECT_EQ(covariance.Compute(world.graph, {{small, small}}).ok(), share < 1e-6) << share;
    }
  }
}

// Of a living problem, with free places and a prior, at the values it holds.
TEST(Covariance, OfALivingProblem) {
  IncrementalOptions options;
  options.batch_share = 2.0;
  IncrementalBundle bundle(options, 3);
  bundle.Grow(5, 12, 3);
  bundle.solver.Update();
  MarginalizationRequest request;
  request.marginalized = {bundle.landmarks()[0], bundle.landmarks()[5]};
  request.dropped = {bundle.landmarks()[7]};
  ASSERT_TRUE(bundle.solver.Marginalize(request, MarginalizationOptions()).status.ok());
  FactorGraph copy = test::AtValuesHeld(bundle.solver);
  const std::vector<VariableId> moving = MovingVariables(copy);
  GraphCovariance covariance;
  const Status status = covariance.Compute(bundle.solver, AllPairs(moving));
  ASSERT_TRUE(status.ok()) << status.message;
  // The oracle's rows of a graph without gaps.
  const DenseOracle oracle(copy, moving);
  ExpectInverse(copy, moving, covariance);
}

// The graph of a solver lags behind the values it holds.
TEST(Covariance, OfALivingProblemThatWasStartedBeyondABound) {
  IncrementalSolver solver{IncrementalOptions()};
  const auto priors = solver.AddFamily(ScalarFamily([](double x) { return 2.0 * x; }, 2.0));
  GraphEdit edit(solver.graph());
  const double beyond = 5.0, least = 0.0, most = 1.0;
  const VariableId bounded = edit.AddVariable(&beyond, 1, Role::kFrame);
  const VariableId other = edit.AddVariable(&beyond, 1, Role::kFrame);
  edit.SetBounds(bounded, &least, &most);
  edit.AddFactor(priors, 0, {bounded});
  edit.AddFactor(priors, 1, {other});
  ASSERT_TRUE(solver.Apply(edit).ok());
  solver.Update();
  GraphEdit hold(solver.graph());
  hold.SetConstant(bounded, true);
  ASSERT_TRUE(solver.Apply(hold).ok());
  GraphCovariance covariance;
  const Status status = covariance.Compute(solver, {{other, other}});
  ASSERT_TRUE(status.ok()) << status.message;
  double variance = 0.0;
  ASSERT_TRUE(covariance.Get(other, other, &variance));
  EXPECT_NEAR(variance, 0.25, 1e-12);
}

TEST(Covariance, OfALossWithoutAWeightIsAStatus) {
  for (const auto algorithm :
       {CovarianceAlgorithm::kSchur, CovarianceAlgorithm::kQr, CovarianceAlgorithm::kDenseSvd}) {
    for (const double slope : {-1.0, static_cast<double>(NAN)}) {
      FactorGraph graph;
      const auto priors = graph.AddFamily(ScalarFamily([](double x) { return x; }, 1.0));
      const double one = 1.0;
      for (int i = 0; i < 2; ++i) {
        graph.AddFactor(priors, i, {graph.AddVariable(&one, 1, Role::kFrame)},
                        i == 0 ? LossOfSlope(slope) : nullptr);
      }
      CovarianceOptions options;
      options.algorithm = algorithm;
      options.null_space_rank = algorithm == CovarianceAlgorithm::kDenseSvd ? -1 : 0;
      EXPECT_FALSE(GraphCovariance(options).Compute(graph, {{0, 0}, {1, 1}}).ok());
    }
  }
}

TEST(Covariance, IsTheSameForAnyNumberOfThreads) {
  BundleOptions bundle_options;
  bundle_options.num_landmarks = 600;
  const std::unique_ptr<RandomGraph> bundle = MakeBundle(bundle_options);
  for (const auto algorithm : {CovarianceAlgorithm::kSchur, CovarianceAlgorithm::kQr}) {
    double blocks[2][36];
    for (const int num_threads : {1, 4}) {
      CovarianceOptions options;
      options.algorithm = algorithm;
      options.num_threads = num_threads;
      GraphCovariance covariance(options);
      const Status status = covariance.Compute(bundle->graph(), {{0, 1}});
      ASSERT_TRUE(status.ok()) << status.message;
      ASSERT_TRUE(covariance.Get(0, 1, blocks[num_threads / 4]));
    }
    EXPECT_TRUE(std::equal(blocks[0], blocks[0] + 36, blocks[1]));
  }
}

}  // namespace
}  // namespace inceres::test
