// Files made to hurt: small ones that unpack to large ones, and words that belong in no message.
#include <filesystem>
#include <functional>
#include <memory>

#include <gtest/gtest.h>

#include "inceres/io/bal.h"
#include "inceres/io/g2o.h"
#include "inceres/io/keyframes.h"
#include "inceres/io/planar_map.h"
#include "inceres/io/vio_sequence.h"
#include "io/byte_sink.h"
#include "support/temp_dir.h"

namespace inceres {
namespace {

using Reader = std::function<Status(const std::string& path, const ReadOptions& options)>;

template <typename Result>
Reader ReaderOf(Status (*read)(const std::string&, Result*, const ReadOptions&)) {
  return [read](const std::string& path, const ReadOptions& options) {
    Result result;
    return read(path, &result, options);
  };
}

Status ReadAnyBal(const std::string& path, const ReadOptions& options) {
  BalProblem problem;
  return ReadBal(path, &problem, nullptr, options);
}

std::vector<Reader> TaggedReaders() {
  return {ReaderOf(ReadG2o), ReaderOf(ReadKeyframes), ReaderOf(ReadPlanarMap),
          ReaderOf(ReadVioSequence)};
}

std::vector<Reader> AllReaders() {
  std::vector<Reader> readers = TaggedReaders();
  readers.push_back(ReadAnyBal);
  return readers;
}

// As many blanks, behind which nothing comes.
void WriteBlanks(const std::string& path, std::int64_t count) {
  const std::string piece(1 << 20, ' ');
  std::unique_ptr<internal::ByteSink> sink;
  ASSERT_TRUE(internal::OpenByteSink(path, &sink).ok());
  for (; count > 0; count -= static_cast<std::int64_t>(piece.size())) {
    ASSERT_TRUE(sink->Write(piece.data(), piece.size()).ok());
  }
  ASSERT_TRUE(sink->Finish().ok());
}

void ExpectRefused(const Status& status, const std::string& path, const std::string& limit) {
  EXPECT_EQ(status.code, StatusCode::kIo);
  EXPECT_EQ(status.message.rfind(path + ":", 0), 0U) << status.message;
  EXPECT_NE(status.message.find("unpacks to more than " + limit + " bytes"), std::string::npos)
      << status.message;
  EXPECT_NE(status.message.find("max_unpacked_bytes"), std::string::npos) << status.message;
}

TEST(UnpackLimit, ASmallFileThatUnpacksToALargeOneIsRefused) {
  const test::TempDir directory;
  const std::string path = directory.File("blanks.gz");
  WriteBlanks(path, std::int64_t{66} << 20);
  ASSERT_LT(std::filesystem::file_size(path), 100000U);
  ExpectRefused(ReadAnyBal(path, ReadOptions()), path, "67108864");
}

TEST(UnpackLimit, IsTheCallers) {
  const test::TempDir directory;
  for (const char* name : {"blanks.gz", "blanks.bz2"}) {
    const std::string path = directory.File(name);
    WriteBlanks(path, std::int64_t{3} << 20);
    ReadOptions options;
    for (const Reader& read : AllReaders()) {
      options.max_unpacked_bytes = 1000;
      ExpectRefused(read(path, options), path, "1000");
      for (const std::int64_t enough : {std::int64_t{3} << 20, std::int64_t{0}, INT64_MAX}) {
        options.max_unpacked_bytes = enough;
        const Status status = read(path, options);  // a file of blanks is none of these
        EXPECT_EQ(status.code, StatusCode::kIo);
        EXPECT_EQ(status.message.find("unpacks"), std::string::npos) << status.message;
      }
      options.max_unpacked_bytes = -1;
      EXPECT_EQ(read(path, options).code, StatusCode::kInvalidArgument);
    }
  }
}

// What is not compressed is as large as it is.
TEST(UnpackLimit, IsNotOfPlainText) {
  const test::TempDir directory;
  const std::string path = directory.File("blanks.txt");
  WriteBlanks(path, 1 << 20);
  ReadOptions options;
  options.max_unpacked_bytes = 1000;
  EXPECT_EQ(ReadAnyBal(path, options).message.find("unpacks"), std::string::npos);
}

TEST(UnpackLimit, AProblemIsReadUpToIt) {
  const test::TempDir directory;
  BalProblem problem;
  problem.num_cameras = problem.num_points = 1;
  problem.observations = {{0, 0, 1.0, 2.0}};
  problem.cameras.assign(9, 0.5);
  problem.points.assign(3, 0.25);
  ASSERT_TRUE(WriteBal(directory.File("plain.txt"), problem).ok());
  const auto size =
      static_cast<std::int64_t>(std::filesystem::file_size(directory.File("plain.txt")));
  for (const char* name : {"problem.gz", "problem.bz2"}) {
    const std::string path = directory.File(name);
    ASSERT_TRUE(WriteBal(path, problem).ok());
    ReadOptions options;
    options.max_unpacked_bytes = size;
    EXPECT_TRUE(ReadAnyBal(path, options).ok());
    options.max_unpacked_bytes = size - 1;
    ExpectRefused(ReadAnyBal(path, options), path, std::to_string(size - 1));
  }
}

TEST(UnknownTag, IsCutAndCleaned) {
  const test::TempDir directory;
  const std::string path = directory.File("tags.txt");
  const std::string bell = "\x07\x1b[31mTAG\xc3\xa9";
  for (const std::string& tag :
       {std::string(1 << 20, 'x'), bell, bell + std::string(1 << 20, '\x01')}) {
    for (const std::string& begin : {std::string(), std::string("VIO 1\n")}) {
      test::WriteBytes(path, begin + tag + " 1 2 3\n");
      for (const Reader& read : TaggedReaders()) {
        const std::string message = read(path, ReadOptions()).message;
        EXPECT_LT(message.size(), path.size() + 200);
        for (const char c : message) {
          ASSERT_TRUE(c >= ' ' && c <= '~') << message;
        }
      }
    }
  }
  test::WriteBytes(path, bell + " 1 2 3\n");
  EXPECT_EQ(ReaderOf(ReadG2o)(path, ReadOptions()).message,
            path +
                ":1: ??[31mTAG??: tag: not known; known are VERTEX_SE2, EDGE_SE2, VERTEX_SE3:QUAT, "
                "EDGE_SE3:QUAT and FIX");
}

}  // namespace
}  // namespace inceres
