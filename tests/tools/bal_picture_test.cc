#include "tools/draw/bal_picture.h"

#include <gtest/gtest.h>

#include "tests/tools/small_problems.h"

namespace inceres::tools {
namespace {

int Count(const std::string& text, const std::string& pattern) {
  int count = 0;
  for (std::size_t at = text.find(pattern); at != std::string::npos;
       at = text.find(pattern, at + 1)) {
    ++count;
  }
  return count;
}

TEST(BalPictureSvg, DrawsEveryCameraTwiceAndEveryIteration) {
  const BalProblem bal = SmallBal(7);
  const std::string svg =
      BalPictureSvg("small", bal, bal, {{0.0, 100.0, true}, {0.1, 50.0, true}, {0.2, 60.0, false}});
  EXPECT_EQ(Count(svg, "class=\"camera\""), 14);
  EXPECT_EQ(Count(svg, "class=\"accepted\""), 2);
  EXPECT_EQ(Count(svg, "class=\"rejected\""), 1);
  EXPECT_EQ(svg.find("nan"), std::string::npos);
  EXPECT_EQ(svg.find("inf"), std::string::npos);
}

TEST(BalPictureSvg, EscapesTheTitle) {
  const std::string svg = BalPictureSvg("a<b & c>d", SmallBal(), SmallBal(), {});
  EXPECT_NE(svg.find("a&lt;b &amp; c&gt;d"), std::string::npos);
}

TEST(BalPictureSvg, DegenerateScenesHaveFiniteCoordinates) {
  BalProblem bal = SmallBal(2, 3);
  std::fill(bal.points.begin(), bal.points.end(), 1.0);
  std::copy_n(bal.CameraData(0), 9,
              bal.CameraData(1));  // both cameras in one place: no direction, no spread
  const std::string svg = BalPictureSvg("flat", bal, bal, {{0.0, 0.0, true}});
  EXPECT_EQ(svg.find("nan"), std::string::npos) << svg;
  EXPECT_EQ(svg.find("inf"), std::string::npos) << svg;
}

}  // namespace
}  // namespace inceres::tools
