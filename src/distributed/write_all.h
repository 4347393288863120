#pragma once

#include <cerrno>
#include <cstddef>
#include <cstdint>
#include <vector>

namespace inceres::internal {

/// Repeats a call of POSIX that a signal has interrupted; what it returned at last.
template <typename Call>
auto Uninterrupted(const Call& call) {
  auto result = call();
  while (result < 0 && errno == EINTR) {
    result = call();
  }
  return result;
}

/// Writes all bytes from `offset` on by calls write(bytes, count, offset), which return as pwrite
/// does and may write less than they are asked to. 0, or the errno that ended it: EIO where a call
/// has written nothing and given no reason.
template <typename Write>
int WriteAll(const std::vector<char>& bytes, std::int64_t offset, const Write& write) {
  std::size_t done = 0;
  while (done < bytes.size()) {
    const auto count = Uninterrupted([&] {
      return write(bytes.data() + done, bytes.size() - done,
                   offset + static_cast<std::int64_t>(done));
    });
    if (count <= 0) {
      return count < 0 ? errno : EIO;
    }
    done += static_cast<std::size_t>(count);
  }
  return 0;
}

}  // namespace inceres::internal
