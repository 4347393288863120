#pragma once

#include <cstddef>
#include <cstdio>
#include <memory>
#include <string>

#include "inceres/status.h"

namespace inceres::internal {

/// A stream of bytes to write to: a file, or an encoder on top of one.
class ByteSink {
 public:
  virtual ~ByteSink() = default;
  virtual Status Write(const char* data, std::size_t size) = 0;
  /// Completes the file and puts it under its name. A sink destroyed before leaves nothing behind.
  virtual Status Finish() = 0;
};

/// Writes to `path`.partial and renames it in Finish(), so that nobody ever sees half a file under
/// the name asked for. An existing path that is no regular file (a pipe, a device) is written
/// directly.
class FileSink : public ByteSink {
 public:
  ~FileSink() override;
  Status Open(const std::string& path);
  Status Write(const char* data, std::size_t size) override;
  Status Finish() override;

 private:
  Status Failure(const std::string& what) const;

  std::string path_;
  std::string partial_;  // empty if written directly
  std::FILE* file_ = nullptr;
};

std::unique_ptr<ByteSink> MakeGzipSink(std::unique_ptr<ByteSink> file);
std::unique_ptr<ByteSink> MakeBzip2Sink(std::unique_ptr<ByteSink> file);

/// Opens a file for writing, with the encoder its name asks for (.gz, .bz2). Messages of failures
/// name the file.
Status OpenByteSink(const std::string& path, std::unique_ptr<ByteSink>* sink);

}  // namespace inceres::internal
