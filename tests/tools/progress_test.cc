#include <chrono>
#include <cstdio>
#include <string>
#include <thread>

#include <gtest/gtest.h>

#include "support/temp_dir.h"
#include "tools/command_line/heartbeat.h"
#include "tools/command_line/progress_lines.h"
#include "tools/command_line/read_progress.h"

namespace inceres::tools {
namespace {

class ProgressTest : public testing::Test {
 protected:
  void SetUp() override { out_ = std::fopen(path_.c_str(), "w"); }

  // All that was printed.
  std::string Printed() {
    std::fclose(out_);
    return test::ReadBytes(path_);
  }

  test::TempDir dir_;
  std::string path_ = dir_.File("out");
  std::FILE* out_ = nullptr;
};

TEST_F(ProgressTest, NoTextIsMadeBeforeALineIsDue) {
  ProgressLines lines(out_, 1000.0);
  lines([]() -> std::string {
    ADD_FAILURE() << "too early";
    return "";
  });
  EXPECT_EQ(Printed(), "");
}

TEST_F(ProgressTest, ALineEachTimeOneIsDue) {
  ProgressLines lines(out_, 0.0);
  lines([] { return "one of two"; });
  lines([] { return "two of two"; });
  EXPECT_EQ(Printed(), "one of two\ntwo of two\n");
}

TEST_F(ProgressTest, NowhereIsSilent) {
  ProgressLines lines(nullptr, 0.0);
  lines([]() -> std::string {
    ADD_FAILURE() << "nobody listens";
    return "";
  });
  const Heartbeat heartbeat(nullptr, "working", 0.0);
  EXPECT_EQ(Printed(), "");
}

TEST_F(ProgressTest, AHeartbeatBeatsUntilItsEnd) {
  {
    const Heartbeat heartbeat(out_, "working", 0.01);
    std::this_thread::sleep_for(std::chrono::milliseconds(200));
  }
  const std::string printed = Printed();
  EXPECT_EQ(printed.rfind("working: 0 s\nworking: 0 s\n", 0), 0U) << printed;
}

TEST_F(ProgressTest, AHeartbeatOfShortWorkIsSilent) {
  { const Heartbeat heartbeat(out_, "working", 1000.0); }
  EXPECT_EQ(Printed(), "");
}

class ReadProgressTest : public testing::Test {
 protected:
  // What a printer says of three pieces of a file.
  std::string Printed(double every_seconds, std::int64_t file_bytes) {
    const std::string path = dir_.File("out");
    std::FILE* out = std::fopen(path.c_str(), "w");
    ReadProgressPrinter printer("big.txt", out, every_seconds);
    for (const std::int64_t bytes : {1000000, 2000000, 4000000}) {
      printer(bytes, file_bytes);
    }
    std::fclose(out);
    return test::ReadBytes(path);
  }
  test::TempDir dir_;
};

TEST_F(ReadProgressTest, NothingBeforeItsTime) {
  EXPECT_EQ(Printed(1000.0, 4000000), "");
}

TEST_F(ReadProgressTest, ShareOfTheFile) {
  EXPECT_EQ(Printed(0.0, 4000000),
            "reading big.txt: 25 % of 4 MB\nreading big.txt: 50 % of 4 MB\nreading big.txt: 100 % "
            "of 4 MB\n");
}

TEST_F(ReadProgressTest, OfAPipeOnlyWhatCame) {
  EXPECT_EQ(Printed(0.0, 0),
            "reading big.txt: 1 MB\nreading big.txt: 2 MB\nreading big.txt: 4 MB\n");
}

}  // namespace
}  // namespace inceres::tools
