#pragma once

#include <string>

#include "inceres/status.h"

namespace inceres::internal {

/// An option and where it may lie.
struct OptionRange {
  const char* name;
  double value, low, high;
};

/// A number without the zeros at its end.
std::string ShortNumber(double value);

/// kInvalidArgument "`options`: name is …, not between … and …" of the first option outside its
/// range, or not a number.
template <typename Ranges>
Status CheckRanges(const char* options, const Ranges& ranges) {
  for (const OptionRange& range : ranges) {
    if (!(range.value >= range.low && range.value <= range.high)) {
      return Status::Error(StatusCode::kInvalidArgument,
                           std::string(options) + ": " + range.name + " is " +
                               ShortNumber(range.value) + ", not between " +
                               ShortNumber(range.low) + " and " + ShortNumber(range.high));
    }
  }
  return Status::Ok();
}

}  // namespace inceres::internal
