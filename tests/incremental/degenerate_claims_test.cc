// Claims of convergence where some of the points are degenerate: next to a camera's center, or gone
// to where no cost depends on them. What is said of all others must not rest on those.

#include <algorithm>
#include <array>
#include <cmath>
#include <cstddef>
#include <memory>
#include <vector>

#include <gtest/gtest.h>

#include "inceres/autodiff/autodiff_family.h"
#include "inceres/problem/losses.h"
#include "inceres/solver/incremental_solver.h"
#include "incremental/claims.h"
#include "support/random_values.h"

namespace inceres {
namespace {

using test::Claims;
using test::Incremental;
using test::Random;
using test::UpdateAndJudge;

using Vector3 = std::array<double, 3>;

Vector3 Around(const Vector3& center, double noise, Random* random) {
  return {center[0] + noise * random->Gaussian(), center[1] + noise * random->Gaussian(),
          center[2] + noise * random->Gaussian()};
}

// A camera that looks along z and does not turn is where it was measured.
struct Position {
  template <typename T>
  bool operator()(const T* camera, T* f) const {
    for (std::size_t k = 0; k < 3; ++k) {
      f[k] = weight * (camera[k] - measured[k]);
    }
    return true;
  }
  Vector3 measured;
  double weight;
};
using Positions = AutoDiffFamily<Position, 3, 3>;

// A point in space as such a camera sees it.
struct Projection {
  template <typename T>
  bool operator()(const T* camera, const T* point, T* f) const {
    const T depth = point[2] - camera[2];
    f[0] = 500.0 * ((point[0] - camera[0]) / depth - x);
    f[1] = 500.0 * ((point[1] - camera[1]) / depth - y);
    return true;
  }
  double x, y;
};
using Projections = AutoDiffFamily<Projection, 2, 3, 3>;

// A point along a ray of a first camera, at an inverse depth, as a second one sees it.
struct RayProjection {
  template <typename T>
  bool operator()(const T* first, const T* second, const T* inverse_depth, T* f) const {
    const T depth = 1.0 / inverse_depth[0] + first[2] - second[2];
    f[0] = 300.0 * ((ray_x / inverse_depth[0] + first[0] - second[0]) / depth - x);
    f[1] = 300.0 * ((ray_y / inverse_depth[0] + first[1] - second[1]) / depth - y);
    return true;
  }
  double ray_x, ray_y, x, y;
};
using RayProjections = AutoDiffFamily<RayProjection, 2, 3, 3, 1>;

// Eight cameras in a row that see sixty points. Measurements are revised, and one of the cameras
// comes to see a point that lies in its center but for a last digit: where it is seen, and the
// derivative of that, are anything.
Claims ClaimsBesideAPointInACamera(unsigned seed) {
  constexpr std::size_t kCameras = 8, kPoints = 60;
  Random random(seed);
  IncrementalOptions options = Incremental();
  IncrementalSolver solver(options);
  const auto positions = solver.AddFamily(std::make_shared<Positions>("position"));
  const auto projections = solver.AddFamily(std::make_shared<Projections>("projection"));
  const auto cauchy = std::make_shared<CauchyLoss>(1.0);
  std::vector<VariableId> cameras;
  std::vector<FactorId> factors;
  std::vector<Projection> seen;
  GraphEdit edit(solver.graph());
  for (std::size_t i = 0; i < kCameras; ++i) {
    const Vector3 truth = {0.5 * static_cast<double>(i), 0.0, 10.0};
    const Vector3 start = Around(truth, i == 0 ? 0.0 : 0.1, &random);
    cameras.push_back(edit.AddVariable(start.data(), 3, Role::kFrame));
    edit.AddFactor(positions, {truth, i == 0 ? 1000.0 : 0.1}, {cameras.back()});
  }
  for (std::size_t j = 0; j < kPoints; ++j) {
    const Vector3 truth = {2.0 + 2.0 * random.Gaussian(), 2.0 * random.Gaussian(),
                           15.0 + 3.0 * std::fabs(random.Gaussian())};
    const Vector3 start = Around(truth, 0.3, &random);
    const VariableId point = edit.AddVariable(start.data(), 3, Role::kLandmark);
    for (std::size_t i = 0; i < kCameras; ++i) {
      const double depth = truth[2] - 10.0;
      seen.push_back({(truth[0] - 0.5 * static_cast<double>(i)) / depth + 0.002 * random.Gaussian(),
                      truth[1] / depth + 0.002 * random.Gaussian()});
      factors.push_back(edit.AddFactor(projections, seen.back(), {cameras[i], point}, cauchy));
    }
  }
  EXPECT_TRUE(solver.Apply(edit).ok());
  Claims claims;
  UpdateAndJudge(&solver, options.function_tolerance, &claims);
  for (int round = 0; round < 5; ++round) {
    GraphEdit revision(solver.graph());
    for (int k = 0; k < 100; ++k) {
      const auto at = static_cast<std::size_t>(random.Below(static_cast<int>(factors.size())));
      seen[at].x += 0.004 * random.Gaussian();
      revision.SetMeasurement(factors[at], projections, seen[at]);
    }
    if (round == 0) {
      const double* const camera = solver.Values(cameras[3]);
      const Vector3 center = Around({camera[0], camera[1], camera[2] + 1e-15}, 1e-15, &random);
      const VariableId point = revision.AddVariable(center.data(), 3, Role::kLandmark);
      revision.AddFactor(projections, {0.1, 0.1}, {cameras[3], point}, cauchy);
    }
    EXPECT_TRUE(solver.Apply(revision).ok());
    UpdateAndJudge(&solver, options.function_tolerance, &claims);
  }
  return claims;
}

TEST(DegenerateClaims, BesideAPointInACameraAreAboutAllTheOthers) {
  int count = 0, too_high = 0;
  for (unsigned seed = 0; seed < 40; ++seed) {
    const Claims claims = ClaimsBesideAPointInACamera(seed);
    count += claims.count;
    too_high += claims.too_high;
  }
  EXPECT_GT(count, 30);
  EXPECT_EQ(0, too_high);
}

// A camera that moves backward, so that the centers of those before are in view; of its points a
// tenth are mismatched, as if they were behind it. Their costs fall as the inverse depth grows,
// without an end.
class BackwardLife {
 public:
  explicit BackwardLife(unsigned seed) : random_(seed) {}
  IncrementalSolver& solver() { return solver_; }

