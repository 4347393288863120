#include "io/byte_sink.h"

#include <filesystem>
#include <system_error>
#include <utility>

#include "base/text.h"
#include "io/byte_source.h"

// Where writers of files put their bytes. A file grows under the name `path`.partial and is renamed
// in Finish, which replaces a file of the same name in one step: a reader sees the old file or the
// new one. A sink that is destroyed without Finish, whatever went wrong above it, removes the
// partial file. Encoders (gzip_stream.cc, bzip2_stream.cc) own the sink below them, so this holds
// for compressed files too.

namespace inceres::internal {

// Open still means that Finish has not got as far as closing it.
FileSink::~FileSink() {
  if (file_ != nullptr) {
    std::fclose(file_);
    if (!partial_.empty()) {
      std::remove(partial_.c_str());
    }
  }
}

// Asks errno: to be called before anything else can set it.
Status FileSink::Failure(const std::string& what) const {
  return Status::Error(StatusCode::kIo, path_ + ": " + what + ": " + SystemError());
}

Status FileSink::Open(const std::string& path) {
  path_ = path;
  std::error_code error;
  const std::filesystem::file_status existing = std::filesystem::status(path, error);
  // The rename would be what fails, at the end of all work.
  if (std::filesystem::is_directory(existing)) {
    return Status::Error(StatusCode::kIo, path + ": cannot write: is a directory");
  }
  // A pipe or a device exists already and is not to be replaced by a file.
  const bool direct =
      std::filesystem::exists(existing) && !std::filesystem::is_regular_file(existing);
  if (!direct) {
    // A link keeps pointing where it points: the file behind it is what is replaced.
    if (std::filesystem::path target = std::filesystem::canonical(path, error); !error) {
      path_ = target.string();
    }
    partial_ = path_ + ".partial";
  }
  // An old .partial of a process that was killed is overwritten.
  file_ = std::fopen(direct ? path_.c_str() : partial_.c_str(), "wb");
  return file_ != nullptr ? Status::Ok() : Failure("cannot open for writing");
}

// Through stdio's buffer: a full disk may be told by a later write, or by the flush.
Status FileSink::Write(const char* data, std::size_t size) {
  return std::fwrite(data, 1, size, file_) == size ? Status::Ok() : Failure("cannot write");
}

// Flush, close, rename, in this order: each of the first two may be the first to tell that the disk
// is full, and a file that may be incomplete must not get the name.
Status FileSink::Finish() {
  if (std::fflush(file_) != 0) {
    return Failure("cannot write");
  }
  // Closing may be what reports a full quota or a lost network disk.
  const bool closed = std::fclose(std::exchange(file_, nullptr)) == 0;
  if (closed && (partial_.empty() || std::rename(partial_.c_str(), path_.c_str()) == 0)) {
    return Status::Ok();
  }
  Status failure =
      Failure(closed ? "cannot rename the finished file to this name" : "cannot write");
  // The destructor sees no open file any more, so it would leave this one behind. After Failure,
  // for removing may change errno.
  if (!partial_.empty()) {
    std::remove(partial_.c_str());
  }
  return failure;
}

// By the name asked for, not by that of a file that a link leads to.
Status OpenByteSink(const std::string& path, std::unique_ptr<ByteSink>* sink) {
  auto file = std::make_unique<FileSink>();
  if (Status status = file->Open(path); !status.ok()) {
    return status;
  }
  if (EndsWith(path, ".gz")) {
    *sink = MakeGzipSink(std::move(file));
  } else if (EndsWith(path, ".bz2")) {
    *sink = MakeBzip2Sink(std::move(file));
  } else {
    *sink = std::move(file);
  }
  return Status::Ok();
}

}  // namespace inceres::internal
