#pragma once

#include <array>
#include <string>
#include <vector>

#include "inceres/export.h"
#include "inceres/io/read_options.h"
#include "inceres/status.h"

namespace inceres {

/// A point on the ray through an image point of the keyframe that saw it first, its anchor.
struct KeyframeFeature {
  int anchor = 0;              ///< the keyframe that saw it first
  int index = 0;               ///< its number in the anchor, as in the file
  double x = 0.0;              ///< image point in the anchor, normalized (plane z = 1)
  double y = 0.0;              ///< likewise
  double inverse_depth = 0.0;  ///< measured in the anchor, 1/m; 0: not measured
};

/// The keyframe it arrives with sees a feature of an earlier one.
struct KeyframeObservation {
  int feature = 0;             ///< index into KeyframeSequence::features
  double x = 0.0;              ///< normalized image point
  double y = 0.0;              ///< likewise
  double inverse_depth = 0.0;  ///< measured, 1/m; 0: not measured
  /// w00 w01 w11 of the 2 x 2 information matrix of (x, y), positive definite
  std::array<double, 3> information{};
};

/// An initial guess of a feature's inverse depth.
struct KeyframeDepthGuess {
  int feature = 0;             ///< index into KeyframeSequence::features
  double inverse_depth = 0.0;  ///< 1/m
};

/// A measured relative pose of two keyframes, C_a C_b^-1 = T_ab: with camera_from_world rotations R
/// and centers p, R_a R_b^T = R_ab and R_b (p_a - p_b) = p_ab.
struct KeyframeBetween {
  int a = 0;                                       ///< index of the one keyframe
  int b = 0;                                       ///< index of the other
  std::array<double, 4> q_ab{0.0, 0.0, 0.0, 1.0};  ///< R_ab as a unit quaternion x, y, z, w
  std::array<double, 3> p_ab{};                    ///< meters
  /// 6 x 6, row-major, rotation before position; symmetric positive definite
  std::array<double, 36> information{};
};

/// One keyframe and all that arrives with it, each kind in the order of the file.
struct Keyframe {
  /// Initial guess as the built-in PoseManifold stores poses: the camera's center p in the world
  /// (3, meters), then the rotation world_from_camera as a unit quaternion x, y, z, w (the file has
  /// camera_from_world).
  std::array<double, 7> pose{0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 1.0};
  std::vector<KeyframeDepthGuess> depth_guesses;  ///< of features known by now
  std::vector<int> features;  ///< anchored here: indices into KeyframeSequence::features
  std::vector<KeyframeObservation> observations;  ///< of features anchored earlier
  std::vector<KeyframeBetween> betweens;          ///< odometry and loops
};

/// What a keyframe-based visual odometry hands to its back-end, keyframe by keyframe.
struct INCERES_EXPORT KeyframeSequence {
  std::vector<Keyframe> keyframes;        ///< in the order of arrival
  std::vector<KeyframeFeature> features;  ///< of all keyframes, in the order of the file

  /// Observations of all keyframes.
  int NumObservations() const;
  /// Relative poses of all keyframes.
  int NumBetweens() const;
};

/// Reads a keyframe sequence (optionally .gz or .bz2), one record a line; blank lines and lines
/// that start with '#' are skipped:
///
///     KEYFRAME i  R(9, row-major) p(3)   keyframe i, numbered 0, 1, 2, …: x_c = R (x_w - p);
///                                        what follows arrives with it
///     DEPTH_GUESS i k d                  initial guess of the inverse depth of feature k
///                                        anchored in keyframe i
///     FEATURE i k x y d_obs              feature k first seen in keyframe i, the current one;
///                                        d_obs = 0: not measured
///     OBS i a k x y d_obs w00 w01 w11    keyframe i, the current one, sees feature k anchored
///                                        in the earlier keyframe a
///     BETWEEN a b R(9) p(3) w(36)        C_a C_b^-1 = T_ab, w row-major, rotation first
///
/// Rotations are projected on the nearest unit quaternion (files print few digits).
///
/// Every failure is kIo with a message `file:line: TAG: field: what is wrong`: a missing file,
/// corrupt compression or one beyond the limit of `options`, an unknown tag, a record before the
/// first KEYFRAME, keyframes not numbered in order, a missing or surplus field, a number that is
/// not finite, an R that is no rotation, a keyframe or feature that has not arrived yet, a feature
/// twice in one keyframe, an inverse depth that is negative (or 0 in a guess), an information
/// matrix that is not symmetric positive definite, and a file without keyframes. `*sequence` is
/// then unchanged.
///
/// Cost: one pass over the file. Threads: no shared state.
INCERES_EXPORT Status ReadKeyframes(const std::string& path, KeyframeSequence* sequence,
                                    const ReadOptions& options = ReadOptions());

}  // namespace inceres
