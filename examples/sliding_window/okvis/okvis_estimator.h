#pragma once

#include <functional>
#include <map>
#include <memory>
#include <optional>
#include <utility>
#include <vector>

#include <ceres/ceres.h>

#include "common/estimator_options.h"
#include "common/frame.h"
#include "okvis/manifolds.h"
#include "okvis/marginalization_error.h"

namespace sliding_window {

struct OkvisOptions {
  int num_keyframes = 5;
  int num_imu_frames = 3;  // the newest frames; only these have speed and biases
  // before each solve, another of two iterations in which only the newest frame is free
  bool newest_first = false;
  // every so manieth frame is a keyframe; 0: one that shares too little with the last keyframe
  int keyframe_interval = 0;
  // What is known at the start: information of the first pose's position and yaw, standard
  // deviations of the rest.
  double first_pose_information = 1e8;
  double speed_sigma = 0.1;         // m/s
  double gyr_bias_sigma = 0.02;     // rad/s
  double acc_bias_sigma = 0.2;      // m/s^2
  double extrinsic_p_sigma = 0.02;  // m
  double extrinsic_r_sigma = 0.02;  // rad
};

/// A visual-inertial estimator as OKVIS builds it: one ceres::Problem lives as long as the
/// estimator, owns nothing, and follows the map by additions and removals:
///
///     poses             7/6 of keyframes and the newest frames
///     speed and biases  9 (v, bg, ba) of the newest frames
///     cameras           7/6 each on the body, held or free
///     landmarks         4/3, homogeneous
///     errors            reprojection (Cauchy), IMU, priors of great weight on the oldest frame,
///                       marginalization
///
/// Source: Leutenegger et al., Keyframe-based visual-inertial odometry (IJRR 2015).
class OkvisEstimator {
 public:
  OkvisEstimator(const EstimatorOptions& options, const OkvisOptions& okvis_options,
                 SolveFunction solve, const ImuState& start,
                 const std::vector<Pose>& body_from_cameras);
  OkvisEstimator(const OkvisEstimator&) = delete;
  OkvisEstimator& operator=(const OkvisEstimator&) = delete;

  /// The next image: adds what it brings, solves, removes what is old.
  void AddFrame(const Frame& frame);

  ImuState newest_state() const;

  /// All values of the problem, in an order that does not depend on addresses.
  std::vector<double> Values();
  void SetValues(const std::vector<double>& values);

 private:
  /// A residual block and what it is made of, which the problem does not own.
  struct Residual {
    std::unique_ptr<ceres::CostFunction> cost;
    ceres::ResidualBlockId id = nullptr;
  };
  struct FrameBlocks {
    double pose[7];
    double speed_bias[9];
    bool has_speed_bias = true;
    bool is_keyframe = false;
    Residual imu;               // to the frame before
    Residual speed_bias_prior;  // of the first frame
  };
  struct Sighting {
    Eigen::Vector2d xy;
    double depth;  // guessed, or 0
    Residual residual;
  };
  struct Extrinsic {
    double pose[7];
    Residual prior;
  };
  struct Landmark {
    double x[4];
    bool is_variable = false;
    std::map<std::pair<int, int>, Sighting> sightings;  // by frame and camera

    bool IsSeenIn(int frame) const {
      const auto first = sightings.lower_bound({frame, 0});
      return first != sightings.end() && first->first.first == frame;
    }
  };
  using LandmarkIterator = std::map<int, Landmark>::iterator;

  std::unique_ptr<ceres::CostFunction> MakeReprojectionError(const Eigen::Vector2d& xy) const;
  std::unique_ptr<ceres::CostFunction> MakeImuError(const std::vector<ImuSample>& samples,
                                                    const ImuState& state) const;
  void AddBlocks(int id, const Frame& frame);
  void AddObservations(int id, const std::vector<Observation>& observations);
  void AddLandmarkIfSeenWell(Landmark* landmark);
  std::optional<Eigen::Vector3d> FirstPosition(const Landmark& landmark) const;
  void AddSighting(Landmark* landmark, std::pair<int, int> frame_and_camera);
  bool IsKeyframe(int id, const std::vector<Observation>& observations) const;
  void SetPosePrior(int id, double information);
  void SetAllConstantBut(int newest, bool constant);
  void Solve(int max_num_iterations);
  /// visit(block, its size), in an order that does not depend on addresses.
  void ForEachBlock(const std::function<void(double*, int)>& visit);

  void Marginalize();
  void LeaveImuWindow(int id);
  void RemovePose(int id, bool marginalize_landmarks);
  void MarginalizeLandmark(Landmark* landmark);
  void RemoveLandmark(LandmarkIterator landmark);
  void PutBackMarginalizationError();

  Residual AddResidual(std::unique_ptr<ceres::CostFunction> cost, ceres::LossFunction* loss,
                       const std::vector<double*>& blocks);
  void RemoveResidual(Residual* residual);
  void LinearizeAndRemove(Residual* residual);

  EstimatorOptions options_;
  OkvisOptions okvis_options_;
  SolveFunction solve_;
  ImuState start_;

  PoseManifold pose_manifold_;
  HomogeneousPointManifold point_manifold_;
  ceres::CauchyLoss loss_{1.0};
  std::vector<Extrinsic> extrinsics_;  // never reallocated: Ceres holds addresses
  std::map<int, FrameBlocks> frames_;  // by their numbers, consecutive as they arrive
  std::map<int, Landmark> landmarks_;  // by their features' numbers
  Residual pose_prior_;                // of the oldest frame
  MarginalizationError marginalization_error_;
  ceres::ResidualBlockId marginalization_id_ = nullptr;
  int next_frame_ = 0;
  ceres::Problem problem_;  // goes first, for it refers to the rest
};

}  // namespace sliding_window
