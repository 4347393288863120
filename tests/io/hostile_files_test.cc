// Files made to hurt: small ones that unpack to large ones, and words that belong in no message.
#include <algorithm>
#include <filesystem>
#include <functional>
#include <memory>
#include <utility>

#include <gtest/gtest.h>

#include "inceres/io/bal.h"
#include "inceres/io/g2o.h"
#include "inceres/io/keyframes.h"
#include "inceres/io/planar_map.h"
#include "inceres/io/vio_sequence.h"
#include "io/byte_stream.h"
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

void WriteText(const std::string& path, const std::string& text) {
  std::unique_ptr<internal::ByteSink> sink;
  ASSERT_TRUE(internal::OpenByteSink(path, &sink).ok());
  ASSERT_TRUE(sink->Write(text.data(), text.size()).ok());
  ASSERT_TRUE(sink->Finish().ok());
}

// A file of good lines, as many as wanted: behind the head, line i is before, i, behind.
struct TaggedLines {
  Reader read;
  std::string head, before, behind;

  std::string Text(int count) const {
    std::string text = head;
    for (int i = 0; i < count; ++i) {
      text += before + std::to_string(i) + behind + "\n";
    }
    return text;
  }
};

std::vector<TaggedLines> AllTaggedLines() {
  return {{ReaderOf(ReadG2o), "", "VERTEX_SE2 ", " 0 0 0"},
          {ReaderOf(ReadKeyframes), "", "KEYFRAME ", " 1 0 0 0 1 0 0 0 1 0 0 0"},
          {ReaderOf(ReadPlanarMap), "", "ODOMETRY ", " 1000000 1 0 0 1 0 0 1 0 1"},
          {ReaderOf(ReadVioSequence), "VIO 1\n", "POINT ", " 0 0 0 0 0 0"}};
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

// Lines are good up to the limit, behind which there are more.
TEST(UnpackLimit, IsToldBehindGoodLines) {
  const test::TempDir directory;
  ReadOptions options;
  options.max_unpacked_bytes = 300000;
  for (const char* name : {"lines.gz", "lines.bz2"}) {
    const std::string path = directory.File(name);
    for (const TaggedLines& lines : AllTaggedLines()) {
      WriteText(path, lines.Text(30000));
      ExpectRefused(lines.read(path, options), path, "300000");
    }
  }
}

// Wherever the last piece ends: the first half of a tag is no tag that is not known.
TEST(UnpackLimit, IsToldWhereItCutsAWord) {
  const test::TempDir directory;
  const std::string path = directory.File("lines.gz"), line = "FIX 7\n";
  ReadOptions options;
  options.max_unpacked_bytes = 300000;
  std::string text = "VERTEX_SE2 7 0 0 0\n";
  while (text.size() < 600000) {
    text += line;
  }
  for (std::size_t k = 0; k < line.size(); ++k) {
    WriteText(path, text);
    ExpectRefused(ReaderOf(ReadG2o)(path, options), path, "300000");
    text.insert(0, "\n");
  }
}

// The scanner reads ahead: it knows of the end that is missing while good lines are unread.
TEST(TruncatedFile, IsReadUpToWhereItCannotBe) {
  const test::TempDir directory;
  for (const auto& [name, what] : {std::pair("lines.gz", "the gzip data is truncated"),
                                   std::pair("lines.bz2", "the bzip2 data is truncated")}) {
    const std::string path = directory.File(name);
    for (const TaggedLines& lines : AllTaggedLines()) {
      const std::string text = lines.Text(3);
      WriteText(path, text);
      const std::string bytes = test::ReadBytes(path);
      test::WriteBytes(path, bytes.substr(0, bytes.size() - 4));
      const Status status = lines.read(path, ReadOptions());
      EXPECT_EQ(status.code, StatusCode::kIo);
      const auto num_lines = std::count(text.begin(), text.end(), '\n');
      EXPECT_EQ(status.message, path + ":" + std::to_string(num_lines + 1) + ": tag: " + what);
    }
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
