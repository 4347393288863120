#pragma once

#include <functional>
#include <optional>
#include <string>
#include <vector>

#include "common/estimator_options.h"
#include "common/frame.h"
#include "common/simulator.h"

namespace sliding_window {

enum class Scene {
  kHall,  ///< one camera, a start that the first frames settle
  /// two cameras, and a start that leaves attitude, biases and calibration weakly determined for
  /// seconds
  kStartup,
};

/// A run of an estimator through the simulated hall.
struct RunOptions {
  Scene scene = Scene::kHall;
  int num_frames = 300;
  // that have a variable at a time, on average; kStartup: that an image shows, of VINS twice that
  int num_features = 150;
  int kick = 0;  // not 0: seed of one ulp, up or down, on every value that a solve starts from
  // kStartup: speed and attitude start as an alignment of images and IMU leaves them, not as OKVIS
  // starts
  bool is_aligned = false;
  SimulatorOptions simulator;
  EstimatorOptions estimator;
  std::string json;  // file for the report; none if empty
};

struct RunReport {
  int num_frames = 0;
  std::vector<double> solve_ms;  // per solve that did not fail
  int num_failed_solves = 0;
  double ate_m = 0.0;  // as evo_ape --align
  // of the same positions as they are: the first pose's position and yaw are the true ones
  double position_rmse_m = 0.0;
  double final_cost_sum = 0.0;  // of all solves that did not fail
};

/// A flag without a value that only one program has.
struct Switch {
  std::string name, help;
  bool* value;
};

/// Options from the command line. After --help, or a message on standard error that names what is
/// wrong with an argument, the code to exit with.
std::optional<int> ParseCommandLine(const std::string& usage, int argc, char** argv,
                                    RunOptions* options, const std::vector<Switch>& switches = {});

/// An estimator as the run sees it: takes a frame, tells where the newest one is.
using AddFrame = std::function<ImuState(const Frame&)>;
/// Makes an estimator that solves with `solve` and starts from that state and extrinsic
/// calibration.
using MakeEstimator =
    std::function<AddFrame(const EstimatorOptions&, const SolveFunction& solve,
                           const ImuState& start, const std::vector<Pose>& body_from_cameras)>;

/// Plays the frames. The estimator starts with a velocity a little wrong, biases of zero and, if it
/// is to estimate it, a calibration that is off by a centimeter and half a degree; kStartup: see
/// MakeStart. Times `solve`, everything that it does, and nothing else.
RunReport Run(const RunOptions& options, const MakeEstimator& make_estimator,
              const SolveFunction& solve);

/// Prints the report, and writes the JSON file if one was asked for. False, with a message, if it
/// cannot be written or a solve failed.
bool Write(const RunOptions& options, const RunReport& report);

}  // namespace sliding_window
