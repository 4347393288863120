// Read-outs of a window against the same computed densely from its graph.

#include <algorithm>
#include <array>
#include <vector>

#include <Eigen/Dense>
#include <gtest/gtest.h>

#include "estimator/window_sequence.h"
#include "inceres/solver/marginalization.h"
#include "support/dense_oracle.h"

namespace inceres::test {
namespace {

using RowMajor = Eigen::Matrix<double, Eigen::Dynamic, Eigen::Dynamic, Eigen::RowMajor>;

class ReadOuts : public testing::TestWithParam<LandmarkForm> {
 protected:
  ReadOuts() : sequence_(Simulate("", 25)), run_(sequence_, Options()) {
    run_.Play(25);
    const IncrementalSolver& solver = run_.estimator.solver();
    graph_ = std::make_unique<FactorGraph>(solver.graph());
    for (VariableId id = 0; id < graph_->num_variables(); ++id) {
      if (graph_->HasVariable(id)) {
        graph_->SetValues(id, solver.Values(id));
        if (!graph_->IsConstant(id)) {
          offsets_[id] = size_;
          size_ += graph_->TangentSize(id);
          free_.push_back(id);
        }
      }
    }
  }
  SlidingWindowOptions Options() const {
    SlidingWindowOptions options = WindowOptionsOf(sequence_);
    options.landmark_form = GetParam();
    options.size = 6;
    return options;
  }

  VioSequence sequence_;
  WindowRun run_;
  std::unique_ptr<FactorGraph> graph_;
  std::vector<VariableId> free_;
  std::map<VariableId, Eigen::Index> offsets_;
  Eigen::Index size_ = 0;
};

TEST_P(ReadOuts, CovarianceAndLandmarkHessianAreThoseOfTheDenseSystem) {
  const DenseOracle dense(*graph_, free_);
  const Eigen::MatrixXd inverse = dense.H.ldlt().solve(Eigen::MatrixXd::Identity(size_, size_));
  for (int i = 0; i < run_.estimator.num_frames(); ++i) {
    std::array<double, 225> covariance{};
    ASSERT_TRUE(run_.estimator.StateCovariance(i, &covariance).ok());
    const Eigen::Index pose = offsets_.at(run_.estimator.PoseId(i)),
                       speed_bias = offsets_.at(run_.estimator.SpeedBiasId(i));
    Eigen::MatrixXd expected(15, 15);
    expected << inverse.block(pose, pose, 6, 6), inverse.block(pose, speed_bias, 6, 9),
        inverse.block(speed_bias, pose, 9, 6), inverse.block(speed_bias, speed_bias, 9, 9);
    EXPECT_LT(RelativeError(Eigen::Map<const RowMajor>(covariance.data(), 15, 15), expected), 1e-6)
        << i;
  }
  int num_landmarks = 0;
  for (std::size_t track = 0; track < sequence_.points.size(); ++track) {
    const VariableId id = run_.estimator.LandmarkId(static_cast<std::int64_t>(track));
    if (id < 0) {
      continue;
    }
    ++num_landmarks;
    std::vector<double> hessian;
    ASSERT_TRUE(run_.estimator.LandmarkHessian(static_cast<std::int64_t>(track), &hessian).ok());
    const int size = graph_->TangentSize(id);
    ASSERT_EQ(hessian.size(), static_cast<std::size_t>(size * size));
    EXPECT_LT(RelativeError(Eigen::Map<const RowMajor>(hessian.data(), size, size),
                            dense.H.block(offsets_.at(id), offsets_.at(id), size, size)),
              1e-12);
    std::array<double, 3> point{};
    ASSERT_TRUE(run_.estimator.LandmarkPosition(static_cast<std::int64_t>(track), &point).ok());
    const auto& truth = sequence_.points[track].truth;
    EXPECT_LT(Eigen::Vector3d(point[0] - truth[0], point[1] - truth[1], point[2] - truth[2]).norm(),
              3.0);
  }
  EXPECT_EQ(num_landmarks, run_.summary.num_landmarks);
  EXPECT_GT(num_landmarks, 10);
}

TEST_P(ReadOuts, TheSpectrumIsThatOfThePriorInTheGraph) {
  const LinearPrior* prior = FindLinearPrior(*graph_, run_.summary.marginalization.prior);
  ASSERT_NE(prior, nullptr);
  const Eigen::Map<const RowMajor> J(prior->J.data(), static_cast<Eigen::Index>(prior->e0.size()),
                                     prior->num_columns());
  const Eigen::VectorXd squares =
      Eigen::JacobiSVD<Eigen::MatrixXd>(J).singularValues().array().square();
  const std::vector<double> spectrum = run_.estimator.PriorSpectrum();
  ASSERT_EQ(spectrum.size(), static_cast<std::size_t>(prior->num_columns()));
  EXPECT_TRUE(std::is_sorted(spectrum.begin(), spectrum.end()));
  for (std::size_t k = 0; k < spectrum.size(); ++k) {
    EXPECT_NEAR(spectrum[k], squares[squares.size() - 1 - static_cast<Eigen::Index>(k)],
                1e-12 * squares[0]);
  }
}

INSTANTIATE_TEST_SUITE_P(Forms, ReadOuts,
                         testing::Values(LandmarkForm::kBearing, LandmarkForm::kInverseDepth));

}  // namespace
}  // namespace inceres::test
