#pragma once

#include <chrono>

namespace inceres::internal {

/// Seconds since an arbitrary fixed moment; monotonic.
inline double NowInSeconds() {
  return std::chrono::duration<double>(std::chrono::steady_clock::now().time_since_epoch()).count();
}

/// Adds the time between its construction and destruction to *seconds.
class StageTimer {
 public:
  explicit StageTimer(double* seconds) : seconds_(seconds), start_(NowInSeconds()) {}
  ~StageTimer() { *seconds_ += NowInSeconds() - start_; }
  StageTimer(const StageTimer&) = delete;
  StageTimer& operator=(const StageTimer&) = delete;

 private:
  double* seconds_;
  double start_;
};

}  // namespace inceres::internal
