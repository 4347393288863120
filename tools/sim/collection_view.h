#pragma once

#include <vector>

#include "tools/sim/simulated_camera.h"

namespace inceres::internal {

/// The photographers of a collection and the sights they photograph: round buildings.
class CollectionView {
 public:
  CollectionView(int num_cameras, std::uint64_t seed);

  const std::vector<SimulatedCamera>& cameras() const { return cameras_; }
  int num_sights() const { return static_cast<int>(sights_.size()); }
  /// The sight that a camera is pointed at. Sights are numbered from the least photographed on.
  int SightOf(int camera) const { return sight_of_[static_cast<std::size_t>(camera)]; }
  /// Cameras that have a sight in view.
  const std::vector<int>& Viewers(int sight) const {
    return sights_[static_cast<std::size_t>(sight)].viewers;
  }

  /// A random place on the side of its sight that the camera sees, and the outward normal there.
  /// False if none was found inside the image.
  bool RandomPosition(int camera, Random* random, Vector3* position, Vector3* normal) const;
  /// Whether a camera sees a place on a sight.
  bool Sees(int camera, const Vector3& position, const Vector3& normal) const;

 private:
  struct Sight {
    Vector3 center{};
    double radius = 0.0;
    std::vector<int> viewers;
  };
  // Half the image divided by the focal length.
  struct Image {
    double half_width = 0.0, half_height = 0.0;
  };

  void PlaceSights(Random* random);
  void AddCamera(int sight, Random* random);
  void CollectViewers();

  std::vector<Sight> sights_;
  std::vector<SimulatedCamera> cameras_;
  std::vector<Image> images_;
  std::vector<int> sight_of_;
};

}  // namespace inceres::internal
