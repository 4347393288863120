#include <cmath>
#include <limits>
#include <string>
#include <vector>

#include <gtest/gtest.h>

#include "inceres/io/bal.h"
#include "support/temp_dir.h"
#include "support/test_data.h"

namespace inceres {
namespace {

using test::TempDir;
using test::WriteBytes;

// Two cameras, one point, two observations; one line per observation and one per number.
const char kSmall[] =
    "2 1 2\n"
    "0 0 -1.5 2.5e1\n"
    "1 0 3 -4\n"
    "1\n2\n3\n4\n5\n6\n7\n8\n9\n"
    "11\n12\n13\n14\n15\n16\n17\n18\n19\n"
    "0.125\n-0.25\n0.5\n";

std::string Replaced(std::string text, const std::string& what, const std::string& with) {
  const std::size_t place = text.find(what);
  EXPECT_NE(place, std::string::npos) << what;
  return text.replace(place, what.size(), with);
}

class BalReadTest : public ::testing::Test {
 protected:
  Status ReadText(const std::string& text, const std::string& name = "problem.txt") {
    WriteBytes(dir_.File(name), text);
    return ReadBal(dir_.File(name), &problem_);
  }

  // The text must fail, on this line, with this in the message, and leave the output alone.
  void ExpectError(const std::string& text, int line, const std::string& what) {
    problem_ = BalProblem();
    problem_.num_cameras = 77;
    problem_.points = {1.0};
    const Status status = ReadText(text);
    EXPECT_EQ(status.code, StatusCode::kIo) << what;
    const std::string expected =
        dir_.File("problem.txt") + ":" + std::to_string(line) + ": " + what;
    EXPECT_EQ(status.message.substr(0, expected.size()), expected) << status.message;
    EXPECT_EQ(problem_.num_cameras, 77);
    EXPECT_EQ(problem_.points.size(), 1u);
    EXPECT_TRUE(problem_.observations.empty() && problem_.cameras.empty());
  }

  void ExpectSmall() const {
    ASSERT_EQ(problem_.num_cameras, 2);
    ASSERT_EQ(problem_.num_points, 1);
    ASSERT_EQ(problem_.observations.size(), 2u);
    EXPECT_EQ(problem_.observations[0].x, -1.5);
    EXPECT_EQ(problem_.observations[0].y, 25.0);
    EXPECT_EQ(problem_.observations[1].camera, 1);
    EXPECT_EQ(problem_.observations[1].y, -4.0);
    EXPECT_EQ(problem_.CameraData(0)[8], 9.0);
    EXPECT_EQ(problem_.CameraData(1)[0], 11.0);
    EXPECT_EQ(problem_.PointData(0)[2], 0.5);
    EXPECT_TRUE(problem_.Validate().ok());
  }

