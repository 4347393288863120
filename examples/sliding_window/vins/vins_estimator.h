#pragma once

#include <array>
#include <memory>
#include <unordered_map>
#include <vector>

#include <ceres/problem.h>

#include "common/estimator_options.h"
#include "common/frame.h"
#include "vins/feature_tracks.h"
#include "vins/marginalization.h"

namespace sliding_window {

/// A visual-inertial estimator as VINS-Mono builds it. A window of eleven frames slides with every
/// image; for each, a new ceres::Problem is made over the same arrays, which stand for other frames
/// and other features every time:
///
///     variables  poses 7/6 (p, q), speed and biases 9 (v, ba, bg), the camera on the body 7/6
///                (held or free), one inverse depth per feature
///     factors    projections (Cauchy), IMU factors between consecutive frames, the prior of what
///                has left the window
///
/// Source: Qin, Li, Shen: VINS-Mono (T-RO 2018).
class VinsEstimator {
 public:
  static constexpr int kNewest = FeatureTracks::kNewest;
  static constexpr int kNumFrames = kNewest + 1;

  /// `start` is the state at the first frame, `body_from_camera` the extrinsic calibration to start
  /// with. At most `max_features` features have a variable at a time.
  VinsEstimator(const EstimatorOptions& options, int max_features, SolveFunction solve,
                const ImuState& start, const Pose& body_from_camera);
  VinsEstimator(const VinsEstimator&) = delete;
  VinsEstimator& operator=(const VinsEstimator&) = delete;

  /// The next image. Solves once the window is full, and makes room for the one that follows.
  void AddFrame(const Frame& frame);

  const ImuState& newest_state() const { return newest_state_; }

  /// All values the running solve is about, for a solve function that looks at them or changes
  /// them.
  std::vector<double> Values() const;
  void SetValues(const std::vector<double>& values);

 private:
  /// New ones, to whom they are given.
  ceres::CostFunction* MakeImuFactor(int frame) const;
  ceres::CostFunction* MakeProjectionFactor(const Eigen::Vector2d& xy_i,
                                            const Eigen::Vector2d& xy_j) const;

  void Optimize();
  void AddBlocks(ceres::Problem* problem);
  void AddResiduals(ceres::Problem* problem, ceres::LossFunction* loss);
  ceres::Solver::Options SolverOptions();
  void StatesToParameters();
  void ParametersToStates();

  void MarginalizeOldest(const ceres::LossFunction& loss);
  void MarginalizeSecondNewest();
  void SlideOldest();
  void SlideSecondNewest();

  Pose CameraPose(int frame) const { return states_[frame].pose * body_from_camera_; }
  double projection_weight() const { return options_.focal_length / options_.pixel_noise; }

  EstimatorOptions options_;
  SolveFunction solve_;

  int num_frames_ = 0;  // in the window
  int num_solves_ = 0;
  std::array<ImuState, kNumFrames> states_;
  // from the frame before to this one
  std::array<std::shared_ptr<ImuPreintegration>, kNumFrames> imu_;
  Pose body_from_camera_;
  FeatureTracks features_;
  std::vector<FeatureTrack*> used_features_;  // in the running solve; those of para_inverse_depth_
  ImuState newest_state_;

  double para_pose_[kNumFrames][7];
  double para_speed_bias_[kNumFrames][9];
  double para_extrinsic_[7];
  std::vector<double> para_inverse_depth_;  // never reallocated: Ceres holds addresses

  std::unique_ptr<MarginalizationInfo> prior_;
  std::vector<double*> prior_blocks_;
};

}  // namespace sliding_window
