#include "tools/sim/city_scene.h"

#include <algorithm>
#include <cmath>

#include <gtest/gtest.h>

#include "tests/sim/bal_checks.h"
#include "tools/sim/city_grid.h"

namespace inceres::internal {
namespace {

SimulatedBal Generate(const CityOptions& options) {
  SimulatedBal scene;
  const Status status = GenerateCity(options, nullptr, &scene);
  EXPECT_TRUE(status.ok()) << status.message;
  return scene;
}

CityOptions Preset(const char* name) {
  CityOptions options;
  const Status status = GetCityPreset(name, &options);
  EXPECT_TRUE(status.ok()) << status.message;
  return options;
}

BalProblem TruthOf(SimulatedBal scene) {
  scene.BecomeTruth();
  return scene.problem;
}

double Distance(const Vector3& a, const Vector3& b) {
  return std::sqrt(Dot(a - b, a - b));
}

TEST(CityGrid, HousesHideWhatIsBehindThem) {
  const CityGrid grid(3, 16.0, 60.0);  // streets at 0, 76, 152
  const double pi = 3.14159265358979323846;
  EXPECT_NEAR(grid.HitsHouse({0.0, 2.0, -38.0}, {1.0, 0.0, 0.0}), 8.0, 1e-12) << "a facade";
  EXPECT_NEAR(grid.HitsHouse({0.0, 2.0, -38.0}, {0.0, 0.1, -2.0}), (160.0 - 38.0) / 2.0, 1e-12)
      << "along the street, to where the city ends";
  EXPECT_NEAR(grid.HitsHouse({0.0, 2.0, 0.0}, {1.0, 0.0, -1.0}), 8.0, 1e-12) << "a corner";
  EXPECT_NEAR(grid.HitsHouse({76.0, 2.0, -38.0}, {0.5, 0.0, 0.0}), 16.0, 1e-12);
  for (int i = 0; i < 360; ++i) {  // whatever the direction, it ends at a facade
    const Vector3 direction{std::cos(i * pi / 180.0), 0.0, std::sin(i * pi / 180.0)};
    const double t = grid.HitsHouse({78.0, 2.0, -81.0}, direction);
    EXPECT_GT(t, 1.0);
    EXPECT_LT(t, 100.0);
  }
}

TEST(CityGrid, LocateIsContinuousAlongAStreetAndAroundACorner) {
  const CityGrid grid(3, 16.0, 60.0);
  const auto blend = [&](const Vector3& place) {  // of the places of the crossings
    Crossing a, b;
    double share = 0.0;
    grid.Locate(place, &a, &b, &share);
    return (1.0 - share) * grid.Place(a) + share * grid.Place(b);
  };
  Vector3 last = blend({0.0, 0.0, 0.0});
  for (int i = 0; i <= 152; ++i) {  // to the north, then to the east
    const Vector3 place{std::max(0.0, i - 76.0), 0.0, -std::min(76.0, 1.0 * i)};
    const Vector3 now = blend(place);
    EXPECT_LT(Distance(now, last), 1.3);
    EXPECT_LT(Distance(now, place), 8.0 + 1e-9);
    last = now;
  }
  EXPECT_EQ(last, (Vector3{76.0, 0.0, -76.0}));
}

TEST(CityScene, IsWellPosedInManySizes) {
  for (const char* name : {"city-50", "city-200", "city-1000"}) {
    CityOptions options = Preset(name);
    for (const std::uint64_t seed : {1u, 2u, 3u}) {
      SCOPED_TRACE(std::string(name) + ", seed " + std::to_string(seed));
      options.seed = seed;
      const SimulatedBal scene = Generate(options);
      EXPECT_EQ(scene.problem.num_cameras, options.num_cameras);
      EXPECT_EQ(scene.problem.num_points, 20 * options.num_cameras);
      EXPECT_STREQ(WhatIsWrong(scene.problem, TruthOf(scene)), "");
    }
  }
}

TEST(CityScene, SameSeedSameBitsOnEveryPlatform) {
  // Recorded once: the presets are what results are quoted for.
  EXPECT_EQ(HashOf(Generate(Preset("city-200")).problem), 2140899734181334340u);
  CityOptions other = Preset("city-200");
  other.seed = 2;
  EXPECT_NE(HashOf(Generate(other).problem), HashOf(Generate(Preset("city-200")).problem));
}

// A city without loops would be a path.
TEST(CityScene, LoopsAreShortAndLong) {
  CityOptions options = Preset("city-1000");
  int lags[3] = {};  // of pairs with common points: the same visit, around a block or two, more
  for (const auto& [i, j] : CovisiblePairs(Generate(options).problem)) {
    ++lags[j - i <= 60 ? 0 : j - i <= 300 ? 1 : 2];
  }
  EXPECT_GT(lags[0], 5000);
  EXPECT_GT(lags[1], 100);
  EXPECT_GT(lags[2], 100);
  options.loop_fraction = 0.0;
  for (const auto& [i, j] : CovisiblePairs(Generate(options).problem)) {
    ASSERT_LE(j - i, 60) << "nothing is recognized";
  }
}

TEST(CityScene, WiderStreetsCoupleMoreCameras) {
  std::size_t last = 0;
  for (const double width : {8.0, 16.0, 32.0, 64.0}) {
    CityOptions options = Preset("city-400");
    options.street_width = width;
    const SimulatedBal scene = Generate(options);
    EXPECT_STREQ(WhatIsWrong(scene.problem, TruthOf(scene)), "");
    const std::size_t pairs = CovisiblePairs(scene.problem).size();
    EXPECT_GT(static_cast<double>(pairs), 1.4 * static_cast<double>(last)) << width;
    last = pairs;
  }
}

TEST(CityScene, DriftIsSmallNearAndLargeFar) {
  CityOptions options = Preset("city-3000");
  options.StartAtTruth();  // drift alone
  const SimulatedBal scene = Generate(options);
  const BalProblem truth = TruthOf(scene);
  double far = 0.0, near = 0.0;
  for (int i = 0; i + 1 < truth.num_cameras; ++i) {
    far = std::max(far, Distance(CenterOf(scene.problem, i), CenterOf(truth, i)));
    const double step = Distance(CenterOf(scene.problem, i), CenterOf(scene.problem, i + 1));
    near =
        std::max(near, std::abs(step / Distance(CenterOf(truth, i), CenterOf(truth, i + 1)) - 1));
  }
  EXPECT_LT(Distance(CenterOf(scene.problem, 0), CenterOf(truth, 0)), 0.1);
  EXPECT_GT(far, 4.0);
  EXPECT_LT(near, 0.5);
  options.drift = 0.0;
  EXPECT_EQ(Generate(options).problem.cameras, truth.cameras);
  EXPECT_EQ(HashOf(TruthOf(Generate(options))), HashOf(truth)) << "drift must not change the scene";
}

TEST(CityScene, CountsAreExactWhereAskedFor) {
  CityOptions options = Preset("city-100");
  options.num_points = 1717;
  options.num_observations = 8000;
  EXPECT_EQ(Generate(options).problem.observations.size(), 8000u);
}

TEST(CityScene, RefusesWhatItCannotMake) {
  SimulatedBal scene;
  CityOptions options = Preset("city-100");
  options.street_width = 5.0;
  EXPECT_EQ(GenerateCity(options, nullptr, &scene).message,
            "CityOptions: street_width is 5, not between 8 and 200");
  options = Preset("city-100");
  options.num_observations = 100 * options.num_points;
  EXPECT_EQ(GenerateCity(options, nullptr, &scene).code, StatusCode::kInvalidArgument);
  EXPECT_EQ(scene.problem.num_cameras, 0) << "unchanged";
  options.num_cameras = 77;
  for (const char* name : {"city-", "city-x", "city-12x", "city-0", "city-99999999999"}) {
    EXPECT_EQ(GetCityPreset(name, &options).code, StatusCode::kInvalidArgument) << name;
  }
  EXPECT_EQ(GetCityPreset("city-2000000000", &options).message,
            "CityOptions: num_cameras is 2000000000, not between 20 and 1000000");
  EXPECT_EQ(options.num_cameras, 77);
}

}  // namespace
}  // namespace inceres::internal
