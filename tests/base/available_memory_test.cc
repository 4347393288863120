// What control groups leave: the tightest of a process's own group and those around it.
#include "base/available_memory.h"

#include <cmath>
#include <filesystem>
#include <string>

#include <gtest/gtest.h>

#include "support/temp_dir.h"

namespace inceres::internal {
namespace {

class ControlGroups : public ::testing::Test {
 protected:
  // The group of a path like "/a/b", "" for the root.
  void AddGroup(const std::string& path, const std::string& limit, const std::string& anon) {
    std::filesystem::create_directories(dir_.path() + path);
    test::WriteBytes(dir_.path() + path + "/memory.max", limit + "\n");
    test::WriteBytes(dir_.path() + path + "/memory.stat",
                     "file 900000\nanon " + anon + "\nanon_thp 5\n");
  }
  double LeftIn(const std::string& lines) {
    test::WriteBytes(dir_.File("membership"), lines);
    return LeftOfControlGroups(dir_.File("membership"), dir_.path());
  }

  test::TempDir dir_;
};

TEST_F(ControlGroups, TheTightestAroundTheProcessBinds) {
  AddGroup("/slice", "5000", "1000");
  AddGroup("/slice/service", "max", "200");
  AddGroup("/slice/service/main", "9000", "100");
  EXPECT_EQ(LeftIn("0::/slice/service/main\n"), 4000.0);
  EXPECT_EQ(LeftIn("0::/slice/service\n"), 4000.0) << "it has no limit of its own";
  AddGroup("/slice/service/main", "3000", "100");
  EXPECT_EQ(LeftIn("0::/slice/service/main\n"), 2900.0);
  AddGroup("", "1500", "1000");
  EXPECT_EQ(LeftIn("0::/slice/service/main\n"), 500.0) << "that of a container";
  EXPECT_EQ(LeftIn("0::/\n"), 500.0);
}

TEST_F(ControlGroups, WithoutALimitThereIsNone) {
  AddGroup("/slice", "max", "1000");
  EXPECT_TRUE(std::isinf(LeftIn("0::/slice\n")));
  EXPECT_TRUE(std::isinf(LeftIn("0::/not/there\n")));
  EXPECT_TRUE(std::isinf(LeftIn("")));
  AddGroup("/slice", "7000", "1000");
  EXPECT_TRUE(std::isinf(LeftIn("4:memory:/slice\n"))) << "a line of version 1";
  EXPECT_EQ(LeftIn("4:memory:/other\n0::/slice\n"), 6000.0);
}

}  // namespace
}  // namespace inceres::internal
