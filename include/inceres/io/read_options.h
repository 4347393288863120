#pragma once

#include <cstdint>
#include <functional>
#include <memory>

namespace inceres {

class Loss;

/// Told how far a read has come: bytes of the file (as they are on disk) read so far, and of how
/// many; 0 if that is not known, as of a pipe.
using ReadProgress = std::function<void(std::int64_t bytes_read, std::int64_t file_bytes)>;

/// What readers of files take beside a path.
struct ReadOptions {
  /// How many bytes a compressed file (.gz, .bz2) may unpack to; more is kIo, and names the limit:
  /// a small file may be made to unpack to more than memory or patience holds. Text that is not
  /// compressed is as large as its file. 0: 64 MiB, or 200 times the size of the file (of a pipe:
  /// of what has been read), whichever is more; files of measurements unpack to about four times
  /// their size.
  std::int64_t max_unpacked_bytes = 0;
};

/// What readers take that make factors of a file's measurements.
struct GraphReadOptions {
  ReadOptions file;                  ///< of the reader of the file
  std::shared_ptr<const Loss> loss;  ///< of every factor that is a measurement; null: ½‖f‖²
};

}  // namespace inceres
