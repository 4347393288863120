#pragma once

#include <cstdint>
#include <cstdio>
#include <string>

#include "tools/command_line/progress_lines.h"

namespace inceres::tools {

/// Says how far the reading of a file is, one line a second once it has taken a second: `reading
/// FILE: 25 % of 812 MB`. Give it to ReadBal. `out` as ProgressOutput gives it: null for silence.
class ReadProgressPrinter {
 public:
  ReadProgressPrinter(std::string path, std::FILE* out, double every_seconds = 1.0);
  void operator()(std::int64_t bytes_read, std::int64_t file_bytes);

 private:
  std::string path_;
  ProgressLines lines_;
};

}  // namespace inceres::tools
