#pragma once

#include <cstdint>
#include <unordered_map>
#include <vector>

#include "tools/sim/city_grid.h"
#include "tools/sim/city_scene.h"
#include "tools/sim/track_builder.h"

namespace inceres::internal {

/// The cameras on their route through the city, and points placed where they see them.
class CityView : public ObservedWorld {
 public:
  CityView(const CityOptions& options, const CityGrid& grid);

  bool PlacePoint(int anchor, Random* random, CandidateTrack* point) const override;
  int num_cameras() const override { return static_cast<int>(cameras_.size()); }
  const SimulatedCamera& camera(int index) const override {
    return cameras_[static_cast<std::size_t>(index)];
  }

 private:
  bool RandomPosition(int anchor, Random* random, Vector3* position) const;
  bool Sees(const SimulatedCamera& camera, const Vector3& position) const;
  std::int64_t CellOf(const Vector3& place, int step_x, int step_z) const;
  void CollectCandidates(int anchor, bool recognized, CandidateTrack* point) const;

  const CityGrid& grid_;
  double range_;  // what is farther is not seen
  double loop_fraction_;
  int pass_;  // cameras as near in the order as this belong to the same visit
  std::vector<SimulatedCamera> cameras_;
  std::unordered_map<std::int64_t, std::vector<int>> cells_;  // squares with sides of the range
};

}  // namespace inceres::internal