  void CameraComes() {
    GraphEdit edit(solver_.graph());
    const Vector3 truth =
        Around({0.0, 0.0, -0.3 * static_cast<double>(truths_.size())}, 0.1, &random_);
    const bool is_first = truths_.empty();
    const Vector3 start = Around(truth, is_first ? 0.0 : 0.2, &random_);
    const VariableId camera = edit.AddVariable(start.data(), 3, Role::kFrame);
    edit.AddFactor(positions_, {truth, is_first ? 1000.0 : 0.01}, {camera});
    for (Point& point : points_) {
      if (point.camera + 6 >= truths_.size()) {
        See(truth, camera, &point, &edit);
      }
    }
    for (int k = 0; k < 12; ++k) {
      Point point;
      point.camera = truths_.size();
      point.is_wild = random_.Below(10) == 0;
      point.depth = 2.0 + 4.0 * std::fabs(random_.Gaussian());
      point.x = 0.4 * random_.Gaussian();
      point.y = 0.4 * random_.Gaussian();
      point.start = std::exp(0.3 * random_.Gaussian()) / point.depth;
      points_.push_back(point);
    }
    truths_.push_back(truth);
    cameras_.push_back(camera);
    EXPECT_TRUE(solver_.Apply(edit).ok());
  }
  double LargestInverseDepth() const {
    double largest = 0.0;
    for (const Point& point : points_) {
      largest = point.id < 0 ? largest : std::max(largest, std::fabs(*solver_.Values(point.id)));
    }
    return largest;
  }

 private:
  struct Point {
    std::size_t camera;
    bool is_wild;
    double depth, x, y, start;
    VariableId id = -1;
  };

  void See(const Vector3& truth, VariableId camera, Point* point, GraphEdit* edit) {
    if (point->id < 0) {
      point->id = edit->AddVariable(&point->start, 1, Role::kLandmark);
    }
    const Vector3& first = truths_[point->camera];
    const double along = point->is_wild ? -0.05 * std::fabs(random_.Gaussian()) : point->depth;
    const double depth = along + first[2] - truth[2];
    const double noise = point->is_wild ? 0.02 : 0.002;
    edit->AddFactor(rays_,
                    {point->x, point->y,
                     (point->x * along + first[0] - truth[0]) / depth + noise * random_.Gaussian(),
                     (point->y * along + first[1] - truth[1]) / depth + noise * random_.Gaussian()},
                    {cameras_[point->camera], camera, point->id}, huber_);
  }

  Random random_;
  IncrementalSolver solver_{Incremental()};
  const FamilyHandle<Positions> positions_ =
      solver_.AddFamily(std::make_shared<Positions>("position"));
  const FamilyHandle<RayProjections> rays_ =
      solver_.AddFamily(std::make_shared<RayProjections>("ray projection"));
  const std::shared_ptr<const Loss> huber_ = std::make_shared<HuberLoss>(1.0);
  std::vector<Vector3> truths_;
  std::vector<VariableId> cameras_;
  std::vector<Point> points_;
};

TEST(DegenerateClaims, WhereInverseDepthsTendToInfinityNoNumberOverflows) {
  Claims claims;
  double largest = 0.0;
  for (unsigned seed = 0; seed < 60; ++seed) {
    BackwardLife life(seed);
    for (int camera = 0; camera < 14; ++camera) {
      life.CameraComes();
      UpdateAndJudge(&life.solver(), Incremental().function_tolerance, &claims);
      largest = std::max(largest, life.LargestInverseDepth());
    }
  }
  EXPECT_GT(claims.count, 300);
  EXPECT_LT(100 * claims.too_high, claims.count);
  EXPECT_GT(largest, 1e6) << "none has run off";
  EXPECT_LT(largest, 1e20);
}

}  // namespace
}  // namespace inceres
