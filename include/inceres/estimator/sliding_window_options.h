#pragma once

#include <array>
#include <memory>

#include "inceres/export.h"
#include "inceres/factors/imu_options.h"
#include "inceres/problem/losses.h"
#include "inceres/solver/incremental_options.h"
#include "inceres/solver/marginalization.h"
#include "inceres/status.h"

namespace inceres {

/// What becomes of the landmarks that the oldest frame sees when it leaves.
enum class WindowRule : unsigned char {
  /// They leave with it, and all that was seen of them is in the prior; a track that goes on begins a landmark of its own, from
  /// what is seen of it later. Source: VINS-Mono's MARGIN_OLD (which, unlike this, uses the views in the prior a second time).
  kMarginalizeLandmarks,
  /// One that the newest frame sees stays, anchored in its next view; the view from the oldest frame is lost, so that the prior
  /// stays sparse. The others leave as above. Source: OKVIS (Leutenegger et al. 2015, section 3.5).
  kKeepSeenLandmarks,
};

/// How a landmark is written down, in the camera of the frame that saw it first, its anchor.
enum class LandmarkForm : unsigned char {
  /// (m_x, m_y, λ): bearing and inverse depth, the first view being a measurement like the others.
  kBearing,
  /// λ alone, the first view being exact (VINS): cheaper; covariances come out too small.
  kInverseDepth,
};

/// Options of a SlidingWindowEstimator.
struct INCERES_EXPORT SlidingWindowOptions {
  int size = 10;  ///< frames that stay after each call, 3 .. 1000; a solve has one more
  WindowRule rule = WindowRule::kMarginalizeLandmarks;
  /// The frame before the newest is a keyframe if the newest one shows fewer than so many known tracks, or if it moved at least
  /// so far from the one before it, as the mean over common tracks in the plane z = 1. Otherwise it leaves, not the oldest one:
  /// its views are dropped, and the IMU's measurements before and after it become one. ≥ 0; 0 makes every frame a keyframe.
  /// Source: VINS-Mono (Qin, Li & Shen 2018, section V.A).
  int min_tracked = 20;
  double min_parallax = 10.0 / 460.0;
  /// Seconds that a measurement of the IMU may span before the frame stays whatever it sees; > 0. A body that stands still
  /// would otherwise gather samples for ever.
  double max_imu_seconds = 2.0;

  std::array<double, 7> body_from_camera{0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 1.0};  ///< [p(3), q(x, y, z, w)]; not estimated
  /// Standard deviation of an image point in the plane z = 1: pixels / focal length, in x and in y; > 0.
  std::array<double, 2> feature_sigma{1.0 / 460.0, 1.0 / 460.0};
  /// On the whitened two-vector of a view; null: none. The default leaves alone what is noise.
  std::shared_ptr<const Loss> loss = std::make_shared<HuberLoss>(3.0);
  LandmarkForm landmark_form = LandmarkForm::kBearing;
  /// A track becomes a landmark when two views of it differ by so much in the plane z = 1, turned into the same direction; > 0.
  double min_triangulation_parallax = 0.02;
  /// After a solve landmarks leave whose views err by more than so many standard deviations in the mean; > 0. So do those that
  /// ended behind the camera.
  double max_mean_error = 5.0;

  /// Noise, gravity and conventions of the IMU. The perturbation must be kRight.
  ImuOptions imu;
  /// max_num_iterations, max_seconds and max_factor_evaluations are the budget of a frame: in iterations, seconds or work.
  IncrementalOptions solver = FrameBudget();
  /// Threshold of the prior, and whether what it holds is linearized for ever where it was when the prior took it up:
  /// first-estimate Jacobians, which pay if first estimates are good (docs/visual_inertial.md). Without allow_rank_loss a
  /// landmark that has too little information is dropped.
  MarginalizationOptions marginalization;

  /// What is wrong with these options, the first culprit named.
  Status Validate() const;

  /// At most 10 iterations, to a tolerance far below what a frame's noise lets one see.
  static IncrementalOptions FrameBudget() {
    IncrementalOptions budget;
    budget.max_num_iterations = 10;
    budget.function_tolerance = 1e-5;
    return budget;
  }
};

}  // namespace inceres
