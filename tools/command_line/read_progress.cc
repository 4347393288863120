#include "tools/command_line/read_progress.h"

#include <utility>

#include "src/base/stopwatch.h"

namespace inceres::tools {

ReadProgressPrinter::ReadProgressPrinter(std::string path, std::FILE* out, double every_seconds)
    : path_(std::move(path)),
      out_(out),
      every_seconds_(every_seconds),
      next_(internal::NowInSeconds() + every_seconds) {
}

void ReadProgressPrinter::operator()(std::int64_t bytes_read, std::int64_t file_bytes) {
  const double now = internal::NowInSeconds();
  if (now < next_) {
    return;
  }
  next_ = now + every_seconds_;
  if (file_bytes > 0) {
    std::fprintf(out_, "reading %s: %.0f %% of %.0f MB\n", path_.c_str(),
                 100.0 * static_cast<double>(bytes_read) / static_cast<double>(file_bytes),
                 1e-6 * static_cast<double>(file_bytes));
  } else {
    std::fprintf(out_, "reading %s: %.0f MB\n", path_.c_str(),
                 1e-6 * static_cast<double>(bytes_read));
  }
  std::fflush(out_);
}

}  // namespace inceres::tools
