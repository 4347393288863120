#include "tools/sim/street_view.h"

#include <algorithm>
#include <cmath>

namespace inceres::internal {
namespace {

constexpr double kJitter = 0.2;  // of the place of a camera, in spacings to either side
constexpr int kMaxTries = 200;

}  // namespace

StreetView::StreetView(const StreetSceneOptions& options, double spacing)
    : spacing_(spacing),
      loop_fraction_(options.loop_fraction),
      loop_stretch_(options.loop_stretch),
      num_laps_(static_cast<int>(std::ceil(options.laps))),
      path_(options.laps > 0.0 ? spacing * options.num_cameras / options.laps : 0.0) {
  Random random(options.seed, 1);
  cameras_.reserve(static_cast<std::size_t>(options.num_cameras));
  for (int i = 0; i < options.num_cameras; ++i) {
    cameras_.push_back(MakeCamera(i, &random));
  }
}

// Somebody walks through the street with a camera in the hand, looking a little upward and from
// side to side.
StreetCamera StreetView::MakeCamera(int index, Random* random) const {
  StreetCamera camera;
  camera.s = spacing_ * (index + random->Uniform(-kJitter, kJitter));
  const double left = 0.3 * random->Normal();
  const double height = 1.6 + 0.1 * random->Normal();
  camera.center = path_.Place(camera.s, std::clamp(left, -1.0, 1.0), height);
  LookAround(path_.Heading(camera.s), index, random, &camera);
  return camera;
}

bool StreetView::Sees(const StreetCamera& camera, const Vector3& position) const {
  return IsInImage(camera, position, kVisibleRange);
}

// A facade on either side, or the ground between them.
Vector3 StreetView::RandomPosition(double s, Random* random) const {
  const double kind = random->Uniform();
  if (kind < 0.2) {
    const double left = random->Uniform(-5.0, 5.0);
    return path_.Place(s, std::min(left, path_.left_room()), random->Uniform(0.0, 0.3));
  }
  const double distance = random->Uniform(5.0, 8.0);
  const double left = kind < 0.6 ? distance : -distance;
  return path_.Place(s, std::min(left, path_.left_room()), random->Uniform(0.0, 12.0));
}

// The cameras that come by at s and see the position; found by their even spacing, not by search.
void StreetView::CollectPass(double s, int anchor, const Vector3& position,
                             std::vector<int>* candidates) const {
  const double last_index = static_cast<double>(cameras_.size()) - 1.0;
  const double first = std::max(0.0, std::ceil((s - kVisibleRange) / spacing_ - kJitter));
  const double last = std::min(last_index, std::floor(s / spacing_ + kJitter));
  for (double index = first; index <= last; index += 1.0) {
    const int i = static_cast<int>(index);
    if (i != anchor && Sees(cameras_[static_cast<std::size_t>(i)], position)) {
      candidates->push_back(i);
    }
  }
}

// Whether what is anchored at s may be seen by cameras of other laps.
bool StreetView::IsRecognizable(double s) const {
  const double laps = s / path_.circumference();
  return laps - std::floor(laps) <= loop_stretch_;
}

bool StreetView::PlacePoint(int anchor, Random* random, CandidateTrack* point) const {
  const StreetCamera& camera = cameras_[static_cast<std::size_t>(anchor)];
  const bool recognized =
      path_.closed() && random->Uniform() < loop_fraction_ && IsRecognizable(camera.s);
  for (int attempt = 0; attempt < kMaxTries; ++attempt) {
    const double s = camera.s + random->Uniform(kMinDepth, kVisibleRange);
    point->position = RandomPosition(s, random);
    if (!Sees(camera, point->position)) {
      continue;
    }
    point->candidates.assign(1, anchor);
    const int laps = recognized ? num_laps_ : 0;
    for (int lap = -laps; lap <= laps; ++lap) {
      CollectPass(s + lap * path_.circumference(), anchor, point->position, &point->candidates);
    }
    if (OrderCandidates(*this, random, point)) {
      return true;
    }
  }
  return false;
}

}  // namespace inceres::internal
