#include "tools/sim/collection_scene.h"

#include <algorithm>
#include <cmath>
#include <string>
#include <vector>

#include <gtest/gtest.h>

#include "tests/sim/bal_checks.h"
#include "tools/sim/heavy_tail.h"

namespace inceres::internal {
namespace {

SimulatedBal Generate(const CollectionOptions& options) {
  SimulatedBal scene;
  const Status status = GenerateCollection(options, nullptr, &scene);
  EXPECT_TRUE(status.ok()) << status.message;
  return scene;
}

CollectionOptions Preset(const char* name) {
  CollectionOptions options;
  const Status status = GetCollectionPreset(name, &options);
  EXPECT_TRUE(status.ok()) << status.message;
  return options;
}

BalProblem TruthOf(SimulatedBal scene) {
  scene.BecomeTruth();
  return scene.problem;
}

TEST(HeavyTail, HasTheMeanAskedFor) {
  const std::vector<int> limits{20, 400};
  const std::vector<std::int64_t> draws{100000, 100000};
  for (const double mean : {2.5, 4.0, 6.5}) {
    const HeavyTail tail(mean, limits, draws);
    EXPECT_NEAR(tail.ExpectedSum(), mean * 200000.0, 1.0);
    Random random(1, 1);
    double sum = 0.0;
    int longest = 0;
    for (const int limit : limits) {
      for (int i = 0; i < 100000; ++i) {
        const int length = tail.Draw(limit, &random);
        ASSERT_GE(length, 2);
        ASSERT_LE(length, limit);
        longest = std::max(longest, length);
        sum += length;
      }
    }
    EXPECT_NEAR(sum / 200000.0, mean, 0.15);
    EXPECT_GT(longest, mean > 3.0 ? 100 : 40);
  }
}

TEST(CollectionScene, LargestPresetHasTheCountsOfTheLargestPublicProblem) {
  const CollectionOptions options = Preset("collection-13682");
  EXPECT_EQ(options.num_cameras, 13682);
  EXPECT_EQ(options.num_points, 4456117);
  EXPECT_EQ(options.num_observations, 28987644);
}

TEST(CollectionScene, ObservationsAPointGrowWithTheCollection) {
  double last = 0.0;
  for (const char* name : {"collection-20", "collection-100", "collection-1000", "collection-3420",
                           "collection-13682", "collection-100000"}) {
    const CollectionOptions options = Preset(name);
    const double mean = static_cast<double>(options.num_observations) / options.num_points;
    EXPECT_GE(mean, std::max(2.9, last - 1e-4)) << name;  // counts are whole
    EXPECT_LE(mean, 6.51) << name;
    EXPECT_NEAR(static_cast<double>(options.num_points) / options.num_cameras, 325.7, 0.1);
    last = mean;
  }
}

TEST(CollectionScene, IsWellPosedWithExactCounts) {
  for (const char* name : {"collection-20", "collection-60", "collection-300"}) {
    CollectionOptions options = Preset(name);
    for (const std::uint64_t seed : {1u, 2u, 3u}) {
      SCOPED_TRACE(std::string(name) + ", seed " + std::to_string(seed));
      options.seed = seed;
      const SimulatedBal scene = Generate(options);
      EXPECT_EQ(scene.problem.num_cameras, options.num_cameras);
      EXPECT_EQ(scene.problem.num_points, options.num_points);
      EXPECT_EQ(static_cast<int>(scene.problem.observations.size()), options.num_observations);
      EXPECT_STREQ(WhatIsWrong(scene.problem, TruthOf(scene)), "");
    }
  }
}

TEST(CollectionScene, SameSeedSameBitsOnEveryPlatform) {
  // Recorded once: the presets are what results are quoted for.
  EXPECT_EQ(HashOf(Generate(Preset("collection-60")).problem), 12890558885743791895u);
}

TEST(CollectionScene, TracksHaveAHeavyTail) {
  const SimulatedBal scene = Generate(Preset("collection-1000"));
  std::vector<int> lengths(static_cast<std::size_t>(scene.problem.num_points));
  for (const BalObservation& observation : scene.problem.observations) {
    ++lengths[static_cast<std::size_t>(observation.point)];
  }
  std::sort(lengths.begin(), lengths.end());
  const std::size_t n = lengths.size();
  EXPECT_LE(lengths[n / 2], 3) << "half of all tracks are short";
  EXPECT_GT(lengths[n - n / 100], 20) << "one of a hundred is long";
  EXPECT_GT(lengths[n - n / 10000], 30);
}

TEST(CollectionScene, WhoSeesAPointIsRandomAmongThoseAtTheSight) {
  const SimulatedBal scene = Generate(Preset("collection-300"));
  int far = 0;
  const auto pairs = CovisiblePairs(scene.problem);
  for (const auto& [i, j] : pairs) {
    far += j - i > 100 ? 1 : 0;
  }
  EXPECT_GT(far, static_cast<int>(pairs.size()) / 3) << "the order of the cameras says nothing";
}

TEST(CollectionScene, RefusesWhatItCannotMake) {
  SimulatedBal scene;
  CollectionOptions options = Preset("collection-20");
  options.num_observations = 15 * options.num_points;
  const Status status = GenerateCollection(options, nullptr, &scene);
  EXPECT_EQ(status.code, StatusCode::kInvalidArgument);
  EXPECT_NE(status.message.find("ask for fewer observations per point"), std::string::npos);
  EXPECT_EQ(scene.problem.num_cameras, 0) << "unchanged";
  EXPECT_EQ(GetCollectionPreset("collection-5", &options).message,
            "CollectionOptions: num_cameras is 5, not between 20 and 1000000");
}

}  // namespace
}  // namespace inceres::internal
