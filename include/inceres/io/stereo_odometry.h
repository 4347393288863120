#pragma once

#include <array>
#include <cstdint>
#include <string>
#include <vector>

#include "inceres/export.h"
#include "inceres/factors/point_reprojection.h"
#include "inceres/status.h"

namespace inceres {

/// A stereo camera sees a point in both images.
struct StereoSighting {
  int pose = 0;                 ///< index into StereoOdometry::poses
  int point = 0;                ///< index into StereoOdometry::point_ids
  double left[2] = {0.0, 0.0};  ///< u_l, v: pixels
  double right_u = 0.0;         ///< u_r: pixels
  double in_camera[3] = {
      0.0, 0.0,
      0.0};  ///< the point triangulated from this pair of images: meters, axes of the left camera
};

/// What a stereo visual odometry hands to its back-end: where it thinks its camera was, and the
/// tracks of its points.
struct INCERES_EXPORT StereoOdometry {
  StereoCamera camera;  ///< one for all images
  /// The odometry's estimates in the order of time, as PoseManifold stores poses: the left camera's
  /// center in the world (3, meters), then world_from_camera as a unit quaternion x, y, z, w.
  std::vector<std::array<double, 7>> poses;
  /// id in the file of each point, in the order of first appearance in it
  std::vector<std::int64_t> point_ids;
  std::vector<StereoSighting> sightings;  ///< by pose, those of one pose in the order of the file
};

/// Reads a stereo odometry from the three text files of a folder, one record a line:
///
///     VO_calibration*.txt      f_x f_y skew c_x c_y baseline   one line; pixels and meters, skew 0
///     VO_camera_poses*.txt     i  T(16)                        pose i, numbered 0, 1, 2, …:
///                                                              world_from_camera, 4 x 4
///                                                              row-major; meters
///     VO_stereo_factors*.txt   i p u_l u_r v X Y Z             pose i sees point p, any id from
///                                                              0 on
///
/// where * is any text, the same in all three names. Rotations are projected on the
/// nearest unit quaternion (files print few digits). Blank lines are skipped.
///
/// Every failure is kIo, and `*odometry` is then unchanged. Of the folder the message is `folder:
/// what is wrong`: one that cannot be read, no calibration in it, or two. Of a file it is
/// `file:line: field: what is wrong`: a missing file, a missing or surplus field, a number that is
/// not finite, a focal length or baseline that is not positive, a skew, poses not numbered in
/// order, a matrix that is no rigid motion, no poses, no sightings, a sighting of a pose that is
/// not there, a pose that sees a point twice, and a point that is not in front of the camera.
///
/// Cost: one pass over each file. Threads: no shared state.
INCERES_EXPORT Status ReadStereoOdometry(const std::string& folder, StereoOdometry* odometry);

}  // namespace inceres
