#include "tools/command_line/progress_lines.h"

#include "src/base/stopwatch.h"

namespace inceres::tools {

ProgressLines::ProgressLines(std::FILE* out, double every_seconds)
    : out_(out), every_seconds_(every_seconds), next_(internal::NowInSeconds() + every_seconds) {
}

void ProgressLines::operator()(const std::function<std::string()>& text) {
  if (out_ == nullptr) {
    return;
  }
  const double now = internal::NowInSeconds();
  if (now >= next_) {
    next_ = now + every_seconds_;
    std::fprintf(out_, "%s\n", text().c_str());
    std::fflush(out_);
  }
}

}  // namespace inceres::tools
