#pragma once

#include <limits>

#include "inceres/io/bal.h"
#include "inceres/io/g2o.h"
#include "inceres/io/keyframes.h"
#include "inceres/io/stereo_odometry.h"
#include "inceres/io/vio_sequence.h"
#include "inceres/status.h"
#include "tools/replay/replay_step.h"

namespace inceres::tools {

/// How a BAL problem is replayed.
struct BalReplayOptions {
  bool free_intrinsics = false;  ///< else f, k1, k2 are held
  bool priors = true;
  unsigned seed = 1;
  /// a step closes a loop if its camera sees a point that nobody saw for more cameras; 0: none does
  int loop_gap = 0;
};

/// Moves the problem to its minimum: Huber(1), at most 400 iterations of the core's batch solver at
/// its default tolerances (at tighter ones the points of low parallax run further off, and the rest
/// shrinks). A failed solve is an error; running into the limit is not.
Status SolveForReplay(int num_threads, BalProblem* bal);

/// Cameras in index order, each step one (the first step two), with the points that two cameras so
/// far see and all their observations by the cameras so far; Huber(1). A new camera or point starts
/// at its value in `bal` plus seeded Gaussian noise of standard deviation 1e-3 rad (rotation), 1e-4
/// D (translation), 2e-3 D (points), where D is the median over the observations of the point's
/// distance from the camera, and gets a prior there of ten times that. The first camera is fixed,
/// without noise. Requires bal.Validate().ok() and two or more cameras. The same bits for the same
/// seed.
ReplayScript MakeBalReplay(const BalProblem& bal, const BalReplayOptions& options);

/// A camera on a simulated path, as a replay.
struct PathReplayOptions {
  int num_cameras = 100;  ///< 20 or more; with loops 165, that it comes round
  bool loops = false;     ///< once a lap old points are seen again; else never
  bool free_intrinsics = false;
  bool priors = true;
  unsigned seed = 1;
};

/// The protocol of MakeBalReplay on a generated path: a camera goes round a circuit of 200 m and
/// sees about 40 points, each 6 times within 30 m in the mean. Nothing is recognized when it comes
/// by again, or with loops 30 % of the points of one tenth of the circuit. The origin is in the
/// middle of the circuit, so that no camera is farther from it than another: the steps of a path
/// without loops are all alike. New cameras and points start near the truth; half a pixel of noise
/// on the observations. The same bits for the same seed. Linear in the number of cameras.
/// kInvalidArgument names what cannot be.
Status MakePathReplay(const PathReplayOptions& options, ReplayScript* script);

/// Keyframes in order, each step one (the first step two), with the features they are the first to
/// see again: inverse depth in the anchor, starting at its DEPTH_GUESS, else its measured value,
/// else 0.5 1/m, with a prior of σ = 0.1 1/m on the measured value if there is one. Observations
/// and BETWEEN are whitened by their information, Huber(1). The first keyframe is fixed. A step
/// closes a loop if it has a BETWEEN of keyframes more than 10 apart. Requires two or more
/// keyframes.
ReplayScript MakeKeyframeReplay(const KeyframeSequence& sequence);

/// How a visual-inertial sequence becomes a problem.
struct VioReplayOptions {
  /// Of the first frame's velocity and biases, at their start: σ = 0.1 m/s, 0.02 rad/s, 0.2 m/s².
  /// Two frames do not tell them.
  bool prior = true;
  LossSpec loss = kUnitHuber;  ///< of reprojections
};

/// Frames in order, each step one (the first step two), with the IMU factor that leads to it and
/// the points that it is the second to see, with all their observations so far. A frame is two
/// variables, pose and speed-bias, a point one, in the world; all begin at the sequence's start
/// values. The camera on the IMU and the first pose are fixed. Reprojections are
/// PointReprojectionFamily's, of standard deviation `pixel_noise`; IMU samples are integrated at
/// the start biases of the earlier frame and stay so, without which Ceres and we would not minimize
/// the same function. A step closes a loop if it sees a point that more than 10 frames did not.
/// Requires Validate() and two or more frames. Errors: samples that cannot be integrated, by frame.
Status MakeVioReplay(const VioSequence& sequence, const VioReplayOptions& options,
                     ReplayScript* script);

/// Poses in order, each step one (the first step two), with the points that it is the second to
/// see, and all their sightings so far; a point that one pose alone saw tells nothing. A pose
/// begins where the odometry leads from what the one before has come to, a point where the first
/// pose to see it, as it stands by now, triangulated it: no drift of the odometry is carried along,
/// nor any of its knowledge but the last motion. The first pose is fixed. Sightings have a standard
/// deviation of one pixel in each coordinate, Huber(1). A step closes a loop if it sees a point
/// that more than 10 poses did not. Requires two or more poses.
ReplayScript MakeStereoReplay(const StereoOdometry& odometry);

/// Poses in the order of their ids, each step one (the first step two), with its edges to earlier
/// ones; no loss. A pose begins where an edge puts it, seen from what its other end has come to: of
/// several from the latest one, along the odometry. What the file fixes stays where it stands
/// there, or else the first pose. A step closes a loop if it has an edge to a pose more than 10
/// before. Spatial edges are RelativePoseFamily's: as those of BuildPoseGraphCeresProblem, but for
/// a rotation residual that is a rotation vector and not its first order. Requires two or more
/// poses. kInvalidArgument names a vertex without an edge to an earlier one, or an edge whose
/// information is not positive definite. Edges that are no odometry are suspects, those from
/// first_wrong_edge on are wrong.
Status MakePoseGraphReplay(const PoseGraph& graph, ReplayScript* script,
                           int first_wrong_edge = std::numeric_limits<int>::max());

}  // namespace inceres::tools
