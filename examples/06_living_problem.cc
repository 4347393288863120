// Lesson 6, a living problem: a camera passes a wall for 300 meters. After each meter the solver
// does the work of what has changed. Then an observation turns out to be wrong, and goes.
//
//     06_living_problem
#include <algorithm>
#include <array>
#include <cstddef>
#include <cstdio>
#include <iostream>
#include <memory>
#include <string>
#include <vector>

#include "examples/wall.h"
#include "inceres/factors/pose_prior.h"
#include "inceres/solver/incremental_solver.h"

namespace {

class Map {
 public:
  // [quoted in docs/lessons/06_living_problem.md]
  Map() {
    inceres::GraphEdit edit(solver_.graph());
    camera_on_body_ = edit.AddBorrowedConstant(on_body_, 7);
    Update(edit);
  }

  // A new camera, the points that nobody has seen before, and all that it sees.
  inceres::UpdateSummary AddCamera(int i) {
    inceres::GraphEdit edit(solver_.graph());
    const auto pose = wall::Pose(i, 0.03);  // from a satellite receiver, say
    const auto camera = edit.AddVariable(pose.data(), 7, inceres::Role::kFrame, manifold_);
    edit.AddFactor(fixes_, Fix(pose), {camera});
    for (int k = wall::FirstSeen(i); k < wall::EndSeen(i); ++k) {
      if (k == static_cast<int>(points_.size())) {
        const auto start = wall::PointStart(k);
        points_.push_back(edit.AddVariable(start.data(), 3, inceres::Role::kLandmark));
      }
      const inceres::VariableId point = points_[static_cast<std::size_t>(k)];
      observations_.push_back(
          edit.AddFactor(sights_, wall::Sight(i, k), {camera, camera_on_body_, point}));
    }
    return Update(edit);
  }

  inceres::UpdateSummary RemoveObservation(std::size_t number) {
    inceres::GraphEdit edit(solver_.graph());
    edit.RemoveFactor(observations_[number]);
    return Update(edit);
  }

  inceres::UpdateSummary Update(const inceres::GraphEdit& edit) {
    if (const inceres::Status status = solver_.Apply(edit); !status.ok()) {
      std::cerr << status.message << '\n';  // names the id at fault; nothing has changed
    }
    return solver_.Update();
  }
  // [end of quote]

  int num_factors() const { return solver_.graph().num_factors(); }

 private:
  static inceres::PosePriorFamily::Measurement Fix(const std::array<double, 7>& pose) {
    inceres::PosePriorFamily::Measurement fix;
    std::copy(pose.begin(), pose.end(), fix.pose);
    for (int k = 0; k < 6; ++k) {  // 3 cm, and a hundredth of a radian
      fix.sqrt_information[7 * k] = k < 3 ? 1.0 / 0.03 : 100.0;
    }
    return fix;
  }

  const double on_body_[7] = {0, 0, 0, 0, 0, 0, 1};
  inceres::IncrementalSolver solver_{inceres::IncrementalOptions()};
  inceres::FamilyHandle<inceres::PointReprojectionFamily> sights_ =
      solver_.AddFamily(std::make_shared<inceres::PointReprojectionFamily>(wall::Camera()));
  inceres::FamilyHandle<inceres::PosePriorFamily> fixes_ =
      solver_.AddFamily(std::make_shared<inceres::PosePriorFamily>());
  std::shared_ptr<const inceres::Manifold> manifold_ = std::make_shared<inceres::PoseManifold>();
  inceres::VariableId camera_on_body_ = -1;
  std::vector<inceres::VariableId> points_;
  std::vector<inceres::FactorId> observations_;
};

void Print(const std::string& what, const Map& map, const inceres::UpdateSummary& update) {
  std::printf("%-12s %8d %11lld %8d %10d %10.1f\n", what.c_str(), map.num_factors(),
              static_cast<long long>(update.num_relinearized_factors), update.num_moved_frames,
              update.num_visited_landmarks, update.final_cost);
}

}  // namespace

int main() {
  std::printf("%-12s %8s %11s %8s %10s %10s\n", "", "factors", "linearized", "cameras", "landmarks",
              "cost");
  Map map;
  for (int i = 0; i < 300; ++i) {
    const inceres::UpdateSummary update = map.AddCamera(i);
    if (update.termination == inceres::Termination::kFailure) {
      std::cerr << update.message << '\n';
      return 1;
    }
    if ((i + 1) % 50 == 0) {
      Print("camera " + std::to_string(i), map, update);
    }
  }
  const inceres::UpdateSummary update = map.RemoveObservation(5000);
  Print("one less", map, update);
  return 0;
}
