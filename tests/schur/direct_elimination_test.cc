// S without a plan against the dense H, landmarks eliminated by Eigen; the same of Jacobians in
// chunks, to the bit for any number of threads.
#include "schur/direct_elimination.h"

#include <cstdint>
#include <memory>
#include <vector>

#include <Eigen/Cholesky>
#include <gtest/gtest.h>

#include "support/dense_oracle.h"
#include "support/random_graph.h"

namespace inceres::internal {
namespace {

using test::BundleOptions;
using test::DenseOracle;
using test::MakeBundle;
using test::RandomGraph;
using test::RelativeError;

constexpr double kAnyInflation = 1e12;

// Of whose blocks on the diagonal the lower triangle counts.
Eigen::MatrixXd Dense(const BlockPattern& pattern, const double* values) {
  ReducedMatrix S(pattern, values, nullptr);
  Eigen::MatrixXd dense = Eigen::MatrixXd::Zero(pattern.size(), pattern.size());
  S.ForEachBlock([&](int i, int j, const double* block, int stride) {
    for (int r = 0; r < pattern.block_size(i); ++r) {
      for (int c = 0; c < pattern.block_size(j) && (i != j || c <= r); ++c) {
        dense(pattern.offsets[i] + r, pattern.offsets[j] + c) = block[r * stride + c];
      }
    }
  });
  return dense.selfadjointView<Eigen::Lower>();
}

struct Pipeline {
  explicit Pipeline(const FactorGraph& graph, JacobianStorage storage = JacobianStorage::kInChunks,
                    std::int64_t quads_per_chunk = DirectElimination::kQuadsPerChunk,
                    int num_threads = 1)
      : executor(num_threads),
        layout(graph, /*eliminate_landmarks=*/true),
        evaluator(graph, layout, executor, storage),
        incidences(evaluator, quads_per_chunk),
        elimination(&evaluator, incidences) {}

  Executor executor;
  Layout layout;
  Evaluator evaluator;
  LandmarkIncidences incidences;
  DirectElimination elimination;
};

Eigen::MatrixXd SOf(const FactorGraph& graph, JacobianStorage storage, std::int64_t quads_per_chunk,
                    int num_threads) {
  Pipeline core(graph, storage, quads_per_chunk, num_threads);
  std::vector<int> open;
  EXPECT_TRUE(core.elimination.Eliminate(kAnyInflation, &open).ok());
  EXPECT_TRUE(open.empty());
  return Dense(core.elimination.pattern(), core.elimination.S());
}

void ExpectDenseS(const FactorGraph& graph, std::int64_t quads_per_chunk) {
  const Layout layout(graph, /*eliminate_landmarks=*/true);
  const DenseOracle oracle(graph, layout.variables);
  const int n_c = layout.frame_size(), n_l = layout.size() - n_c;
  const Eigen::MatrixXd W = oracle.H.topRightCorner(n_c, n_l);
  Eigen::MatrixXd S = oracle.H.topLeftCorner(n_c, n_c);
  if (n_l > 0) {
    S -= W * oracle.H.bottomRightCorner(n_l, n_l).llt().solve(W.transpose());
  }
  for (const JacobianStorage storage : {JacobianStorage::kBySlot, JacobianStorage::kInChunks}) {
    const Eigen::MatrixXd of_one_thread = SOf(graph, storage, quads_per_chunk, 1);
    EXPECT_LT(RelativeError(of_one_thread, S), 1e-9);
    EXPECT_EQ(SOf(graph, storage, quads_per_chunk, 2), of_one_thread);
  }
}

TEST(DirectElimination, IsTheSchurComplement) {
  for (const std::int64_t quads_per_chunk : {DirectElimination::kQuadsPerChunk, 100L, 1L}) {
    BundleOptions options;
    options.num_views = 4;
    ExpectDenseS(MakeBundle(options)->graph(), quads_per_chunk);
    options.frame_sizes = {9};  // Y has a tail
    ExpectDenseS(MakeBundle(options)->graph(), quads_per_chunk);
    options.frame_sizes = {6, 3, 9, 1};
    options.landmark_sizes = {3, 1, 4, 2};
    options.residual_sizes = {2, 3, 1};
    options.hosted = options.by_frame = options.manifolds = options.losses = true;
    options.constants = true;
    options.num_views = 5;
    ExpectDenseS(MakeBundle(options)->graph(), quads_per_chunk);
    options.num_landmarks = 0;
    ExpectDenseS(MakeBundle(options)->graph(), quads_per_chunk);
  }
}

// Beside S: what it was before its landmarks were eliminated, the same of any chunks and threads.
TEST(DirectElimination, HasTheDiagonalOfC) {
  BundleOptions options;
  options.num_views = 4;
  options.frame_sizes = {6, 9};
  options.losses = true;
  const std::unique_ptr<RandomGraph> bundle = MakeBundle(options);
  const Layout layout(bundle->graph(), /*eliminate_landmarks=*/true);
  const DenseOracle oracle(bundle->graph(), layout.variables);
  const Eigen::VectorXd expected = oracle.H.diagonal().head(layout.frame_size());
  for (const JacobianStorage storage : {JacobianStorage::kBySlot, JacobianStorage::kInChunks}) {
    for (const int num_threads : {1, 2}) {
      Pipeline core(bundle->graph(), storage, 100, num_threads);
      std::vector<int> open;
      ASSERT_TRUE(core.elimination.Eliminate(kAnyInflation, &open).ok());
      const auto vector_of = [](const std::vector<double>& values) {
        return Eigen::Map<const Eigen::VectorXd>(values.data(),
                                                 static_cast<Eigen::Index>(values.size()));
      };
      const auto diagonal = vector_of(core.elimination.diagonal());
      const auto rounding = vector_of(core.elimination.rounding());
      ASSERT_EQ(diagonal.size(), expected.size());
      EXPECT_LT((diagonal - expected).cwiseQuotient(expected).cwiseAbs().maxCoeff(), 1e-12);
      // A landmark's variance is never below that with all else known.
      EXPECT_GE((rounding - diagonal).cwiseQuotient(expected).minCoeff(), -1e-12);
      EXPECT_TRUE(rounding.allFinite());
    }
  }
}

// Rows that reach far and have few blocks: these are not numbered by places.
TEST(DirectElimination, OfFramesThatAllMeetTheFirst) {
  BundleOptions options;
  options.num_frames = 40;
  options.num_landmarks = 60;
  const std::unique_ptr<RandomGraph> bundle = MakeBundle(options);
  for (VariableId frame = 2; frame < options.num_frames; ++frame) {
    bundle->Connect(6, {frame, 0});
    bundle->Connect(6, {0, frame});  // and once more
  }
  ExpectDenseS(bundle->graph(), DirectElimination::kQuadsPerChunk);
}

TEST(DirectElimination, NamesLandmarksThatAreNotDetermined) {
  RandomGraph random(7);
  const VariableId frame = random.AddFrame(6);
  random.Connect(6, {frame});
  std::vector<VariableId> landmarks;
  for (int l = 0; l < 4; ++l) {
    landmarks.push_back(random.AddLandmark(3));
    const int num_views = l % 2 == 0 ? 2 : 1;  // of one a direction is open
    for (int k = 0; k < num_views; ++k) {
      random.Connect(2, {frame, landmarks.back()});
    }
  }
  Pipeline core(random.graph());
  std::vector<int> open;
  ASSERT_TRUE(core.elimination.Eliminate(kAnyInflation, &open).ok());
  EXPECT_EQ(open, (std::vector<int>{1, 3}));
}

}  // namespace
}  // namespace inceres::internal
