#pragma once

#include <cstdio>
#include <functional>
#include <string>

namespace inceres::tools {

/// Tells how far long work is: one line a second once it has taken a second, so nothing of short
/// work. `out` as ProgressOutput gives it: null for silence.
class ProgressLines {
 public:
  explicit ProgressLines(std::FILE* out, double every_seconds = 1.0);

  /// Prints the text if a line is due; only then it is made. Cheap otherwise: a look at the clock.
  void operator()(const std::function<std::string()>& text);

 private:
  std::FILE* out_;
  double every_seconds_;
  double next_;
};

}  // namespace inceres::tools
