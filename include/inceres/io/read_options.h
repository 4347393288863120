#pragma once

#include <cstdint>

namespace inceres {

/// What readers of files take beside a path.
struct ReadOptions {
  /// How many bytes a compressed file (.gz, .bz2) may unpack to; more is kIo, and names the limit:
  /// a small file may be made to unpack to more than memory or patience holds. Text that is not
  /// compressed is as large as its file. 0: 64 MiB, or 200 times the size of the file (of a pipe:
  /// of what has been read), whichever is more; files of measurements unpack to about four times
  /// their size.
  std::int64_t max_unpacked_bytes = 0;
};

}  // namespace inceres
