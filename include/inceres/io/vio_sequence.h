#pragma once

#include <array>
#include <string>
#include <vector>

#include "inceres/export.h"
#include "inceres/factors/imu_preintegrator.h"
#include "inceres/factors/point_reprojection.h"
#include "inceres/io/read_options.h"
#include "inceres/status.h"

namespace inceres {

/// A pinhole camera with radial-tangential distortion (factors/point_reprojection.h), and its place
/// on the IMU: a point x_b in the frame of the IMU is at x_c = R_bcᵀ (x_b − p_bc) in the camera's.
struct VioCamera {
  int width = 640;                                               ///< pixels; u from 0 to width
  int height = 480;                                              ///< pixels; v from 0 to height
  std::array<double, 4> intrinsics{460.0, 460.0, 320.0, 240.0};  ///< f_x, f_y, c_x, c_y, pixels
  std::array<double, 4> distortion{};                            ///< k1, k2, p1, p2
  /// imu_from_camera [p_bc(3), q_bc(x, y, z, w)]; by default the camera looks along the x axis of
  /// the IMU, its right is −y.
  std::array<double, 7> imu_from_camera{0.1, 0.0, 0.05, -0.5, 0.5, -0.5, 0.5};

  /// Its intrinsics, as the factors take them.
  PinholeCamera Pinhole() const {
    return {intrinsics[0], intrinsics[1], intrinsics[2], intrinsics[3],
            distortion[0], distortion[1], distortion[2], distortion[3]};
  }
};

/// What an estimator estimates of a frame.
struct VioState {
  std::array<double, 7> pose{
      0.0, 0.0, 0.0, 0.0,
      0.0, 0.0, 1.0};                ///< of the IMU in the world: [p(3), q(x, y, z, w)], meters
  std::array<double, 3> velocity{};  ///< in the world, m/s
  std::array<double, 3> gyr_bias{};  ///< rad/s
  std::array<double, 3> acc_bias{};  ///< m/s²
};

/// A point as seen in a frame.
struct VioObservation {
  int point = 0;         ///< index into VioSequence::points
  double x = 0.0;        ///< pixels, distortion included
  double y = 0.0;        ///< likewise
  bool outlier = false;  ///< whether it is known to be wrong
};

/// One camera frame and what arrives with it.
struct VioFrame {
  double time = 0.0;  ///< seconds
  VioState start;     ///< initial guess
  VioState truth;     ///< what it really was
  /// The samples from the last frame's to this one's: the first has the time of the last frame and
  /// is that frame's last sample, the last one has the time of this frame; ready for
  /// ImuPreintegrator::Integrate. Of the first frame: those up to its time.
  std::vector<ImuSample> imu;
  std::vector<VioObservation> observations;  ///< sorted by point, none twice
};

/// A point of the scene.
struct VioPoint {
  std::array<double, 3> start{};  ///< initial guess, meters in the world
  std::array<double, 3> truth{};  ///< where it really is, meters in the world
};

/// Images and inertial measurements with the truth behind them.
struct INCERES_EXPORT VioSequence {
  VioCamera camera;          ///< one for all frames
  ImuNoise imu_noise;        ///< densities (ImuConventions::Noise::kContinuous)
  double pixel_noise = 1.0;  ///< standard deviation of an image coordinate, for its weight; > 0
  /// g, the acceleration of free fall in the world, m/s²
  std::array<double, 3> gravity{0.0, 0.0, -9.81};
  std::vector<VioFrame> frames;  ///< in the order of time
  std::vector<VioPoint> points;  ///< numbered as observations name them

  /// Observations of all frames.
  int NumObservations() const;
  /// Those of them known to be wrong.
  int NumOutliers() const;
  /// Where the camera sees a point of the world from this pose of the IMU; false if it is not in
  /// front of the camera.
  bool Project(const std::array<double, 7>& pose, const std::array<double, 3>& point, double* x,
               double* y) const;
  /// kInvalidArgument naming the first frame, point or field that does not keep what the structs
  /// above promise.
  Status Validate() const;
};

/// Reads a visual-inertial sequence (optionally .gz or .bz2), one record a line; blank lines and
/// lines that start with '#' are skipped:
///
///     VIO 1                            the first record: the version of the format
///     CAMERA width height  f_x f_y c_x c_y  k1 k2 p1 p2  p_bc(3) q_bc(4)
///     NOISE pixel  gyr acc gyr_bias_walk acc_bias_walk
///                                      standard deviation in pixels; densities of the IMU
///     GRAVITY g(3)
///     POINT k  start(3)  truth(3)      numbered 0, 1, 2, …; before the first OBS of it
///     IMU t  gyr(3)  acc(3)            increasing times; one at the time of each frame
///     FRAME i t  start(16)  truth(16)  numbered 0, 1, 2, …; p(3) q(4) v(3) b_g(3) b_a(3), each
///     OBS k x y outlier                the frame above sees point k; outlier is 0 or 1
///
/// CAMERA, NOISE and GRAVITY, each once, stand before the first IMU. Quaternions are x, y, z, w.
/// Everything stands in the order of arrival: a frame comes after the samples that lead to it.
///
/// Every failure is kIo with a message `file:line: TAG: field: what is wrong`: a missing file,
/// corrupt compression or one beyond the limit of `options`, another version, an unknown tag, a
/// record out of order or twice, a missing or surplus field, a number that is not finite, a
/// quaternion that is not a unit one, a focal length or noise that is not positive, times that do
/// not increase, a frame without a sample at its time, a point that has not arrived or that a frame
/// sees twice, and a file without frames. `*sequence` is then unchanged.
///
/// Cost: one pass over the file. Threads: no shared state.
INCERES_EXPORT Status ReadVioSequence(const std::string& path, VioSequence* sequence,
                                      const ReadOptions& options = ReadOptions());

/// Writes it in that format, behind comments that explain it; compressed if the name ends in .gz or
/// .bz2. Points stand before the first observation of them. Reading it gives the same sequence to
/// the last bit. kInvalidArgument if it does not Validate(), kIo if the file cannot be written;
/// there is then no file of this name, or the one there was.
INCERES_EXPORT Status WriteVioSequence(const std::string& path, const VioSequence& sequence);

}  // namespace inceres
