#include "io/byte_source.h"

#include <cerrno>
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

Status FileSource::Open(const std::string& path) {
  file_ = std::fopen(path.c_str(), "rb");
  if (file_ == nullptr) {
    return Status::Error(StatusCode::kIo, path + ": cannot open for reading: " + SystemError());
  }
  std::setvbuf(file_, nullptr, _IONBF, 0);  // our callers read large pieces
  return Status::Ok();
}

Status FileSource::Read(char* buffer, std::size_t capacity, std::size_t* size) {
  *size = std::fread(buffer, 1, capacity, file_);
  if (*size == 0 && std::ferror(file_) != 0) {
    return Status::Error(StatusCode::kIo, "cannot read: " + SystemError());
  }
  return Status::Ok();
}

Status OpenByteSource(const std::string& path, std::unique_ptr<ByteSource>* source) {
  auto file = std::make_unique<FileSource>();
  if (Status status = file->Open(path); !status.ok()) {
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
