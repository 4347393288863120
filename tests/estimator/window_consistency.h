#pragma once

#include <cmath>
#include <cstdint>
#include <vector>

#include <Eigen/Cholesky>

#include "estimator/window_sequence.h"

namespace inceres::test {

/// The normalized error squared of the newest pose, e P⁻¹ e with e = estimate ⊟ truth and P its
/// covariance by the window: for a consistent estimator a χ² variable of six degrees of freedom,
/// with mean 6 and variance 12.
struct PoseNees {
  std::vector<double> times;  // of the frames it is taken at
  std::vector<double> means;  // over the runs
  int num_runs = 0;
  double rms_error = 0.0;  // of the newest places to the true ones, meters

  double Mean() const {
    double sum = 0.0;
    for (const double mean : means) {
      sum += mean;
    }
    return sum / static_cast<double>(means.size());
  }
  /// Half the width of the band around 6 that the mean over the runs at one time keeps in 95 % of
  /// all cases (χ² with 6 num_runs degrees of freedom, as good as normal).
  double Band() const { return 1.96 * std::sqrt(12.0 / num_runs); }
  /// The share of the times at which it does.
  double ShareInBand() const {
    int count = 0;
    for (const double mean : means) {
      count += std::fabs(mean - 6.0) <= Band() ? 1 : 0;
    }
    return static_cast<double>(count) / static_cast<double>(means.size());
  }
};

/// Plays num_runs simulated windows, seed by seed: another start, other points and other noise
/// each. `adjust` sets the window's options; NEES is taken at every `stride`-th frame.
template <typename Adjust>
PoseNees MonteCarloNees(VioSceneOptions scene, int num_runs, int stride, const Adjust& adjust) {
  PoseNees nees;
  nees.num_runs = num_runs;
  double squares = 0.0;
  for (int run = 0; run < num_runs; ++run) {
    scene.seed = static_cast<std::uint64_t>(run) + 1;
    VioSequence sequence;
    const Status simulated = GenerateVioScene(scene, &sequence);
    EXPECT_TRUE(simulated.ok()) << simulated.message;
    SlidingWindowOptions options = WindowOptionsOf(sequence);
    adjust(&options);
    WindowRun window(sequence, options, static_cast<unsigned>(run) + 1);
    for (std::size_t k = 0; window.next < sequence.frames.size();) {
      const std::size_t frame = window.next;
      window.Step();
      if (frame % static_cast<std::size_t>(stride) != 0) {
        continue;
      }
      if (run == 0) {
        nees.times.push_back(window.summary.state.time);
        nees.means.push_back(0.0);
      }
      std::array<double, 225> all{};
      const Status status =
          window.estimator.StateCovariance(window.estimator.num_frames() - 1, &all);
      EXPECT_TRUE(status.ok()) << status.message;
      const Eigen::Matrix<double, 6, 6> P =
          Eigen::Map<const Eigen::Matrix<double, 15, 15>>(all.data()).topLeftCorner<6, 6>();
      const Eigen::Matrix<double, 6, 1> error =
          PoseError(window.summary.state.pose, sequence.frames[frame].truth.pose);
      nees.means[k++] += error.dot(P.llt().solve(error)) / num_runs;
    }
    squares += window.RmsError() * window.RmsError();
  }
  nees.rms_error = std::sqrt(squares / num_runs);
  return nees;
}

/// The window that the figures of docs/visual_inertial.md are about: a circle in 20 s, 30 points in
/// view or so, a good start.
inline VioSceneOptions ConsistencyScene(int num_frames) {
  VioSceneOptions scene;
  scene.num_frames = num_frames;
  scene.num_points = 200 + num_frames / 2;
  return scene;
}

}  // namespace inceres::test
