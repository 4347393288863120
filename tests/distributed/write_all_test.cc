// Bytes are written to the end, whatever single calls do.
#include <algorithm>
#include <cerrno>
#include <string>
#include <vector>

#include <gtest/gtest.h>

#include "distributed/checkpoint.h"

namespace inceres::internal {
namespace {

const std::vector<char> kBytes = {'a', 'b', 'c', 'd', 'e', 'f', 'g'};
constexpr std::int64_t kOffset = 3;

// A file in memory whose k-th call writes at most answers[k] bytes, or fails with −answers[k].
class Disk {
 public:
  explicit Disk(std::vector<int> answers) : answers_(std::move(answers)) {}

  int Write() {
    return WriteAll(kBytes, kOffset, [this](const char* from, std::size_t count, std::int64_t at) {
      const int answer = num_calls_ < answers_.size() ? answers_[num_calls_] : 100;
      ++num_calls_;
      if (answer < 0) {
        errno = -answer;
        return std::int64_t{-1};
      }
      const std::size_t written = std::min(count, static_cast<std::size_t>(answer));
      std::copy_n(from, written, content_.begin() + at);
      return static_cast<std::int64_t>(written);
    });
  }
  const std::string& content() const { return content_; }

 private:
  std::vector<int> answers_;
  std::size_t num_calls_ = 0;
  std::string content_ = "...........";
};

TEST(WriteAll, GoesOnAfterSignalsAndPartOfTheBytes) {
  Disk disk({-EINTR, 2, -EINTR, -EINTR, 1});
  EXPECT_EQ(disk.Write(), 0);
  EXPECT_EQ(disk.content(), "...abcdefg.");
}

TEST(WriteAll, AnErrorIsTold) {
  Disk disk({4, -ENOSPC});
  EXPECT_EQ(disk.Write(), ENOSPC);
}

TEST(WriteAll, NothingWrittenWithoutAReasonIsNoOldError) {
  errno = ENOENT;
  Disk disk({4, 0});
  EXPECT_EQ(disk.Write(), EIO);
}

}  // namespace
}  // namespace inceres::internal
