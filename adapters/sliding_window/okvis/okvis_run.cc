#include "okvis/okvis_run.h"

#include <memory>

namespace sliding_window {

RunReport RunOkvis(const RunOptions& options, const OkvisOptions& okvis_options, const SolveFunction& solve) {
  // What an image must show for one landmark in the problem, with tracks of the simulator's lengths.
  constexpr double kTracksPerLandmark = 0.85;
  RunOptions with_tracks = options;
  with_tracks.simulator.tracks_per_frame = static_cast<int>(kTracksPerLandmark * options.num_features);
  const MakeEstimator make = [&okvis_options](const EstimatorOptions& estimator_options, const SolveFunction& timed_solve,
                                              const ImuState& start, const Pose& body_from_camera) -> AddFrame {
    auto estimator = std::make_shared<OkvisEstimator>(estimator_options, okvis_options, timed_solve, start, body_from_camera);
    return [estimator](const Frame& frame) {
      estimator->AddFrame(frame);
      return estimator->newest_state();
    };
  };
  return Run(with_tracks, make, solve);
}

}  // namespace sliding_window
