#include "okvis/okvis_estimator.h"

#include <algorithm>

#include "common/imu_residual.h"
#include "common/triangulation.h"
#include "okvis/imu_error.h"
#include "okvis/prior_errors.h"
#include "okvis/realistic_errors.h"
#include "okvis/reprojection_error.h"

namespace sliding_window {

namespace {

constexpr double kKeyframeOverlap = 0.6;  // of the features of the last keyframe and the image

ceres::Problem::Options OwnNothing() {
  ceres::Problem::Options options;
  options.cost_function_ownership = ceres::DO_NOT_TAKE_OWNERSHIP;
  options.loss_function_ownership = ceres::DO_NOT_TAKE_OWNERSHIP;
  options.manifold_ownership = ceres::DO_NOT_TAKE_OWNERSHIP;
  options.enable_fast_removal = true;
  return options;
}

}  // namespace

OkvisEstimator::OkvisEstimator(const EstimatorOptions& options, const OkvisOptions& okvis_options,
                               SolveFunction solve, const ImuState& start,
                               const std::vector<Pose>& body_from_cameras)
    : options_(options),
      okvis_options_(okvis_options),
      solve_(std::move(solve)),
      start_(start),
      extrinsics_(body_from_cameras.size()),
      problem_(OwnNothing()) {
  PoseError::Vector6 sigma;
  sigma << Eigen::Vector3d::Constant(okvis_options_.extrinsic_p_sigma),
      Eigen::Vector3d::Constant(okvis_options_.extrinsic_r_sigma);
  for (std::size_t i = 0; i < extrinsics_.size(); ++i) {
    double* pose = extrinsics_[i].pose;
    body_from_cameras[i].ToParameters(pose);
    problem_.AddParameterBlock(pose, 7, &pose_manifold_);
    if (options_.free_extrinsics) {
      extrinsics_[i].prior = AddResidual(
          std::make_unique<PoseError>(body_from_cameras[i], sigma.array().square().inverse()),
          nullptr, {pose});
    } else {
      problem_.SetParameterBlockConstant(pose);
    }
  }
}

void OkvisEstimator::AddFrame(const Frame& frame) {
  const int id = next_frame_++;
  AddBlocks(id, frame);
  AddObservations(id, frame.observations);
  frames_.at(id).is_keyframe = IsKeyframe(id, frame.observations);
  if (okvis_options_.newest_first) {
    SetAllConstantBut(id, true);
    Solve(2);
    SetAllConstantBut(id, false);
  }
  Solve(options_.max_num_iterations);
  Marginalize();
}

std::unique_ptr<ceres::CostFunction> OkvisEstimator::MakeReprojectionError(
    const Eigen::Vector2d& xy) const {
  if (options_.realistic_costs) {
    return std::make_unique<RealisticReprojectionError>(xy, options_.focal_length,
                                                        options_.pixel_noise);
  }
  return std::make_unique<ReprojectionError>(xy, options_.focal_length / options_.pixel_noise);
}

std::unique_ptr<ceres::CostFunction> OkvisEstimator::MakeImuError(
    const std::vector<ImuSample>& samples, const ImuState& state) const {
  if (options_.realistic_costs) {
    return std::make_unique<RealisticImuError>(options_.imu_noise, samples, state.ba, state.bg);
  }
  return std::make_unique<ImuError>(options_.imu_noise, samples, state.ba, state.bg);
}

void OkvisEstimator::AddBlocks(int id, const Frame& frame) {
  FrameBlocks& blocks = frames_[id];
  problem_.AddParameterBlock(blocks.pose, 7, &pose_manifold_);
  problem_.AddParameterBlock(blocks.speed_bias, 9);
  if (id == 0) {
    StateToBlocks(start_, blocks.pose, blocks.speed_bias);
    SetPosePrior(id, okvis_options_.first_pose_information);
    SpeedAndBiasError::Vector9 sigma;
    sigma << Eigen::Vector3d::Constant(okvis_options_.speed_sigma),
        Eigen::Vector3d::Constant(okvis_options_.gyr_bias_sigma),
        Eigen::Vector3d::Constant(okvis_options_.acc_bias_sigma);
    blocks.speed_bias_prior = AddResidual(
        std::make_unique<SpeedAndBiasError>(SpeedAndBiasError::Vector9(blocks.speed_bias),
                                            sigma.array().square().inverse()),
        nullptr, {blocks.speed_bias});
    return;
  }
  FrameBlocks& before = frames_.at(id - 1);
  const ImuState state = StateFromBlocks(before.pose, before.speed_bias);
  const ImuPreintegration imu(options_.imu_noise, frame.imu, state.ba, state.bg);
  StateToBlocks(Propagate(imu, state), blocks.pose, blocks.speed_bias);
  blocks.imu = AddResidual(MakeImuError(frame.imu, state), nullptr,
                           {before.pose, before.speed_bias, blocks.pose, blocks.speed_bias});
}

void OkvisEstimator::AddObservations(int id, const std::vector<Observation>& observations) {
  for (const Observation& observation : observations) {
    Landmark& landmark = landmarks_[observation.feature];
    const std::pair<int, int> key(id, observation.camera);
    landmark.sightings[key] = {
        observation.xy, observation.depth, {MakeReprojectionError(observation.xy)}};
    if (landmark.is_variable) {
      AddSighting(&landmark, key);
    } else {
      AddLandmarkIfSeenWell(&landmark);
    }
  }
}

void OkvisEstimator::AddLandmarkIfSeenWell(Landmark* landmark) {
  const auto point = landmark->sightings.size() >= 2 ? FirstPosition(*landmark) : std::nullopt;
  if (!point) {
    return;
  }
  Eigen::Map<Eigen::Vector4d>{landmark->x} = point->homogeneous();
  landmark->is_variable = true;
  problem_.AddParameterBlock(landmark->x, 4, &point_manifold_);
  for (auto& [key, sighting] : landmark->sightings) {
    AddSighting(landmark, key);
  }
}

// Where the front end's guess puts it, or else where the lines of sight meet.
std::optional<Eigen::Vector3d> OkvisEstimator::FirstPosition(const Landmark& landmark) const {
  std::vector<Sight> sights;
  for (const auto& [key, sighting] : landmark.sightings) {
    const Pose world_from_camera = Pose::FromParameters(frames_.at(key.first).pose) *
                                   Pose::FromParameters(extrinsics_[key.second].pose);
    if (sighting.depth > 0.0) {
      return world_from_camera * (sighting.depth * sighting.xy.homogeneous());
    }
    sights.push_back({world_from_camera, sighting.xy});
  }
  return Triangulate(sights);
}

void OkvisEstimator::AddSighting(Landmark* landmark, std::pair<int, int> frame_and_camera) {
  const auto [frame, camera] = frame_and_camera;
  Residual& residual = landmark->sightings.at(frame_and_camera).residual;
  residual = AddResidual(std::move(residual.cost), &loss_,
                         {frames_.at(frame).pose, landmark->x, extrinsics_[camera].pose});
}

bool OkvisEstimator::IsKeyframe(int id, const std::vector<Observation>& observations) const {
  if (okvis_options_.keyframe_interval > 0) {
    return id % okvis_options_.keyframe_interval == 0;
  }
  const auto last = std::find_if(frames_.rbegin(), frames_.rend(),
                                 [](const auto& frame) { return frame.second.is_keyframe; });
  if (last == frames_.rend()) {
    return true;
  }
  const auto num_shared =
      std::count_if(observations.begin(), observations.end(), [&](const Observation& observation) {
        return landmarks_.at(observation.feature).IsSeenIn(last->first);
      });
  return id > last->first && static_cast<double>(num_shared) <
                                 kKeyframeOverlap * static_cast<double>(observations.size());
}

// Position and yaw, which no sensor tells, of the frame that is the oldest now.
void OkvisEstimator::SetPosePrior(int id, double information) {
  RemoveResidual(&pose_prior_);
  PoseError::Vector6 diagonal;
  diagonal << information, information, information, 0.0, 0.0, information;
  double* pose = frames_.at(id).pose;
  pose_prior_ = AddResidual(std::make_unique<PoseError>(Pose::FromParameters(pose), diagonal),
                            nullptr, {pose});
}

void OkvisEstimator::SetAllConstantBut(int newest, bool constant) {
  const FrameBlocks& free = frames_.at(newest);
  const auto is_extrinsic = [this](const double* block) {
    return std::any_of(extrinsics_.begin(), extrinsics_.end(),
                       [block](const Extrinsic& a) { return a.pose == block; });
  };
  ForEachBlock([&](double* block, int /*size*/) {
    if (block == free.pose || block == free.speed_bias ||
        (is_extrinsic(block) && !options_.free_extrinsics)) {
      return;
    }
    if (constant) {
      problem_.SetParameterBlockConstant(block);
    } else {
      problem_.SetParameterBlockVariable(block);
    }
  });
}

void OkvisEstimator::Solve(int max_num_iterations) {
  ceres::Solver::Options solver = MakeSolverOptions(options_);
  solver.max_num_iterations = max_num_iterations;
  if (options_.ordering == Ordering::kLandmarksFirst) {
    solver.linear_solver_ordering = std::make_shared<ceres::ParameterBlockOrdering>();
    ForEachBlock([&](double* block, int size) {
      solver.linear_solver_ordering->AddElementToGroup(block, size == 4 ? 0 : 1);
    });
  }
  ceres::Solver::Summary summary;
  solve_(solver, &problem_, &summary);
}

void OkvisEstimator::ForEachBlock(const std::function<void(double*, int)>& visit) {
  for (auto& [id, frame] : frames_) {
    visit(frame.pose, 7);
    if (frame.has_speed_bias) {
      visit(frame.speed_bias, 9);
    }
  }
  for (auto& [number, landmark] : landmarks_) {
    if (landmark.is_variable) {
      visit(landmark.x, 4);
    }
  }
  for (Extrinsic& extrinsic : extrinsics_) {
    visit(extrinsic.pose, 7);
  }
}

ImuState OkvisEstimator::newest_state() const {
  return frames_.empty()
             ? start_
             : StateFromBlocks(frames_.rbegin()->second.pose, frames_.rbegin()->second.speed_bias);
}

std::vector<double> OkvisEstimator::Values() {
  std::vector<double> values;
  ForEachBlock(
      [&](const double* block, int size) { values.insert(values.end(), block, block + size); });
  return values;
}

void OkvisEstimator::SetValues(const std::vector<double>& values) {
  auto from = values.begin();
  ForEachBlock([&](double* block, int size) {
    std::copy(from, from + size, block);
    from += size;
  });
}

OkvisEstimator::Residual OkvisEstimator::AddResidual(std::unique_ptr<ceres::CostFunction> cost,
                                                     ceres::LossFunction* loss,
                                                     const std::vector<double*>& blocks) {
  const ceres::ResidualBlockId id = problem_.AddResidualBlock(cost.get(), loss, blocks);
  return {std::move(cost), id};
}

void OkvisEstimator::RemoveResidual(Residual* residual) {
  if (residual->id != nullptr) {
    problem_.RemoveResidualBlock(residual->id);
  }
  *residual = {};
}

}  // namespace sliding_window
