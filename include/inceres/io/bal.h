#pragma once

#include <cstddef>
#include <string>
#include <vector>

#include "inceres/export.h"
#include "inceres/io/read_options.h"
#include "inceres/status.h"

namespace inceres {

/// One measurement of a BAL problem: where `point` appears in the image of `camera`.
struct BalObservation {
  int camera = 0;  ///< 0 .. num_cameras - 1
  int point = 0;   ///< 0 .. num_points - 1
  double x = 0.0;  ///< pixels from the principal point, to the right
  double y = 0.0;  ///< pixels from the principal point, up
};

/// A bundle-adjustment problem "in the large" (BAL, Agarwal et al., ECCV 2010).
///
/// Camera model: with R = Exp(a) of the angle-axis vector a,
///
///     P = R X + t,   p = -P.xy / P.z,   (x, y) = f (1 + k1 |p|^2 + k2 |p|^4) p
///
/// The camera looks along its negative z axis: a point in front of it has P.z < 0.
///
/// The arrays are plain storage, so a solver may take CameraData(i) and PointData(j) as its
/// parameter blocks: those pointers stay valid as long as the vectors are not resized.
struct INCERES_EXPORT BalProblem {
  /// [a0 a1 a2, t0 t1 t2, f, k1, k2]; a in radians, f in pixels
  static constexpr int kCameraSize = 9;
  static constexpr int kPointSize = 3;  ///< X in world coordinates

  int num_cameras = 0;                       ///< at least 1 in a problem that Validate()s
  int num_points = 0;                        ///< likewise
  std::vector<BalObservation> observations;  ///< in the order of the file
  std::vector<double> cameras;               ///< num_cameras x 9, camera by camera
  std::vector<double> points;                ///< num_points x 3, point by point

  /// The kCameraSize values of a camera.
  double* CameraData(int camera) {
    return cameras.data() + static_cast<std::size_t>(camera) * kCameraSize;
  }
  /// The kCameraSize values of a camera.
  const double* CameraData(int camera) const {
    return cameras.data() + static_cast<std::size_t>(camera) * kCameraSize;
  }
  /// The kPointSize values of a point.
  double* PointData(int point) {
    return points.data() + static_cast<std::size_t>(point) * kPointSize;
  }
  /// The kPointSize values of a point.
  const double* PointData(int point) const {
    return points.data() + static_cast<std::size_t>(point) * kPointSize;
  }

  /// Ok if the counts are positive, the arrays have the sizes the counts say, every index is in
  /// range and every number is finite; otherwise kInvalidArgument with a message that names the
  /// first offending entry. Cost: one pass.
  Status Validate() const;
};

/// Reads a BAL file: text, or text compressed with gzip (name ends in .gz) or bzip2 (name ends in
/// .bz2); or the binary form (name ends in .balb; docs/file_formats.md, "BAL, binary"), whose
/// counts are checked against the size of the file, and whose records against their checksums.
///
/// The text is a stream of numbers separated by any white space (spaces, tabs, LF, CR LF or CR line
/// ends, also several or none at the end of the file): three counts, `camera point x y` for each
/// observation, nine numbers per camera, three per point. A leading '+' is accepted.
///
/// Every failure is kIo with a message `file:line: field: what is wrong`: a missing or unreadable
/// file, corrupt or truncated compression, a compressed file that unpacks to more than `options`
/// allow, a truncated file, a count that is not a positive integer, an index out of range, NaN,
/// infinity or a number beyond the range of double, anything that is not a number, and data after
/// the last point. `*problem` is then unchanged.
///
/// `progress`, if given, is called from the reading thread after each piece (at most 256 kB of the
/// file).
///
/// Cost: one pass over the file through a buffer of fixed size; memory is that of the result.
/// Threads: no shared state.
INCERES_EXPORT Status ReadBal(const std::string& path, BalProblem* problem,
                              const ReadProgress& progress = nullptr,
                              const ReadOptions& options = ReadOptions());

/// Writes a BAL file, compressed if the name ends in .gz or .bz2, in binary form if it ends in
/// .balb. Numbers of text are written in the shortest form that reads back as the same double.
///
/// Writes to `path`.partial and renames it at the end, so that an interrupted or failed write never
/// leaves half a file under the name asked for (an existing path that is no regular file, such as a
/// pipe, is written directly). A problem that does not Validate() is kInvalidArgument and nothing
/// is written; a failed write (no such directory, no permission, disk full) is kIo with the
/// system's reason. Threads: no shared state.
INCERES_EXPORT Status WriteBal(const std::string& path, const BalProblem& problem);

/// Root mean square of the distance between observed and predicted image points, in pixels:
/// sqrt(sum |e_i|^2 / n). The cost of a least-squares solver is n / 2 times its square. Requires a
/// problem that Validate()s; not finite if a point has depth 0.
INCERES_EXPORT double ReprojectionRms(const BalProblem& problem);

}  // namespace inceres
