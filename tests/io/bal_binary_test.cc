// The binary form of BAL files: the same problem to the bit, in shares too; what is not whole is
// refused.
#include "io/bal_binary.h"

#include <algorithm>
#include <cstdint>
#include <cstring>
#include <filesystem>
#include <random>
#include <string>
#include <vector>

#include <gtest/gtest.h>

#include "support/temp_dir.h"

namespace inceres {
namespace {

BalProblem RandomProblem(int num_cameras, int num_points, int num_observations) {
  std::mt19937_64 random(3);
  std::uniform_real_distribution<double> number(-1.0, 1.0);
  BalProblem bal;
  bal.num_cameras = num_cameras;
  bal.num_points = num_points;
  for (int i = 0; i < num_observations; ++i) {
    bal.observations.push_back({static_cast<int>(random() % static_cast<unsigned>(num_cameras)),
                                static_cast<int>(random() % static_cast<unsigned>(num_points)),
                                number(random), number(random)});
  }
  for (int i = 0; i < 9 * num_cameras; ++i) {
    bal.cameras.push_back(number(random));
  }
  for (int i = 0; i < 3 * num_points; ++i) {
    bal.points.push_back(number(random));
  }
  return bal;
}

void ExpectSame(const BalProblem& a, const BalProblem& b) {
  EXPECT_EQ(a.num_cameras, b.num_cameras);
  EXPECT_EQ(a.num_points, b.num_points);
  EXPECT_EQ(a.cameras, b.cameras);
  EXPECT_EQ(a.points, b.points);
  ASSERT_EQ(a.observations.size(), b.observations.size());
  EXPECT_EQ(std::memcmp(a.observations.data(), b.observations.data(),
                        a.observations.size() * sizeof(BalObservation)),
            0);
}

TEST(BalBinary, ReadsWhatWasWritten) {
  const test::TempDir dir;
  const BalProblem bal = RandomProblem(11, 5000, 20000);
  ASSERT_TRUE(WriteBal(dir.File("a.balb"), bal).ok());
  BalProblem read;
  const Status status = ReadBal(dir.File("a.balb"), &read);
  ASSERT_TRUE(status.ok()) << status.message;
  ExpectSame(read, bal);
}

TEST(BalBinary, ProgressRisesToTheBytesOfTheFile) {
  const test::TempDir dir;
  ASSERT_TRUE(WriteBal(dir.File("a.balb"), RandomProblem(11, 5000, 20000)).ok());
  const auto size = static_cast<std::int64_t>(std::filesystem::file_size(dir.File("a.balb")));
  std::vector<std::int64_t> told;
  BalProblem read;
  const Status status =
      ReadBal(dir.File("a.balb"), &read, [&](std::int64_t bytes_read, std::int64_t file_bytes) {
        EXPECT_EQ(file_bytes, size);
        told.push_back(bytes_read);
      });
  ASSERT_TRUE(status.ok()) << status.message;
  EXPECT_EQ(told.size(), 8U) << "blocks of 4,096 records: five, one, and two";
  EXPECT_TRUE(std::is_sorted(told.begin(), told.end()));
  ASSERT_FALSE(told.empty());
  EXPECT_EQ(told.back(), size);
}

void Append(const internal::BalShare& share, BalProblem* bal) {
  if (!share.observations.empty()) {
    EXPECT_EQ(share.first_observation, static_cast<std::int64_t>(bal->observations.size()));
  }
  bal->observations.insert(bal->observations.end(), share.observations.begin(),
                           share.observations.end());
  bal->cameras.insert(bal->cameras.end(), share.cameras.begin(), share.cameras.end());
  bal->points.insert(bal->points.end(), share.points.begin(), share.points.end());
}

TEST(BalBinary, SharesTogetherAreAll) {
  const test::TempDir dir;
  const BalProblem bal = RandomProblem(9, 9000, 30000);
  ASSERT_TRUE(WriteBal(dir.File("a.balb"), bal).ok());
  for (const int num_parts : {1, 2, 3, 5, 40}) {
    BalProblem joined;
    joined.num_cameras = bal.num_cameras;
    joined.num_points = bal.num_points;
    for (int part = 0; part < num_parts; ++part) {
      internal::BalBinaryFile file;
      internal::BalShare share;
      ASSERT_TRUE(file.Open(dir.File("a.balb")).ok());
      ASSERT_TRUE(file.ReadShare(part, num_parts, &share).ok());
      Append(share, &joined);
    }
    ExpectSame(joined, bal);
  }
}

TEST(BalBinary, WhatIsNotWholeIsRefused) {
  const test::TempDir dir;
  const std::string path = dir.File("a.balb");
  ASSERT_TRUE(WriteBal(path, RandomProblem(3, 20, 50)).ok());
  const std::string whole = test::ReadBytes(path);
  const auto message_of = [&](const std::string& bytes) {
    test::WriteBytes(path, bytes);
    BalProblem read = RandomProblem(1, 1, 1);
    const Status status = ReadBal(path, &read);
    EXPECT_EQ(status.code, StatusCode::kIo);
    EXPECT_EQ(read.num_points, 1);
    EXPECT_EQ(status.message.find(path), 0U);
    return status.message;
  };
  EXPECT_NE(message_of(whole.substr(0, 30)).find("too short"), std::string::npos);
  EXPECT_NE(message_of(whole.substr(0, whole.size() - 1)).find("its counts ask for"),
            std::string::npos);
  EXPECT_NE(message_of("3 20 50\n" + whole).find("is no binary BAL file"), std::string::npos);
  std::string flipped = whole;
  flipped.back() = static_cast<char>(flipped.back() ^ 1);
  EXPECT_NE(message_of(flipped).find("checksum of the points from 0 on"), std::string::npos);
  // A count that would ask for 48 GiB.
  std::string huge = whole;
  const std::int64_t count = 2147483647;
  std::memcpy(huge.data() + 32, &count, sizeof count);
  EXPECT_NE(message_of(huge).find("its counts ask for"), std::string::npos);
}

TEST(BalBinary, MutationsAreRefused) {
  const test::TempDir dir;
  const std::string path = dir.File("a.balb");
  ASSERT_TRUE(WriteBal(path, RandomProblem(3, 20, 50)).ok());
  const std::string whole = test::ReadBytes(path);
  std::mt19937_64 random(5);
  for (int trial = 0; trial < 300; ++trial) {
    std::string mutated = whole;
    const std::size_t at = random() % mutated.size();
    mutated[at] = static_cast<char>(mutated[at] ^ static_cast<char>(1 + random() % 255));
    if (random() % 4 == 0) {
      mutated.resize(random() % mutated.size());
    }
    test::WriteBytes(path, mutated);
    BalProblem read;
    EXPECT_EQ(ReadBal(path, &read).code, StatusCode::kIo) << "byte " << at;
  }
}

}  // namespace
}  // namespace inceres
