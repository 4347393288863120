#include "tools/command_line/heartbeat.h"

#include <chrono>
#include <utility>

#include "src/base/stopwatch.h"

namespace inceres::tools {

Heartbeat::Heartbeat(std::FILE* out, std::string what, double every_seconds)
    : out_(out), what_(std::move(what)), every_seconds_(every_seconds) {
  if (out_ != nullptr) {
    thread_ = std::thread([this] { Beat(); });
  }
}

Heartbeat::~Heartbeat() {
  if (thread_.joinable()) {
    {
      const std::lock_guard<std::mutex> lock(mutex_);
      done_ = true;
    }
    done_changed_.notify_one();
    thread_.join();
  }
}

void Heartbeat::Beat() {
  const double start = internal::NowInSeconds();
  std::unique_lock<std::mutex> lock(mutex_);
  while (!done_changed_.wait_for(lock, std::chrono::duration<double>(every_seconds_),
                                 [this] { return done_; })) {
    std::fprintf(out_, "%s: %.0f s\n", what_.c_str(), internal::NowInSeconds() - start);
    std::fflush(out_);
  }
}

}  // namespace inceres::tools
