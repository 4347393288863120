#include "vins/vins_run.h"

#include <memory>

#include "vins/vins_estimator.h"

namespace sliding_window {

RunReport RunVins(const RunOptions& options, const SolveFunction& solve) {
  // What an image must show for one feature with a variable, with tracks of the simulator's
  // lengths.
  constexpr double kTracksPerFeature = 0.5;
  RunOptions with_tracks = options;
  with_tracks.simulator.num_cameras = 1;
  with_tracks.is_aligned = true;
  with_tracks.simulator.tracks_per_frame =
      static_cast<int>(kTracksPerFeature * options.num_features);
  const int max_features = 2 * options.num_features;
  const MakeEstimator make = [max_features](
                                 const EstimatorOptions& estimator_options,
                                 const SolveFunction& timed_solve, const ImuState& start,
                                 const std::vector<Pose>& body_from_cameras) -> AddFrame {
    auto estimator = std::make_shared<VinsEstimator>(estimator_options, max_features, timed_solve,
                                                     start, body_from_cameras.front());
    return [estimator](const Frame& frame) {
      estimator->AddFrame(frame);
      return estimator->newest_state();
    };
  };
  return Run(with_tracks, make, solve);
}

}  // namespace sliding_window
