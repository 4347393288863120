#include "io/byte_source.h"

#include <cerrno>
#include <filesystem>
#include <system_error>
#include <utility>

namespace inceres::internal {

std::string SystemError() {
  return std::generic_category().message(errno);
}

bool EndsWith(const std::string& text, const std::string& suffix) {
  return text.size() >= suffix.size() && text.compare(text.size() - suffix.size(), suffix.size(), suffix) == 0;
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
  std::error_code no_regular_file;
  const std::uintmax_t size = std::filesystem::file_size(path, no_regular_file);
  file_bytes_ = no_regular_file ? 0 : static_cast<std::int64_t>(size);
  std::setvbuf(file_, nullptr, _IONBF, 0);  // our callers read large pieces
  return Status::Ok();
}

Status FileSource::Read(char* buffer, std::size_t capacity, std::size_t* size) {
  *size = std::fread(buffer, 1, capacity, file_);
  if (*size == 0 && std::ferror(file_) != 0) {
    return Status::Error(StatusCode::kIo, "cannot read: " + SystemError());
  }
  bytes_read_ += static_cast<std::int64_t>(*size);
  if (progress_) {
    progress_(bytes_read_, file_bytes_);
  }
  return Status::Ok();
}

Status OpenByteSource(const std::string& path, std::unique_ptr<ByteSource>* source, ByteProgress progress) {
  auto file = std::make_unique<FileSource>();
  if (Status status = file->Open(path, std::move(progress)); !status.ok()) {
    return status;
  }
  if (EndsWith(path, ".gz")) {
    *source = MakeGzipSource(std::move(file));
  } else if (EndsWith(path, ".bz2")) {
    *source = MakeBzip2Source(std::move(file));
  } else {
    *source = std::move(file);
  }
  return Status::Ok();
}

}  // namespace inceres::internal
