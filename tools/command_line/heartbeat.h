#pragma once

#include <condition_variable>
#include <cstdio>
#include <mutex>
#include <string>
#include <thread>

namespace inceres::tools {

/// Progress of work that calls nobody meanwhile: from the second second on a thread prints `WHAT:
/// 3 s` once a second, until this object goes. `out` as ProgressOutput gives it; null: no thread.
class Heartbeat {
 public:
  Heartbeat(std::FILE* out, std::string what, double every_seconds = 1.0);
  ~Heartbeat();
  Heartbeat(const Heartbeat&) = delete;
  Heartbeat& operator=(const Heartbeat&) = delete;

 private:
  void Beat();

  std::FILE* out_;
  std::string what_;
  double every_seconds_;
  std::mutex mutex_;
  std::condition_variable done_changed_;
  bool done_ = false;
  std::thread thread_;
};

}  // namespace inceres::tools
