#include "io/byte_stream.h"

#include <algorithm>
#include <cerrno>
#include <cstdint>
#include <filesystem>
#include <system_error>
#include <utility>

#include "base/text.h"

// Where readers of files get their bytes from: a file, a decoder on top of it where the name says
// so, and a limit on top of that. Memory is the callers' buffers; nothing here holds more of a file
// than the piece at hand, so a pipe serves as well as a file.

namespace inceres::internal {

// To be asked before another call can set errno.
std::string SystemError() {
  return std::generic_category().message(errno);
}

FileSource::~FileSource() {
  if (file_ != nullptr) {
    std::fclose(file_);
  }
}

Status FileSource::Open(const std::string& path, ReadProgress progress) {
  file_ = std::fopen(path.c_str(), "rb");
  if (file_ == nullptr) {
    return Status::Error(StatusCode::kIo, path + ": cannot open for reading: " + SystemError());
  }
  progress_ = std::move(progress);
  // A pipe has no size: 0 tells those who show progress, and LimitedSource, that it is not known.
  std::error_code no_regular_file;
  const std::uintmax_t size = std::filesystem::file_size(path, no_regular_file);
  file_bytes_ = no_regular_file ? 0 : static_cast<std::int64_t>(size);
  std::setvbuf(file_, nullptr, _IONBF, 0);  // our callers read large pieces
  return Status::Ok();
}

// No bytes and no error is the end of the file; some bytes before an error are handed on, and the
// error comes with the next call.
Status FileSource::Read(char* buffer, std::size_t capacity, std::size_t* size) {
  *size = std::fread(buffer, 1, capacity, file_);
  if (*size == 0 && std::ferror(file_) != 0) {
    return Status::Error(StatusCode::kIo, "cannot read: " + SystemError());
  }
  bytes_read_ += static_cast<std::int64_t>(*size);
  // In bytes of the file, packed or not: how far a decoder will get is not known in advance.
  if (progress_) {
    progress_(bytes_read_, file_bytes_);
  }
  return Status::Ok();
}

namespace {

// What any file may unpack to, and how much more than its own size a large one may:
// ReadOptions::max_unpacked_bytes says the same to users.
constexpr std::int64_t kFreeBytes = std::int64_t{64} << 20;
constexpr std::int64_t kMaxRatio = 200;

// What a decoder makes of a file, up to the limit of ReadOptions.
// A few kilobytes can be made to unpack to gigabytes, and readers keep what they read: the limit
// ends such a file before memory does.
class LimitedSource : public ByteSource {
 public:
  LimitedSource(const FileSource& file, std::unique_ptr<ByteSource> decoder, std::int64_t max_bytes)
      : file_(file), decoder_(std::move(decoder)), max_bytes_(max_bytes) {}

  // The limit is looked at after each piece, so it is exceeded by one piece at most, which is
  // withheld.
  Status Read(char* buffer, std::size_t capacity, std::size_t* size) override {
    Status status = decoder_->Read(buffer, capacity, size);
    unpacked_bytes_ += static_cast<std::int64_t>(*size);
    const std::int64_t limit = Limit();
    if (status.ok() && unpacked_bytes_ > limit) {
      *size = 0;
      return Status::Error(
          StatusCode::kIo,
          "the file unpacks to more than " + std::to_string(limit) + " bytes, the limit" +
              (max_bytes_ > 0 ? "" : " for one of its size") +
              "; ReadOptions::max_unpacked_bytes (tools: --max_unpacked_bytes) sets another");
    }
    return status;
  }

 private:
  // In units of the packed size. Of a pipe that is what has been read of it so far, which only
  // grows; the larger of the two serves both. The inner minimum keeps the product from overflowing.
  std::int64_t Limit() const {
    const std::int64_t packed_bytes = std::max(file_.file_bytes(), file_.bytes_read());
    return max_bytes_ > 0
               ? max_bytes_
               : std::max(kFreeBytes, std::min(packed_bytes, INT64_MAX / kMaxRatio) * kMaxRatio);
  }

  const FileSource& file_;  // the decoder's
  std::unique_ptr<ByteSource> decoder_;
  std::int64_t max_bytes_;
  std::int64_t unpacked_bytes_ = 0;
};

}  // namespace

// The chain is file → decoder → limit; each owns the one before, and the limit refers to the file
// for its size. Text that is not compressed needs no limit.
Status OpenByteSource(const std::string& path, std::unique_ptr<ByteSource>* source,
                      ReadProgress progress, const ReadOptions& options) {
  if (options.max_unpacked_bytes < 0) {
    return Status::Error(StatusCode::kInvalidArgument,
                         path + ": ReadOptions::max_unpacked_bytes is " +
                             std::to_string(options.max_unpacked_bytes) +
                             "; it must be at least 0");
  }
  auto file = std::make_unique<FileSource>();
  if (Status status = file->Open(path, std::move(progress)); !status.ok()) {
    return status;
  }
  const bool gzip = EndsWith(path, ".gz");
  if (!gzip && !EndsWith(path, ".bz2")) {
    *source = std::move(file);
    return Status::Ok();
  }
  // Kept before the decoder takes the file over, whose address stays.
  const FileSource& packed = *file;
  std::unique_ptr<ByteSource> decoder =
      gzip ? MakeGzipSource(std::move(file)) : MakeBzip2Source(std::move(file));
  *source = std::make_unique<LimitedSource>(packed, std::move(decoder), options.max_unpacked_bytes);
  return Status::Ok();
}

// Where writers of files put their bytes. A file grows under the name `path`.partial and is renamed
// in Finish, which replaces a file of the same name in one step: a reader sees the old file or the
// new one. A sink that is destroyed without Finish, whatever went wrong above it, removes the
// partial file. Encoders (compressed_stream.cc) own the sink below them, so this holds for
// compressed files too.

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
