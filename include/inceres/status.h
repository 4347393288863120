#pragma once

#include <string>
#include <utility>

#include "inceres/export.h"

namespace inceres {

/// What kind of thing went wrong; the message of a Status names the culprit.
enum class StatusCode {
  kOk,  ///< nothing did
  /// an option or a graph that cannot be solved as given (dangling id, wrong size, two landmarks)
  kInvalidArgument,
  kEvaluationFailed,  ///< a factor returned false, or a residual or Jacobian is not finite
  kSingular,          ///< a block or the reduced system has no Cholesky factor
  kIo,                ///< a file is missing, truncated or malformed
  /// asked for something this build or version does not have, or that there is no memory for
  kUnavailable,
};

/// Outcome of an operation that data can make fail. On data the library throws no exception of its
/// own and never aborts: it returns one of these and leaves the state as it was.
///
/// Cost: the success value holds an empty string and allocates nothing.
struct [[nodiscard]] INCERES_EXPORT Status {
  StatusCode code = StatusCode::kOk;  ///< what kind of thing went wrong
  /// names variable, factor, file or field, and the likely cause; empty on success
  std::string message;

  /// Success.
  static Status Ok() { return {}; }
  /// A failure and its culprit.
  static Status Error(StatusCode code, std::string message) { return {code, std::move(message)}; }
  /// Whether it is a success.
  bool ok() const { return code == StatusCode::kOk; }
};

}  // namespace inceres
