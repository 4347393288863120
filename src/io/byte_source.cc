#include "io/byte_source.h"

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

Status FileSource::Open(const std::string& path, ByteProgress progress) {
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
                      ByteProgress progress, const ReadOptions& options) {
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

}  // namespace inceres::internal
