#include <algorithm>
#include <cmath>
#include <limits>
#include <numeric>
#include <string>
#include <vector>

#include <gtest/gtest.h>

#include "tests/tools/small_problems.h"
#include "tools/draw/bal_picture.h"
#include "tools/draw/error_histogram.h"

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

std::size_t Sum(const std::vector<std::size_t>& counts) {
  return std::accumulate(counts.begin(), counts.end(), std::size_t{0});
}

TEST(ErrorHistogram, EveryValueIsInTheBinOfItsSize) {
  const ErrorHistogram histogram = SortErrors({1.0, 10.0, 99.0}, {1.5, 1.5, 30.0}, 2);
  ASSERT_EQ(histogram.edges.size(), 3U);
  EXPECT_DOUBLE_EQ(histogram.edges[0], 1.0);
  EXPECT_NEAR(histogram.edges[1], std::sqrt(99.0), 1e-12);
  EXPECT_NEAR(histogram.edges[2], 99.0, 1e-12);
  EXPECT_EQ(histogram.before, (std::vector<std::size_t>{1, 2}));
  EXPECT_EQ(histogram.after, (std::vector<std::size_t>{2, 1}));
}

TEST(ErrorHistogram, ZerosDoNotStretchTheAxis) {
  const ErrorHistogram histogram = SortErrors({0.0, 5.0}, {0.0, 1.0, 2.0}, 10);
  EXPECT_DOUBLE_EQ(histogram.edges.front(), 1e-3);
  EXPECT_EQ(histogram.before.front(), 1U);
  EXPECT_EQ(Sum(histogram.after), 3U);
}

TEST(ErrorHistogram, WhatIsNotFiniteIsCountedApart) {
  const double nan = std::numeric_limits<double>::quiet_NaN();
  const ErrorHistogram histogram = SortErrors({nan, HUGE_VAL, 2.0}, {3.0}, 4);
  EXPECT_EQ(histogram.not_finite, 2U);
  EXPECT_EQ(Sum(histogram.before), 1U);
}

TEST(ErrorHistogram, OfNothingOrAllAlikeHasFiniteCoordinates) {
  for (const std::vector<double>& values :
       {std::vector<double>{}, std::vector<double>{0.0, 0.0}, std::vector<double>{HUGE_VAL}}) {
    const ErrorHistogram histogram = SortErrors(values, values, 5);
    const std::string svg = ErrorHistogramShapes(histogram, {10.0, 10.0, 300.0, 200.0}, 3);
    EXPECT_EQ(svg.find("nan"), std::string::npos) << svg;
    EXPECT_EQ(svg.find("inf"), std::string::npos) << svg;
  }
}

TEST(ErrorSpread, IsOfTheFiniteOnesByNearestRank) {
  std::vector<double> errors(100);
  std::iota(errors.rbegin(), errors.rend(), 1.0);
  errors.push_back(HUGE_VAL);
  const ErrorSpread spread = SpreadOf(errors);
  EXPECT_EQ(spread.median, 50.0);
  EXPECT_EQ(spread.p95, 95.0);
  EXPECT_EQ(spread.max, 100.0);
}

}  // namespace
}  // namespace inceres::tools
