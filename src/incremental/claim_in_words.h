#pragma once

#include <cstdarg>
#include <cstdio>
#include <string>

#include "base/scientific.h"

namespace inceres::internal {

/// Why a solve has converged, with figures. What was said once is said again without an allocation.
class ClaimInWords {
 public:
  const char* text() const { return text_; }
  bool empty() const { return text_[0] == '\0'; }
  void Forget() { text_[0] = '\0'; }

  [[gnu::format(printf, 2, 3)]] void Say(const char* format, ...) {
    std::va_list arguments;
    va_start(arguments, format);
    std::vsnprintf(text_, sizeof(text_), format, arguments);
    va_end(arguments);
  }
  /// The model sees so much left of the cost, -1 if nobody knows: in Ceres's words where its test
  /// would hold.
  void SayLittleLeft(double left, double cost, double function_tolerance) {
    const double share = cost > 0.0 && left > 0.0 ? left / cost : 0.0;
    Say(share <= function_tolerance
            ? "Function tolerance reached. |cost_change|/cost: %s <= %s"
            : "What is left undone is below the rounding of the cost. |cost_change|/cost: %s > %s",
        Scientific(share).text(), Scientific(function_tolerance).text());
  }
  /// For whatever is said, from the first time on.
  void MakeRoomIn(std::string* message) const { message->reserve(sizeof(text_)); }

 private:
  char text_[200] = "";
};

}  // namespace inceres::internal
