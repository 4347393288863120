#pragma once

#include <vector>

#include "tools/sim/portable_math.h"
#include "tools/sim/street_path.h"
#include "tools/sim/street_scene.h"

namespace inceres::internal {

// what is farther along the street or as the crow flies is not seen
constexpr double kVisibleRange = 30.0;
// about as long along the street a point stays in the image
constexpr double kVisibleLength = 22.0;
constexpr double kMinDepth = 2.0;

/// One true camera of the simulation: world to camera is x_c = R (x - center).
struct StreetCamera {
  double s = 0.0;  // along the path, all laps together
  Vector3 center{};
  Rotation R;
  double focal = 0.0, k1 = 0.0, k2 = 0.0;
};

/// One point and who could see it. The first candidate is the camera the point was made for, the
/// second sees it from a direction that is different enough, the others follow in random order: any
/// first k >= 2 of them are a valid track of length k.
struct StreetPoint {
  Vector3 position{};
  std::vector<int> candidates;
};

/// The cameras on their path, and points placed where they see them.
class StreetView {
 public:
  StreetView(const StreetSceneOptions& options, double spacing);

  /// A random point in front of camera `anchor`. False if no place was found that a second camera
  /// sees well.
  bool PlacePoint(int anchor, Random* random, StreetPoint* point) const;

  const std::vector<StreetCamera>& cameras() const { return cameras_; }

 private:
  StreetCamera MakeCamera(int index, Random* random) const;
  bool Sees(const StreetCamera& camera, const Vector3& position) const;
  void CollectPass(double s, int anchor, const Vector3& position,
                   std::vector<int>* candidates) const;
  bool ChoosePartner(int anchor, Random* random, StreetPoint* point) const;
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
