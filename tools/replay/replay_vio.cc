#include <algorithm>
#include <cstddef>
#include <limits>
#include <memory>
#include <string>
#include <utility>
#include <vector>

#include "tools/replay/replay_scripts.h"

namespace inceres::tools {
namespace {

constexpr int kLoopGap = 10;  // a point not seen for more frames than that closes a loop
constexpr double kSpeedSigma = 0.1, kGyrBiasSigma = 0.02, kAccBiasSigma = 0.2;

ReplayVariable Pose(const std::array<double, 7>& pose, bool constant) {
  ReplayVariable variable;
  variable.kind = ReplayVariable::Kind::kPose;
  std::copy(pose.begin(), pose.end(), variable.start.begin());
  variable.constant = constant;
  return variable;
}

// v, b_g, b_a: the default order of ImuConventions.
ReplayVariable SpeedBias(const VioState& state) {
  ReplayVariable variable;
  variable.kind = ReplayVariable::Kind::kSpeedBias;
  auto next = variable.start.begin();
  for (const std::array<double, 3>* part : {&state.velocity, &state.gyr_bias, &state.acc_bias}) {
    next = std::copy(part->begin(), part->end(), next);
  }
  return variable;
}

class VioScript {
 public:
  VioScript(const VioSequence& sequence, const VioReplayOptions& options)
      : sequence_(sequence),
        options_(options),
        camera_(std::make_shared<PinholeCamera>(sequence.camera.Pinhole())),
        points_(sequence.points.size()) {
    imu_options_.noise = sequence.imu_noise;
    std::copy(sequence.gravity.begin(), sequence.gravity.end(), imu_options_.conventions.gravity);
    imu_options_.max_rotation_change = imu_options_.max_speed_change =
        std::numeric_limits<double>::infinity();
  }

  Status Make(std::vector<ReplayStep>* steps) {
    steps->resize(sequence_.frames.size() - 1);
    camera_variable_ = Add(Pose(sequence_.camera.imu_from_camera, true), &steps->front());
    for (int i = 0; i < static_cast<int>(sequence_.frames.size()); ++i) {
      ReplayStep* step = &(*steps)[static_cast<std::size_t>(std::max(i - 1, 0))];
      AddFrame(i, step);
      if (Status status = i == 0 ? Status::Ok() : AddImu(i, step); !status.ok()) {
        return status;
      }
      for (const VioObservation& observation : frame(i).observations) {
        AddObservation(i, observation, step);
      }
    }
    return Status::Ok();
  }

 private:
  struct Point {
    int variable = -1;
    int last_frame = -1;   // that saw it
    VioObservation first;  // kept until a second one comes
  };

  const VioFrame& frame(int i) const { return sequence_.frames[static_cast<std::size_t>(i)]; }
  // Variables of frame i.
  int PoseOf(int i) const { return frame_variable_[static_cast<std::size_t>(i)]; }
  int SpeedBiasOf(int i) const { return PoseOf(i) + 1; }

  int Add(const ReplayVariable& variable, ReplayStep* step) {
    step->variables.push_back(variable);
    return num_variables_++;
  }

  void AddFrame(int i, ReplayStep* step) {
    const VioState& start = frame(i).start;
    frame_variable_.push_back(Add(Pose(start.pose, i == 0), step));
    const ReplayVariable speed_bias = SpeedBias(start);
    const int number = Add(speed_bias, step);
    if (i == 0 && options_.prior) {
      DiagonalPriorFamily::Measurement prior;
      prior.mean.assign(speed_bias.start.begin(), speed_bias.start.end());
      for (const double sigma : {kSpeedSigma, kGyrBiasSigma, kAccBiasSigma}) {
        prior.sqrt_information.insert(prior.sqrt_information.end(), 3, 1.0 / sigma);
      }
      step->factors.push_back({prior, {number}, {}});
    }
  }

  Status AddImu(int i, ReplayStep* step) {
    const VioState& start = frame(i - 1).start;
    auto imu = std::make_shared<ImuPreintegrator>(imu_options_);
    Status status = imu->Integrate(frame(i).imu, start.gyr_bias.data(), start.acc_bias.data());
    if (!status.ok()) {
      status.message = "frame " + std::to_string(i) + ": " + status.message;
      return status;
    }
    step->factors.push_back({std::shared_ptr<const ImuPreintegrator>(std::move(imu)),
                             {PoseOf(i - 1), SpeedBiasOf(i - 1), PoseOf(i), SpeedBiasOf(i)},
                             {}});
    return Status::Ok();
  }

  void AddObservation(int i, const VioObservation& observation, ReplayStep* step) {
    Point& point = points_[static_cast<std::size_t>(observation.point)];
    if (point.last_frame < 0) {
      point.first = observation;
    } else {
      if (point.variable < 0) {
        ReplayVariable variable;
        variable.kind = ReplayVariable::Kind::kPoint;
        const std::array<double, 3>& start =
            sequence_.points[static_cast<std::size_t>(observation.point)].start;
        std::copy(start.begin(), start.end(), variable.start.begin());
        point.variable = Add(variable, step);
        AddSighting(point.last_frame, point.first, step);
      }
      AddSighting(i, observation, step);
      step->closes_loop = step->closes_loop || i - point.last_frame > kLoopGap;
    }
    point.last_frame = i;
  }

  void AddSighting(int i, const VioObservation& observation, ReplayStep* step) {
    const double weight = 1.0 / sequence_.pixel_noise;
    const PixelObservation seen{{observation.x, observation.y}, {weight, 0.0, weight}};
    step->factors.push_back({PointSighting{seen, camera_},
                             {PoseOf(i), camera_variable_,
                              points_[static_cast<std::size_t>(observation.point)].variable},
                             options_.loss});
  }

  const VioSequence& sequence_;
  const VioReplayOptions& options_;
  std::shared_ptr<const PinholeCamera> camera_;
  ImuOptions imu_options_;
  std::vector<Point> points_;
  std::vector<int> frame_variable_;  // the pose of each frame so far; its speed-bias comes next
  int camera_variable_ = -1;
  int num_variables_ = 0;
};

}  // namespace

Status MakeVioReplay(const VioSequence& sequence, const VioReplayOptions& options,
                     ReplayScript* script) {
  ReplayScript made;
  made.description = std::to_string(sequence.frames.size()) + " frames, " +
                     std::to_string(sequence.points.size()) + " points, " +
                     std::to_string(sequence.NumObservations()) + " observations, " +
                     std::to_string(sequence.frames.size() - 1) + " IMU factors";
  made.dogleg = true;
  Status status = VioScript(sequence, options).Make(&made.steps);
  if (status.ok()) {
    *script = std::move(made);
  }
  return status;
}

}  // namespace inceres::tools
