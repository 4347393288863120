#pragma once

#include <array>
#include <cstdint>
#include <memory>
#include <vector>

#include "inceres/export.h"
#include "inceres/factors/imu_preintegrator.h"
#include "inceres/problem/factor_graph.h"
#include "inceres/problem/losses.h"
#include "inceres/solver/incremental_options.h"
#include "inceres/solver/incremental_solver.h"
#include "inceres/solver/marginalization.h"
#include "inceres/status.h"

namespace inceres {

/// What becomes of the landmarks that the oldest frame sees when it leaves.
enum class WindowRule : unsigned char {
  /// They leave with it, and all that was seen of them is in the prior; a track that goes on begins
  /// a landmark of its own, from what is seen of it later. Source: VINS-Mono's MARGIN_OLD (which,
  /// unlike this, uses the views in the prior a second time).
  kMarginalizeLandmarks,
  /// One that the newest frame sees stays, anchored in its next view; the view from the oldest
  /// frame is lost, so that the prior stays sparse. The others leave as above. Source: OKVIS
  /// (Leutenegger et al. 2015, section 3.5).
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
  WindowRule rule = WindowRule::kMarginalizeLandmarks;  ///< for the oldest frame's landmarks
  /// The frame before the newest is a keyframe if the newest one shows fewer than so many known
  /// tracks, or if it moved at least so far from the one before it, as the mean over common tracks
  /// in the plane z = 1. Otherwise it leaves, not the oldest one: its views are dropped, and the
  /// IMU's measurements before and after it become one. ≥ 0; with 0 the tracks do not
  /// count. Source: VINS-Mono (Qin, Li & Shen 2018, section V.A).
  int min_tracked = 20;
  /// in the plane z = 1; see min_tracked; 0 makes every frame a keyframe
  double min_parallax = 10.0 / 460.0;
  /// Seconds that a measurement of the IMU may span before the frame stays whatever it sees; > 0. A
  /// body that stands still would otherwise gather samples for ever.
  double max_imu_seconds = 2.0;

  std::array<double, 7> body_from_camera{0.0, 0.0, 0.0, 0.0,
                                         0.0, 0.0, 1.0};  ///< [p(3), q(x, y, z, w)]; not estimated
  /// Standard deviation of an image point in the plane z = 1: pixels / focal length, in x and in y;
  /// > 0.
  std::array<double, 2> feature_sigma{1.0 / 460.0, 1.0 / 460.0};
  /// On the whitened two-vector of a view; null: none. The default leaves alone what is noise.
  std::shared_ptr<const Loss> loss = std::make_shared<HuberLoss>(3.0);
  LandmarkForm landmark_form = LandmarkForm::kBearing;  ///< how landmarks are written down
  /// A track becomes a landmark when two views of it differ by so much in the plane z = 1, turned
  /// into the same direction; > 0.
  double min_triangulation_parallax = 0.02;
  /// After a solve landmarks leave whose views err by more than so many standard deviations in the
  /// mean; > 0. So do those that ended behind the camera.
  double max_mean_error = 5.0;

  /// Noise, gravity and conventions of the IMU. The perturbation must be kRight.
  ImuOptions imu;
  /// max_num_iterations, max_solver_time_in_seconds and max_factor_evaluations are the budget of a
  /// frame: in iterations, seconds or work.
  IncrementalOptions solver = FrameBudget();
  /// Threshold of the prior, and whether what it holds is linearized for ever where it was when the
  /// prior took it up: first-estimate Jacobians, which pay if first estimates are good
  /// (docs/visual_inertial.md). Without allow_rank_loss a landmark that has too little information
  /// is dropped.
  MarginalizationOptions marginalization;

  /// What is wrong with these options, the first culprit named.
  Status Validate() const;

  /// At most 10 iterations, to a tolerance far below what a frame's noise lets one see.
  static IncrementalOptions FrameBudget() {
    IncrementalOptions budget;
    budget.max_num_iterations = 10;
    budget.function_tolerance = 1e-5;
    budget.claim_damping_share = 1.0;
    return budget;
  }
};

/// What is estimated of a frame.
struct WindowState {
  double time = 0.0;  ///< seconds
  std::array<double, 7> pose{
      0.0, 0.0, 0.0, 0.0,
      0.0, 0.0, 1.0};                ///< of the IMU in the world: [p(3), q(x, y, z, w)], meters
  std::array<double, 3> velocity{};  ///< in the world, m/s
  std::array<double, 3> gyr_bias{};  ///< rad/s
  std::array<double, 3> acc_bias{};  ///< m/s²
};

/// The state at the first frame, and how well it is known: standard deviations, > 0.
struct WindowStart {
  WindowState state;  ///< where the window begins
  std::array<double, 6> pose_sigma{1e-3, 1e-3, 1e-3,
                                   1e-2, 1e-2, 1e-2};   ///< meters; radians about the body's axes
  std::array<double, 3> velocity_sigma{0.1, 0.1, 0.1};  ///< m/s
  std::array<double, 3> gyr_bias_sigma{0.01, 0.01, 0.01};  ///< rad/s
  std::array<double, 3> acc_bias_sigma{0.1, 0.1, 0.1};     ///< m/s²
};

/// A feature of an image: which track it continues, and where it is in the plane z = 1 of the
/// camera, without distortion.
struct WindowObservation {
  std::int64_t track = 0;         ///< the same number in every image that shows it
  std::array<double, 2> point{};  ///< (x, y) in the plane z = 1
};

/// An image and the samples that lead to it.
struct WindowFrame {
  double time = 0.0;  ///< seconds, later than the last frame's
  /// Increasing times, from the last frame's (or before) to this one's (or after); cut and
  /// interpolated at both.
  std::vector<ImuSample> imu;
  /// no track twice; none at all is allowed: the IMU alone carries on
  std::vector<WindowObservation> observations;
};

/// What a call did.
struct WindowSummary {
  /// Which frame a call took out of the window.
  enum class Left : unsigned char {
    kNone,          ///< none
    kOldest,        ///< marginalized
    kSecondNewest,  ///< it was no keyframe: its views are dropped
  };

