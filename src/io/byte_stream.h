#pragma once

#include <cstddef>
#include <cstdint>
#include <cstdio>
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

/// The bytes of a file as they are.
class FileSource : public ByteSource {
 public:
  ~FileSource() override;
  Status Open(const std::string& path, ReadProgress progress = nullptr);
  Status Read(char* buffer, std::size_t capacity, std::size_t* size) override;
  std::int64_t bytes_read() const { return bytes_read_; }
  /// 0: not known.
  std::int64_t file_bytes() const { return file_bytes_; }

 protected:
  std::FILE* file_ = nullptr;

 private:
  ReadProgress progress_;
  std::int64_t bytes_read_ = 0;
  std::int64_t file_bytes_ = 0;
};

std::unique_ptr<ByteSource> MakeGzipSource(std::unique_ptr<ByteSource> compressed);
std::unique_ptr<ByteSource> MakeBzip2Source(std::unique_ptr<ByteSource> compressed);

/// Opens a file for reading, with the decoder its name asks for (.gz, .bz2), which ends with an
/// error at the limit of the options. The message of a failure to open names the file.
Status OpenByteSource(const std::string& path, std::unique_ptr<ByteSource>* source,
                      ReadProgress progress = nullptr, const ReadOptions& options = ReadOptions());

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

/// How the system explains the current errno.
std::string SystemError();

}  // namespace inceres::internal
