#include <chrono>
#include <cstdio>
#include <string>
#include <thread>

#include <gtest/gtest.h>

#include "support/temp_dir.h"
#include "tools/command_line/heartbeat.h"
#include "tools/command_line/progress_lines.h"

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

}  // namespace
}  // namespace inceres::tools
