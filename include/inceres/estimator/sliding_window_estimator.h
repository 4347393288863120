#pragma once

#include <array>
#include <cstdint>
#include <memory>
#include <vector>

#include "inceres/estimator/sliding_window_options.h"
#include "inceres/export.h"
#include "inceres/factors/imu_options.h"
#include "inceres/problem/factor_graph.h"
#include "inceres/solver/incremental_solver.h"
#include "inceres/status.h"

namespace inceres {

/// What is estimated of a frame.
struct WindowState {
  double time = 0.0;                                              ///< seconds
  std::array<double, 7> pose{0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 1.0};  ///< of the IMU in the world: [p(3), q(x, y, z, w)], meters
  std::array<double, 3> velocity{};                               ///< in the world, m/s
  std::array<double, 3> gyr_bias{};                               ///< rad/s
  std::array<double, 3> acc_bias{};                               ///< m/s²
};

/// The state at the first frame, and how well it is known: standard deviations, > 0.
struct WindowStart {
  WindowState state;
  std::array<double, 6> pose_sigma{1e-3, 1e-3, 1e-3, 1e-2, 1e-2, 1e-2};  ///< meters; radians about the body's axes
  std::array<double, 3> velocity_sigma{0.1, 0.1, 0.1};
  std::array<double, 3> gyr_bias_sigma{0.01, 0.01, 0.01};
  std::array<double, 3> acc_bias_sigma{0.1, 0.1, 0.1};
};

/// A feature of an image: which track it continues, and where it is in the plane z = 1 of the camera, without distortion.
struct WindowObservation {
  std::int64_t track = 0;
  std::array<double, 2> point{};
};

/// An image and the samples that lead to it.
struct WindowFrame {
  double time = 0.0;
  /// Increasing times, from the last frame's (or before) to this one's (or after); cut and interpolated at both.
  std::vector<ImuSample> imu;
  std::vector<WindowObservation> observations;  ///< no track twice; none at all is allowed: the IMU alone carries on
};

/// What a call did.
struct WindowSummary {
  enum class Left : unsigned char { kNone, kOldest, kSecondNewest };

  /// Of the first thing that went wrong, the culprit named. Whatever it is, no state is lost: a frame with bad input is not taken
  /// up at all; one whose solve fails stays as the IMU predicts it, without its views; a marginalization that fails is tried
  /// again with the next.
  Status status;
  WindowState state;  ///< of the newest frame

  int num_tracked = 0;                 ///< observations of tracks known before
  int num_landmarks = 0;               ///< in the window at the end
  int num_new_landmarks = 0;           ///< triangulated from this frame on
  int num_rejected_landmarks = 0;      ///< with too large an error, or behind a camera
  int num_reanchored_landmarks = 0;    ///< of WindowRule::kKeepSeenLandmarks
  int num_marginalized_landmarks = 0;  ///< into the prior
  int num_dropped_landmarks = 0;       ///< their information lost: too few views

  UpdateSummary update;                    ///< the solve's work
  Left left = Left::kNone;                 ///< which frame left
  double left_time = 0.0;                  ///< its time
  MarginalizationSummary marginalization;  ///< the prior made, if one was
};

/// A native visual-inertial window: IMU samples and tracked features in, states out; over an IncrementalSolver whose graph lives
/// on from frame to frame. A frame is the pose of the IMU, its velocity and biases; landmarks are inverse depths in the first
/// camera that sees them. Each AddFrame predicts the frame by the IMU, triangulates tracks, solves within the budget, takes out
/// landmarks that are wrong, and marginalizes the oldest or drops the second-newest frame.
///
/// Threads: one caller; the solver's num_threads evaluates factors, with the same result to the last bit. Cost: that of the
/// solve and of the marginalization; a window that slides for ever does not grow. Deterministic unless the budget is in seconds.
/// Source: Qin, Li & Shen, "VINS-Mono", 2018; Leutenegger et al., "Keyframe-based visual–inertial odometry using nonlinear
/// optimization", 2015.
class INCERES_EXPORT SlidingWindowEstimator {
 public:
  /// What is wrong with the options is told by Start.
  explicit SlidingWindowEstimator(const SlidingWindowOptions& options);
  ~SlidingWindowEstimator();
  SlidingWindowEstimator(const SlidingWindowEstimator&) = delete;
  SlidingWindowEstimator& operator=(const SlidingWindowEstimator&) = delete;

  /// Takes up the first frame. Once, before all others.
  Status Start(const WindowStart& start, const std::vector<WindowObservation>& observations);

  /// Takes up the next frame. The summary's memory is used again.
  void AddFrame(const WindowFrame& frame, WindowSummary* summary);
  WindowSummary AddFrame(const WindowFrame& frame);

  int num_frames() const;
  /// Of frame i of the window, 0 the oldest. Requires 0 ≤ i < num_frames().
  WindowState State(int i) const;

  /// The covariance of frame i given all there is in the window: 15×15, row-major, of (δp, φ) in the tangent of PoseManifold,
  /// then velocity and biases in the order of the IMU's conventions. Cost: a linearization and factorization of the window. An
  /// error: no such frame, or something is not determined.
  Status StateCovariance(int i, std::array<double, 225>* covariance) const;

  /// Where the landmark of a track is, in the world. An error if the track has none in the window.
  Status LandmarkPosition(std::int64_t track, std::array<double, 3>* point) const;
  /// Σ JᵀJ over the views of the landmark of a track, the frames held: how well they determine it (OKVIS's quality). Row-major,
  /// 3×3 over (m_x, m_y, λ), or 1×1 over λ; weighted by the loss. An error if the track has none in the window.
  Status LandmarkHessian(std::int64_t track, std::vector<double>* hessian) const;

  /// Eigenvalues of the information JᵀJ of the prior, ascending; empty before there is one.
  std::vector<double> PriorSpectrum() const;

  /// The living graph behind it, for whatever else is to be known: its ids are those below.
  const IncrementalSolver& solver() const;
  VariableId PoseId(int i) const;
  VariableId SpeedBiasId(int i) const;
  VariableId LandmarkId(std::int64_t track) const;  ///< −1: the track has no landmark

 private:
  class Impl;
  std::unique_ptr<Impl> impl_;
};

}  // namespace inceres
