#include "vins/vins_estimator.h"

#include <algorithm>
#include <cmath>

#include <ceres/ceres.h>

#include "common/imu_residual.h"
#include "vins/imu_factor.h"
#include "vins/pose_parameterization.h"
#include "vins/projection_factor.h"
#include "vins/realistic_factors.h"

namespace sliding_window {

using Eigen::Vector3d;

namespace {

// In the first second or two no motion tells the calibration from all else.
constexpr int kNumSolvesBeforeExtrinsics = 20;

}  // namespace

VinsEstimator::VinsEstimator(const EstimatorOptions& options, int max_features, SolveFunction solve,
                             const ImuState& start, const Pose& body_from_camera)
    : options_(options),
      solve_(std::move(solve)),
      body_from_camera_(body_from_camera),
      newest_state_(start),
      para_inverse_depth_(max_features) {
}

void VinsEstimator::AddFrame(const Frame& frame) {
  const int k = num_frames_++;
  if (k == 0) {
    states_[k] = newest_state_;
  } else {
    const ImuState& before = states_[k - 1];
    imu_[k] =
        std::make_shared<ImuPreintegration>(options_.imu_noise, frame.imu, before.ba, before.bg);
    states_[k] = Propagate(*imu_[k], before);
  }
  features_.Add(k, frame.observations);
  newest_state_ = states_[k];
  if (k == kNewest) {
    Optimize();
    --num_frames_;
  }
}

void VinsEstimator::Optimize() {
  std::vector<Pose> cameras;
  cameras.reserve(kNumFrames);
  for (int k = 0; k < kNumFrames; ++k) {
    cameras.push_back(CameraPose(k));
  }
  features_.TriangulateNew(cameras);
  used_features_ = features_.Usable();
  used_features_.resize(std::min(used_features_.size(), para_inverse_depth_.size()));

  // The problem owns cost functions, loss and parameterizations. Blocks are registered before they
  // have their values.
  ceres::Problem problem;
  auto* loss = new ceres::CauchyLoss(1.0);
  AddBlocks(&problem);
  StatesToParameters();
  AddResiduals(&problem, loss);
  ceres::Solver::Summary summary;
  solve_(SolverOptions(), &problem, &summary);
  ParametersToStates();
  newest_state_ = states_[kNewest];

  if (features_.SecondNewestIsKeyframe()) {
    MarginalizeOldest(*loss);
    SlideOldest();
  } else {
    MarginalizeSecondNewest();
    SlideSecondNewest();
  }
}

void VinsEstimator::AddBlocks(ceres::Problem* problem) {
  for (int k = 0; k < kNumFrames; ++k) {
    problem->AddParameterBlock(para_pose_[k], 7, new PoseParameterization);
    problem->AddParameterBlock(para_speed_bias_[k], 9);
  }
  problem->AddParameterBlock(para_extrinsic_, 7, new PoseParameterization);
  if (!options_.free_extrinsics || ++num_solves_ <= kNumSolvesBeforeExtrinsics) {
    problem->SetParameterBlockConstant(para_extrinsic_);
  }
}

void VinsEstimator::AddResiduals(ceres::Problem* problem, ceres::LossFunction* loss) {
  if (prior_ != nullptr) {
    problem->AddResidualBlock(new MarginalizationFactor(prior_.get()), nullptr, prior_blocks_);
  }
  for (int k = 1; k < kNumFrames; ++k) {
    problem->AddResidualBlock(MakeImuFactor(k), nullptr, para_pose_[k - 1], para_speed_bias_[k - 1],
                              para_pose_[k], para_speed_bias_[k]);
  }
  for (std::size_t i = 0; i < used_features_.size(); ++i) {
    const FeatureTrack& track = *used_features_[i];
    for (int k = track.start + 1; k <= track.last(); ++k) {
      problem->AddResidualBlock(MakeProjectionFactor(track.xy.front(), track.xy[k - track.start]),
                                loss, para_pose_[track.start], para_pose_[k], para_extrinsic_,
                                &para_inverse_depth_[i]);
    }
  }
}

ceres::CostFunction* VinsEstimator::MakeImuFactor(int frame) const {
  if (options_.realistic_costs) {
    return new RealisticImuFactor(imu_[frame]);
  }
  return new ImuFactor(imu_[frame]);
}

ceres::CostFunction* VinsEstimator::MakeProjectionFactor(const Eigen::Vector2d& xy_i,
                                                         const Eigen::Vector2d& xy_j) const {
  if (options_.realistic_costs) {
    return new RealisticProjectionFactor(xy_i, xy_j, projection_weight());
  }
  return new ProjectionFactor(xy_i, xy_j, projection_weight());
}

ceres::Solver::Options VinsEstimator::SolverOptions() {
  ceres::Solver::Options solver = MakeSolverOptions(options_);
  if (options_.ordering == Ordering::kLandmarksFirst) {
    solver.linear_solver_ordering = std::make_shared<ceres::ParameterBlockOrdering>();
    for (std::size_t i = 0; i < used_features_.size(); ++i) {
      solver.linear_solver_ordering->AddElementToGroup(&para_inverse_depth_[i], 0);
    }
    for (int k = 0; k < kNumFrames; ++k) {
      solver.linear_solver_ordering->AddElementToGroup(para_pose_[k], 1);
      solver.linear_solver_ordering->AddElementToGroup(para_speed_bias_[k], 1);
    }
    solver.linear_solver_ordering->AddElementToGroup(para_extrinsic_, 1);
  }
  return solver;
}

void VinsEstimator::StatesToParameters() {
  for (int k = 0; k < kNumFrames; ++k) {
    StateToParameters(states_[k], para_pose_[k], para_speed_bias_[k]);
  }
  body_from_camera_.ToParameters(para_extrinsic_);
  for (std::size_t i = 0; i < used_features_.size(); ++i) {
    para_inverse_depth_[i] = used_features_[i]->inverse_depth;
  }
}

// Where the window is and which way it faces about the vertical no sensor tells: frame 0 keeps what
// it had.
void VinsEstimator::ParametersToStates() {
  const Pose before = states_[0].pose;
  const Pose after = Pose::FromParameters(para_pose_[0]);
  const Eigen::Quaterniond change = before.q * after.q.conjugate();
  const Eigen::Quaterniond yaw(
      Eigen::AngleAxisd(2.0 * std::atan2(change.z(), change.w()), Vector3d::UnitZ()));
  for (int k = 0; k < kNumFrames; ++k) {
    ImuState& state = states_[k];
    state = StateFromParameters(para_pose_[k], para_speed_bias_[k]);
    state.pose = {yaw * (state.pose.p - after.p) + before.p, (yaw * state.pose.q).normalized()};
    state.v = yaw * state.v;
  }
  body_from_camera_ = Pose::FromParameters(para_extrinsic_);
  for (std::size_t i = 0; i < used_features_.size(); ++i) {
    used_features_[i]->inverse_depth = para_inverse_depth_[i];
  }
}

std::vector<double> VinsEstimator::Values() const {
  std::vector<double> values(&para_pose_[0][0], &para_pose_[0][0] + 7 * kNumFrames);
  values.insert(values.end(), &para_speed_bias_[0][0], &para_speed_bias_[0][0] + 9 * kNumFrames);
  values.insert(values.end(), para_extrinsic_, para_extrinsic_ + 7);
  values.insert(values.end(), para_inverse_depth_.begin(),
                para_inverse_depth_.begin() + used_features_.size());
  return values;
}

void VinsEstimator::SetValues(const std::vector<double>& values) {
  auto from = values.begin();
  const auto take = [&from](int size, double* to) {
    std::copy(from, from + size, to);
    from += size;
  };
  take(7 * kNumFrames, &para_pose_[0][0]);
  take(9 * kNumFrames, &para_speed_bias_[0][0]);
  take(7, para_extrinsic_);
  take(static_cast<int>(used_features_.size()), para_inverse_depth_.data());
}

}  // namespace sliding_window
