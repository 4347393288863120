#pragma once

#include <cstdint>
#include <string>
#include <vector>

#include "inceres/export.h"
#include "inceres/io/bal.h"
#include "inceres/status.h"

namespace inceres::internal {

/// How much a BAL file says it has.
struct BalCounts {
  std::int64_t num_cameras = 0;
  std::int64_t num_points = 0;
  std::int64_t num_observations = 0;

  /// Numbers in the text of such a file.
  std::int64_t NumTokens() const {
    return 3 + 4 * num_observations + BalProblem::kCameraSize * num_cameras +
           BalProblem::kPointSize * num_points;
  }
};

/// A stretch of each of the three parts of a BAL file.
struct BalShare {
  std::int64_t first_observation = 0;
  std::vector<BalObservation> observations;
  std::int64_t first_camera = 0;
  std::vector<double> cameras;  ///< nine a camera
  std::int64_t first_point = 0;
  std::vector<double> points;  ///< three a point
};

/// The counts at the head of a BAL text, and the size of the file. kIo as ReadBal says it.
INCERES_EXPORT Status ReadBalCounts(const std::string& path, BalCounts* counts,
                                    std::int64_t* file_bytes);

/// How many numbers begin in the bytes [begin, end) of a file.
INCERES_EXPORT Status CountTokens(const std::string& path, std::int64_t begin, std::int64_t end,
                                  std::int64_t* num_tokens);

/// Reads the observations, cameras and points whose first number is one of the `num_tokens` numbers
/// that begin at or behind the byte `begin`, of which the first is the `first_token`-th of the
/// file: so all shares of a file together have each of them once. Memory: that of the share. On an
/// error *share is as before; its line counts from the begin of the share.
INCERES_EXPORT Status ReadBalShare(const std::string& path, const BalCounts& counts,
                                   std::int64_t begin, std::int64_t first_token,
                                   std::int64_t num_tokens, BalShare* share);

}  // namespace inceres::internal
