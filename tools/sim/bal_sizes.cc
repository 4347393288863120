#include "tools/sim/bal_sizes.h"

#include <charconv>
#include <system_error>

#include "tools/sim/option_range.h"

namespace inceres::internal {
namespace {

Status Invalid(const char* options, const std::string& what) {
  return Status::Error(StatusCode::kInvalidArgument, std::string(options) + ": " + what);
}

}  // namespace

Status CheckBalSizes(const char* options, std::int64_t num_cameras, std::int64_t num_points,
                     std::int64_t num_observations, double mean_track_length) {
  const bool exact = num_observations != 0;
  const std::int64_t observations =
      exact ? num_observations
            : static_cast<std::int64_t>(mean_track_length * static_cast<double>(num_points));
  if (exact && (observations < 2 * num_points || observations > num_cameras * num_points)) {
    return Invalid(options, "num_observations is " + std::to_string(observations) +
                                ", not between two per point (" + std::to_string(2 * num_points) +
                                ") and every point in every camera (" +
                                std::to_string(num_cameras * num_points) + ")");
  }
  if (2 * observations + 7 < 9 * num_cameras + 3 * num_points) {
    // seven are the free choice of the coordinate frame
    return Invalid(
        options,
        (exact ? "num_observations is "
               : "track_length is " + ShortNumber(mean_track_length) + ", observations about ") +
            std::to_string(observations) + ": two equations each are fewer than the unknowns of " +
            std::to_string(num_cameras) + " cameras and " + std::to_string(num_points) + " points");
  }
  return Status::Ok();
}

Status ParseSizedPreset(const std::string& name, const std::string& prefix, int* size) {
  const char* const begin = name.data() + prefix.size();
  const char* const end = name.data() + name.size();
  int number = 0;
  const std::from_chars_result result = std::from_chars(begin, end, number);
  if (result.ec != std::errc() || result.ptr != end || number < 1) {
    return Status::Error(StatusCode::kInvalidArgument,
                         "preset '" + name + "': after " + prefix + " comes a number of cameras");
  }
  *size = number;
  return Status::Ok();
}

}  // namespace inceres::internal
