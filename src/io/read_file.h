#pragma once

#include <memory>
#include <string>
#include <utility>

#include "inceres/status.h"
#include "io/byte_source.h"

namespace inceres::internal {

/// Reads a whole file, decoded as its name asks for, with Reader(path, source).Read(result). All or
/// nothing: after a failure *result is as it was.
template <typename Reader, typename Result>
Status ReadFile(const std::string& path, Result* result, const ReadOptions& options,
                const ByteProgress& progress = nullptr) {
  std::unique_ptr<ByteSource> source;
  if (Status status = OpenByteSource(path, &source, progress, options); !status.ok()) {
    return status;
  }
  Result read;
  if (Status status = Reader(path, std::move(source)).Read(&read); !status.ok()) {
    return status;
  }
  *result = std::move(read);
  return Status::Ok();
}

}  // namespace inceres::internal