  /// Of the first thing that went wrong, the culprit named. Whatever it is, no state is lost: a
  /// frame with bad input is not taken up at all; landmarks that cannot be made wait in their
  /// tracks, and the frame is solved without them; one whose solve fails stays as the IMU predicts
  /// it, without its views; a marginalization that fails is tried again with the next.
  Status status;
  WindowState state;  ///< of the newest frame

  int num_tracked = 0;                 ///< observations of tracks known before
  int num_landmarks = 0;               ///< in the window at the end
  int num_new_landmarks = 0;           ///< triangulated from this frame on
  int num_rejected_landmarks = 0;      ///< with too large an error, or behind a camera
  int num_reanchored_landmarks = 0;    ///< of WindowRule::kKeepSeenLandmarks
  int num_marginalized_landmarks = 0;  ///< into the prior
  int num_dropped_landmarks = 0;       ///< their information lost: too few views

  UpdateSummary update;                    ///< the solve's work; as new if there was no solve
  Left left = Left::kNone;                 ///< which frame left
  double left_time = 0.0;                  ///< its time
  MarginalizationSummary marginalization;  ///< the prior made, if one was
};

/// A native visual-inertial window: IMU samples and tracked features in, states out; over an
/// IncrementalSolver whose graph lives on from frame to frame. A frame is the pose of the IMU, its
/// velocity and biases; landmarks are inverse depths in the first camera that sees them. Each
/// AddFrame predicts the frame by the IMU, triangulates tracks, solves within the budget, takes out
/// landmarks that are wrong, and marginalizes the oldest or drops the second-newest frame.
///
/// Threads: one caller; the solver's num_threads evaluates factors, with the same result to the
/// last bit. Cost: that of the solve and of the marginalization; a window that slides for ever does
/// not grow. Deterministic unless the budget is in seconds. Source: Qin, Li & Shen, "VINS-Mono",
/// 2018; Leutenegger et al., "Keyframe-based visual–inertial odometry using nonlinear
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
  /// The same into a new summary.
  WindowSummary AddFrame(const WindowFrame& frame);

  /// Frames in the window now.
  int num_frames() const;
  /// Of frame i of the window, 0 the oldest. Requires 0 ≤ i < num_frames().
  WindowState State(int i) const;

  /// The covariance of frame i given all there is in the window: 15×15, row-major, of (δp, φ) in
  /// the tangent of PoseManifold, then velocity and biases in the order of the IMU's conventions.
  /// Cost: a linearization and factorization of the window. An error: no such frame, or something
  /// is not determined.
  Status StateCovariance(int i, std::array<double, 225>* covariance) const;

  /// Where the landmark of a track is, in the world. An error if the track has none in the window.
  Status LandmarkPosition(std::int64_t track, std::array<double, 3>* point) const;
  /// Σ JᵀJ over the views of the landmark of a track, the frames held: how well they determine it
  /// (OKVIS's quality). Row-major, 3×3 over (m_x, m_y, λ), or 1×1 over λ; weighted by the loss. An
  /// error if the track has none in the window.
  Status LandmarkHessian(std::int64_t track, std::vector<double>* hessian) const;

  /// Eigenvalues of the information JᵀJ of the prior, ascending; empty before there is one.
  std::vector<double> PriorSpectrum() const;

  /// The living graph behind it, for whatever else is to be known: its ids are those below.
  const IncrementalSolver& solver() const;
  /// The variable of frame i's pose. Requires 0 ≤ i < num_frames().
  VariableId PoseId(int i) const;
  /// The variable of frame i's velocity and biases. Requires 0 ≤ i < num_frames().
  VariableId SpeedBiasId(int i) const;
  VariableId LandmarkId(std::int64_t track) const;  ///< −1: the track has no landmark

 private:
  class INCERES_HIDDEN Impl;
  std::unique_ptr<Impl> impl_;
};

}  // namespace inceres
