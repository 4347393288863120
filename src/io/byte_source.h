#pragma once

#include <cstddef>
#include <cstdint>
#include <cstdio>
#include <functional>
#include <memory>
#include <string>

#include "inceres/io/read_options.h"
#include "inceres/status.h"

namespace inceres::internal {

/// A stream of bytes to read from: a file, or a decoder on top of one.
class ByteSource {
 public:
  virtual ~ByteSource() = default;
  /// Fills up to `capacity` bytes and sets `*size`; 0 means the end. An error is kIo and its
  /// message does not name the file: the caller knows where in the text it happened.
  virtual Status Read(char* buffer, std::size_t capacity, std::size_t* size) = 0;
};

/// Called after each piece of a file: bytes read so far, and of how many (0: not known).
using ByteProgress = std::function<void(std::int64_t, std::int64_t)>;

/// The bytes of a file as they are.
class FileSource : public ByteSource {
 public:
  ~FileSource() override;
  Status Open(const std::string& path, ByteProgress progress = nullptr);
  Status Read(char* buffer, std::size_t capacity, std::size_t* size) override;
  std::int64_t bytes_read() const { return bytes_read_; }
  /// 0: not known.
  std::int64_t file_bytes() const { return file_bytes_; }

 private:
  std::FILE* file_ = nullptr;
  ByteProgress progress_;
  std::int64_t bytes_read_ = 0;
  std::int64_t file_bytes_ = 0;
};

std::unique_ptr<ByteSource> MakeGzipSource(std::unique_ptr<ByteSource> compressed);
std::unique_ptr<ByteSource> MakeBzip2Source(std::unique_ptr<ByteSource> compressed);

/// Opens a file for reading, with the decoder its name asks for (.gz, .bz2), which ends with an
/// error at the limit of the options. The message of a failure to open names the file.
Status OpenByteSource(const std::string& path, std::unique_ptr<ByteSource>* source,
                      ByteProgress progress = nullptr, const ReadOptions& options = ReadOptions());

/// How the system explains the current errno.
std::string SystemError();

}  // namespace inceres::internal
