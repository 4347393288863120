#include "tools/command_line/text_file.h"

#include <cerrno>
#include <cstdio>
#include <cstring>
#include <filesystem>

namespace inceres::tools {

Status WriteTextFile(const std::string& path, const std::string& text, const char* how) {
  std::FILE* file = std::fopen(path.c_str(), how);
  if (file == nullptr) {
    return Status::Error(StatusCode::kIo, path + ": " + std::strerror(errno));
  }
  const bool written = std::fwrite(text.data(), 1, text.size(), file) == text.size();
  const int write_error = errno;
  const bool closed = std::fclose(file) == 0;
  if (written && closed) {
    return Status::Ok();
  }
  Status failure =
      Status::Error(StatusCode::kIo, path + ": " + std::strerror(written ? errno : write_error));
  std::error_code error;
  if (*how == 'w' && std::filesystem::is_regular_file(path, error)) {  // not a device
    std::filesystem::remove(path, error);
  }
  return failure;
}

}  // namespace inceres::tools