  TempDir dir_;
  BalProblem problem_;
};

TEST_F(BalReadTest, ReadsText) {
  const Status status = ReadText(kSmall);
  ASSERT_TRUE(status.ok()) << status.message;
  ExpectSmall();
}

TEST_F(BalReadTest, AcceptsAnyWhiteSpaceAndPlus) {
  std::string windows, old_mac, flat;
  for (const char c : std::string(kSmall)) {
    windows += c == '\n' ? "\r\n" : std::string(1, c);
    old_mac += c == '\n' ? '\r' : c;
    flat += c == '\n' ? '\t' : c;
  }
  const std::string variants[] = {windows, old_mac, "  \n\n" + flat + "\n \n",
                                  Replaced(kSmall, "3 -4", "+3 -4.0E+0"),
                                  std::string(kSmall, sizeof(kSmall) - 2)};
  for (const std::string& text : variants) {
    problem_ = BalProblem();
    const Status status = ReadText(text);
    ASSERT_TRUE(status.ok()) << status.message;
    ExpectSmall();
  }
}

TEST_F(BalReadTest, CountsLinesForEveryKindOfLineEnd) {
  std::string windows, old_mac;
  for (const char c : Replaced(kSmall, "16", "x")) {
    windows += c == '\n' ? "\r\n" : std::string(1, c);
    old_mac += c == '\n' ? '\r' : c;
  }
  ExpectError(windows, 18, "camera 1: t z: 'x' is not a number");
  ExpectError(old_mac, 18, "camera 1: t z: 'x' is not a number");
}

TEST_F(BalReadTest, TokensAcrossBufferEndsAreWhole) {
  // A megabyte of blanks and line ends in odd pieces shifts the numbers over every place of the
  // buffer's end.
  for (int shift = 0; shift < 40; ++shift) {
    const std::string text =
        std::string((1 << 18) - 45 + static_cast<std::size_t>(shift), ' ') + kSmall;
    problem_ = BalProblem();
    ASSERT_TRUE(ReadText(text).ok());
    ExpectSmall();
  }
}

TEST_F(BalReadTest, ExtremeNumbers) {
  const std::string tiny = "4.9406564584124654e-324", huge = "-1.7976931348623157e308";
  ASSERT_TRUE(ReadText(Replaced(Replaced(Replaced(kSmall, "-1.5", tiny), "2.5e1", huge), "3 -4",
                                "-1e-400 -0"))
                  .ok());
  EXPECT_EQ(problem_.observations[0].x, std::numeric_limits<double>::denorm_min());
  EXPECT_EQ(problem_.observations[0].y, std::numeric_limits<double>::lowest());
  EXPECT_EQ(problem_.observations[1].x, 0.0);
  EXPECT_TRUE(std::signbit(problem_.observations[1].y));
  ExpectError(Replaced(kSmall, "-1.5", "1e400"), 2, "observation 0: x: '1e400' is too large");
  ExpectError(Replaced(kSmall, "-1.5", "0" + std::string(400, '9')), 2,
              "observation 0: x: '0999999999");
  ExpectError(Replaced(kSmall, "-1.5", "-" + std::string(400, '9')), 2,
              "observation 0: x: '-9999999999");
}

TEST_F(BalReadTest, EveryTruncationIsAnErrorThatNamesTheField) {
  const std::string text(kSmall, sizeof(kSmall) - 2);  // without the last line end
  for (std::size_t size = 0; size < text.size() - 2; ++size) {
    const Status status = ReadText(text.substr(0, size));
    ASSERT_EQ(status.code, StatusCode::kIo) << size;
    ASSERT_NE(status.message.find("the file ends here"), std::string::npos)
        << size << " " << status.message;
  }
  ExpectError("", 1, "number of cameras: missing, the file ends here");
  ExpectError("2 1", 1, "number of observations: missing");
  ExpectError("2 1 2\n0 0 1", 2, "observation 0: y: missing");
  ExpectError(text.substr(0, text.find("17")), 19, "camera 1: f: missing");
  ExpectError(text.substr(0, text.find("-0.25")), 23, "point 0: y: missing");
}

TEST_F(BalReadTest, WrongCounts) {
  ExpectError(Replaced(kSmall, "2 1 2", "-2 1 2"), 1, "number of cameras: -2 is not between 1 and");
  ExpectError(Replaced(kSmall, "2 1 2", "2 0 2"), 1, "number of points: 0 is not between 1 and");
  ExpectError(Replaced(kSmall, "2 1 2", "2 1 99999999999"), 1,
              "number of observations: 99999999999 is not between");
  ExpectError(Replaced(kSmall, "2 1 2", "2 1 1e30"), 1,
              "number of observations: '1e30' is not an integer");
  ExpectError(Replaced(kSmall, "2 1 2", "2 1 2.5"), 1,
              "number of observations: '2.5' is not an integer");
  ExpectError(Replaced(kSmall, "2 1 2", "2 1 99999999999999999999"), 1,
              "number of observations: '99999999999999999999' is too");
  // Too many announced: not allocated up front, and found out where the data no longer fits.
  ExpectError(Replaced(kSmall, "2 1 2", "2 1 2000000000"), 5,
              "observation 2: point: index 2 is not");
}

TEST_F(BalReadTest, IndicesOutOfRange) {
  ExpectError(Replaced(kSmall, "1 0 3", "2 0 3"), 3,
              "observation 1: camera: index 2 is not between 0 and 1");
  ExpectError(Replaced(kSmall, "1 0 3", "-1 0 3"), 3,
              "observation 1: camera: index -1 is not between 0 and 1");
  ExpectError(Replaced(kSmall, "1 0 3", "1 1 3"), 3,
              "observation 1: point: index 1 is not between 0 and 0");
  ExpectError(Replaced(kSmall, "1 0 3", "4294967296 0 3"), 3,
              "observation 1: camera: index 4294967296 is not");
  ExpectError(Replaced(kSmall, "1 0 3", "0.5 0 3"), 3,
              "observation 1: camera: '0.5' is not an integer");
}

TEST_F(BalReadTest, NumbersThatAreNot) {
  for (const char* token : {"nan", "NaN", "-nan", "inf", "-Infinity"}) {
    ExpectError(Replaced(kSmall, "-1.5", token), 2,
                std::string("observation 0: x: '") + token + "' is not a finite number");
  }
  for (const char* token : {"abc", "1.5x", "0x10", "--1", "+-1", "+", "-", "1,5", "1e", "#"}) {
    ExpectError(Replaced(kSmall, "-1.5", token), 2,
                std::string("observation 0: x: '") + token + "' is not a number");
  }
  ExpectError(Replaced(kSmall, "12\n", "nan\n"), 14,
              "camera 1: angle-axis y: 'nan' is not a finite number");
  ExpectError(Replaced(kSmall, "0.125", std::string("\0\x01", 2)), 22,
              "point 0: x: '?\?' is not a number");
  ExpectError(Replaced(kSmall, "0.125", std::string(100000, '1')), 22, "point 0: x: '1111111111");
}

TEST_F(BalReadTest, TrailingData) {
  ExpectError(std::string(kSmall) + "7\n", 25,
              "after the last point (are the counts of the header right?): unexpected '7'");
}

TEST_F(BalReadTest, MissingFileAndDirectory) {
  Status status = ReadBal(dir_.File("no_such.txt"), &problem_);
  EXPECT_EQ(status.code, StatusCode::kIo);
  EXPECT_EQ(status.message,
            dir_.File("no_such.txt") + ": cannot open for reading: No such file or directory");
  status = ReadBal(dir_.path(), &problem_);
  EXPECT_EQ(status.code, StatusCode::kIo);
  EXPECT_NE(status.message.find("directory"), std::string::npos) << status.message;
}

TEST_F(BalReadTest, ProgressIsOfTheFileAndEndsAtItsEnd) {
  const std::string text = std::string(1 << 20, ' ') + kSmall;  // four buffers of it
  WriteBytes(dir_.File("large.txt"), text);
  std::vector<std::int64_t> steps;
  const auto record = [&](std::int64_t bytes_read, std::int64_t file_bytes) {
    EXPECT_EQ(file_bytes, static_cast<std::int64_t>(text.size()));
    EXPECT_GE(bytes_read, steps.empty() ? 1 : steps.back());
    steps.push_back(bytes_read);
  };
  ASSERT_TRUE(ReadBal(dir_.File("large.txt"), &problem_, record).ok());
  ASSERT_GE(steps.size(), 4u);
  EXPECT_LT(steps.front(), static_cast<std::int64_t>(text.size()) / 2);
  EXPECT_EQ(steps.back(), static_cast<std::int64_t>(text.size()));
}

TEST_F(BalReadTest, Ladybug49) {
  const std::string path = test::FindData("bal/problem-49-7776-pre.txt");
  if (path.empty()) {
    GTEST_SKIP() << test::MissingData("bal/problem-49-7776-pre.txt");
  }
  const Status status = ReadBal(path, &problem_);
  ASSERT_TRUE(status.ok()) << status.message;
  EXPECT_EQ(problem_.num_cameras, 49);
  EXPECT_EQ(problem_.num_points, 7776);
  ASSERT_EQ(problem_.observations.size(), 31843u);
  EXPECT_EQ(problem_.observations[0].x, -3.326500e+02);
  EXPECT_TRUE(problem_.Validate().ok());
}

}  // namespace
}  // namespace inceres
