#include <algorithm>
#include <cstddef>
#include <memory>
#include <string>
#include <utility>
#include <vector>

#include "inceres/problem/rotation.h"
#include "tools/replay/replay_scripts.h"

namespace inceres::tools {
namespace {

constexpr int kLoopGap = 10;  // a point not seen for more poses than that closes a loop

class StereoScript {
 public:
  explicit StereoScript(const StereoOdometry& odometry)
      : odometry_(odometry),
        camera_(std::make_shared<StereoCamera>(odometry.camera)),
        points_(odometry.point_ids.size()) {}

  std::vector<ReplayStep> Make() {
    std::vector<ReplayStep> steps(odometry_.poses.size() - 1);
    ReplayVariable on_body;  // the left camera is the body
    on_body.kind = ReplayVariable::Kind::kPose;
    on_body.start[6] = 1.0;
    on_body.constant = true;
    on_body_ = Add(on_body, &steps.front());
    auto sighting = odometry_.sightings.begin();
    for (int i = 0; i < static_cast<int>(odometry_.poses.size()); ++i) {
      ReplayStep* step = &steps[static_cast<std::size_t>(std::max(i - 1, 0))];
      AddPose(i, step);
      for (; sighting != odometry_.sightings.end() && sighting->pose == i; ++sighting) {
        AddSighting(*sighting, step);
      }
    }
    return steps;
  }

 private:
  struct Point {
    int variable = -1;
    const StereoSighting* first = nullptr;
    int last_pose = -1;  // that saw it
  };

  int Add(const ReplayVariable& variable, ReplayStep* step) {
    step->variables.push_back(variable);
    return num_variables_++;
  }

  void AddPose(int i, ReplayStep* step) {
    const std::array<double, 7>& pose = odometry_.poses[static_cast<std::size_t>(i)];
    ReplayVariable variable;
    variable.kind = ReplayVariable::Kind::kPose;
    variable.constant = i == 0;
    std::copy(pose.begin(), pose.end(), variable.start.begin());
    if (i > 0) {
      double back[7];
      InvertPose(odometry_.poses[static_cast<std::size_t>(i - 1)].data(), back);
      ComposePoses(back, pose.data(), variable.start.data());
      variable.start_from = pose_variable_.back();
    }
    pose_variable_.push_back(Add(variable, step));
  }

  void AddSighting(const StereoSighting& sighting, ReplayStep* step) {
    Point& point = points_[static_cast<std::size_t>(sighting.point)];
    if (point.first == nullptr) {
      point.first = &sighting;
    } else {
      if (point.variable < 0) {
        ReplayVariable variable;
        variable.kind = ReplayVariable::Kind::kPoint;
        variable.start_from = pose_variable_[static_cast<std::size_t>(point.first->pose)];
        std::copy_n(point.first->in_camera, 3, variable.start.begin());
        point.variable = Add(variable, step);
        AddFactor(*point.first, point.variable, step);
      }
      AddFactor(sighting, point.variable, step);
      step->closes_loop = step->closes_loop || sighting.pose - point.last_pose > kLoopGap;
    }
    point.last_pose = sighting.pose;
  }

  void AddFactor(const StereoSighting& sighting, int point, ReplayStep* step) {
    StereoPointSighting measurement{{}, camera_};
    std::copy_n(sighting.left, 2, measurement.seen.left);
    measurement.seen.right_u = sighting.right_u;
    step->factors.push_back(
        {measurement,
         {pose_variable_[static_cast<std::size_t>(sighting.pose)], on_body_, point},
         kUnitHuber});
  }

  const StereoOdometry& odometry_;
  const std::shared_ptr<const StereoCamera> camera_;
  std::vector<Point> points_;
  std::vector<int> pose_variable_;  // of each pose so far
  int on_body_ = -1;
  int num_variables_ = 0;
};

}  // namespace

ReplayScript MakeStereoReplay(const StereoOdometry& odometry) {
  ReplayScript script;
  script.description = std::to_string(odometry.poses.size()) + " poses, " +
                       std::to_string(odometry.point_ids.size()) + " points, " +
                       std::to_string(odometry.sightings.size()) + " stereo sightings";
  script.steps = StereoScript(odometry).Make();
  return script;
}

}  // namespace inceres::tools
