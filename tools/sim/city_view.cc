#include "tools/sim/city_view.h"

#include <algorithm>
#include <cmath>

#include "tools/sim/city_route.h"

namespace inceres::internal {
namespace {

constexpr double kJitter = 0.2;  // of the place of a camera, in spacings to either side
constexpr double kRangePerWidth = 1.9;
constexpr double kMinRange = 20.0;
constexpr double kMaxHeight = 12.0;  // of what is seen of a facade, on a street of 16 m
constexpr double kRelief = 0.1;      // points stand out by up to this part of their distance
constexpr int kMaxTries = 400;

// A car drives in the street with a camera on its roof, looking a little upward and from side to
// side.
SimulatedCamera MakeCamera(const CityRoute& route, double s, int index, Random* random) {
  SimulatedCamera camera;
  const double heading = route.Heading(s);
  const double left = std::clamp(0.5 * random->Normal(), -1.5, 1.5);
  const double height = 2.2 + 0.1 * random->Normal();
  camera.center = route.Position(s) +
                  Vector3{-left * PortableCos(heading), height, left * PortableSin(heading)};
  LookAround(heading, index, random, &camera);
  return camera;
}

}  // namespace

CityView::CityView(const CityOptions& options, const CityGrid& grid)
    : grid_(grid),
      range_(std::max(kMinRange, kRangePerWidth * options.street_width)),
      loop_fraction_(options.loop_fraction),
      pass_(static_cast<int>(2.0 * range_ / options.camera_spacing)) {
  Random driving(options.seed, 0), random(options.seed, 1);
  const CityRoute route(grid, options.camera_spacing * (options.num_cameras + 1), &driving);
  cameras_.reserve(static_cast<std::size_t>(options.num_cameras));
  for (int i = 0; i < options.num_cameras; ++i) {
    const double s = options.camera_spacing * (i + 0.5 + random.Uniform(-kJitter, kJitter));
    cameras_.push_back(MakeCamera(route, s, i, &random));
    cells_[CellOf(cameras_.back().center, 0, 0)].push_back(i);
  }
}

std::int64_t CityView::CellOf(const Vector3& place, int step_x, int step_z) const {
  const auto column = static_cast<std::int64_t>(std::floor(place[0] / range_)) + step_x;
  const auto row = static_cast<std::int64_t>(std::floor(place[2] / range_)) + step_z;
  return column * (std::int64_t{1} << 32) + row;
}

bool CityView::Sees(const SimulatedCamera& camera, const Vector3& position) const {
  return IsInImage(camera, position, range_) &&
         grid_.HitsHouse(camera.center, position - camera.center) >= 1.0 - 1e-9;
}

// What a random pixel of the camera shows, if that is near enough and not the sky.
bool CityView::RandomPosition(int anchor, Random* random, Vector3* position) const {
  const SimulatedCamera& camera = cameras_[static_cast<std::size_t>(anchor)];
  const double px = random->Uniform(-kHalfWidth, kHalfWidth);
  const double py = random->Uniform(-kHalfHeight, kHalfHeight);
  const double nearer = random->Uniform(1.0 - kRelief, 1.0);
  const Vector3 ray = camera.R.Inverse() * Vector3{px, py, -1.0};
  double t = grid_.HitsHouse(camera.center, ray);
  if (ray[1] < 0.0) {
    t = std::min(t, -camera.center[1] / ray[1]);
  }
  *position = camera.center + (nearer * t) * ray;
  const double height_limit = kMaxHeight * std::max(1.0, grid_.street_width() / 16.0);
  return (*position)[1] <= height_limit && Sees(camera, *position);
}

void CityView::CollectCandidates(int anchor, bool recognized, CandidateTrack* point) const {
  point->candidates.assign(1, anchor);
  for (int step_x = -1; step_x <= 1; ++step_x) {
    for (int step_z = -1; step_z <= 1; ++step_z) {
      const auto cell = cells_.find(CellOf(point->position, step_x, step_z));
      if (cell == cells_.end()) {
        continue;
      }
      for (const int i : cell->second) {
        const bool same_visit = std::abs(i - anchor) <= pass_;
        if (i != anchor && (same_visit || recognized) &&
            Sees(cameras_[static_cast<std::size_t>(i)], point->position)) {
          point->candidates.push_back(i);
        }
      }
    }
  }
}

bool CityView::PlacePoint(int anchor, Random* random, CandidateTrack* point) const {
  const bool recognized = random->Uniform() < loop_fraction_;
  for (int attempt = 0; attempt < kMaxTries; ++attempt) {
    if (RandomPosition(anchor, random, &point->position)) {
      CollectCandidates(anchor, recognized, point);
      if (OrderCandidates(*this, random, point)) {
        return true;
      }
    }
  }
  return false;
}

}  // namespace inceres::internal
