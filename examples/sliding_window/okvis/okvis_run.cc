#include "okvis/okvis_run.h"

#include <memory>

namespace sliding_window {
namespace {

OkvisOptions WithScene(Scene scene, OkvisOptions options) {
  if (scene == Scene::kStartup) {
    options.keyframe_interval = 4;
    options.first_pose_information = 1e14;
    options.speed_sigma = 1.0;
    options.gyr_bias_sigma = 0.03;
    options.acc_bias_sigma = 0.1;
    options.extrinsic_p_sigma = 0.005;
    options.extrinsic_r_sigma = 0.02;
  }
  return options;
}

}  // namespace

RunReport RunOkvis(const RunOptions& options, const OkvisOptions& okvis_options,
                   const SolveFunction& solve) {
  // What an image must show for one landmark in the problem, with tracks of the simulator's
  // lengths.
  constexpr double kTracksPerLandmark = 0.85;
  RunOptions with_tracks = options;
  with_tracks.simulator.tracks_per_frame =
      options.scene == Scene::kHall ? static_cast<int>(kTracksPerLandmark * options.num_features)
                                    : options.num_features;
  const OkvisOptions of_scene = WithScene(options.scene, okvis_options);
  const MakeEstimator make = [&of_scene](const EstimatorOptions& estimator_options,
                                         const SolveFunction& timed_solve, const ImuState& start,
                                         const std::vector<Pose>& body_from_cameras) -> AddFrame {
    auto estimator = std::make_shared<OkvisEstimator>(estimator_options, of_scene, timed_solve,
                                                      start, body_from_cameras);
    return [estimator](const Frame& frame) {
      estimator->AddFrame(frame);
      return estimator->newest_state();
    };
  };
  return Run(with_tracks, make, solve);
}

}  // namespace sliding_window
