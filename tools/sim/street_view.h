#pragma once

#include <vector>

#include "tools/sim/portable_math.h"
#include "tools/sim/street_path.h"
#include "tools/sim/street_scene.h"
#include "tools/sim/track_builder.h"

namespace inceres::internal {

// what is farther along the street or as the crow flies is not seen
constexpr double kVisibleRange = 30.0;
// about as long along the street a point stays in the image
constexpr double kVisibleLength = 22.0;

/// One true camera of the street.
struct StreetCamera : SimulatedCamera {
  double s = 0.0;  // along the path, all laps together
};

/// The cameras on their path, and points placed where they see them.
class StreetView : public ObservedWorld {
 public:
  StreetView(const StreetSceneOptions& options, double spacing);

  bool PlacePoint(int anchor, Random* random, CandidateTrack* point) const override;
  int num_cameras() const override { return static_cast<int>(cameras_.size()); }
  const SimulatedCamera& camera(int index) const override {
    return cameras_[static_cast<std::size_t>(index)];
  }

 private:
  StreetCamera MakeCamera(int index, Random* random) const;
  bool Sees(const StreetCamera& camera, const Vector3& position) const;
  void CollectPass(double s, int anchor, const Vector3& position,
                   std::vector<int>* candidates) const;
  Vector3 RandomPosition(double s, Random* random) const;
  bool IsRecognizable(double s) const;

  double spacing_;
  double loop_fraction_;
  double loop_stretch_;
  int num_laps_;
  StreetPath path_;
  std::vector<StreetCamera> cameras_;
};

}  // namespace inceres::internal
