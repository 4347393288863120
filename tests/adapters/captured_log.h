#pragma once

#include <mutex>
#include <string>
#include <vector>

#include <glog/logging.h>

namespace inceres::testing {

/// The messages of the log while it lives, of this severity or worse.
class CapturedLog : public google::LogSink {
 public:
  explicit CapturedLog(google::LogSeverity least = google::GLOG_WARNING) : least_(least) {
    google::AddLogSink(this);
  }
  ~CapturedLog() override { google::RemoveLogSink(this); }

  void send(google::LogSeverity severity, const char*, const char*, int, const std::tm*,
            const char* message, std::size_t length) override {
    if (severity >= least_) {
      const std::lock_guard<std::mutex> lock(mutex_);
      messages_.emplace_back(message, length);
    }
  }
  using google::LogSink::send;

  std::vector<std::string> messages() const {
    const std::lock_guard<std::mutex> lock(mutex_);
    return messages_;
  }

 private:
  google::LogSeverity least_;
  mutable std::mutex mutex_;
  std::vector<std::string> messages_;
};

}  // namespace inceres::testing
