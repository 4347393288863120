#include "tools/command_line/read_progress.h"

#include <cstdio>
#include <string>

#include <gtest/gtest.h>

#include "support/temp_dir.h"

namespace inceres::tools {
namespace {

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
