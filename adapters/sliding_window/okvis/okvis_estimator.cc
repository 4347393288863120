#include "okvis/okvis_estimator.h"

#include <algorithm>

#include "common/imu_residual.h"
#include "common/triangulation.h"
#include "okvis/imu_error.h"
#include "okvis/prior_errors.h"
#include "okvis/reprojection_error.h"

namespace sliding_window {

namespace {

constexpr double kKeyframeOverlap = 0.6;   // of the features of the last keyframe and the image
constexpr double kFirstInformation = 1e8;  // of the first pose's position and yaw
constexpr double kExtrinsicSigmaP = 0.02;  // m
constexpr double kExtrinsicSigmaR = 0.02;  // rad

ceres::Problem::Options OwnNothing() {
  ceres::Problem::Options options;
  options.cost_function_ownership = ceres::DO_NOT_TAKE_OWNERSHIP;
  options.loss_function_ownership = ceres::DO_NOT_TAKE_OWNERSHIP;
  options.manifold_ownership = ceres::DO_NOT_TAKE_OWNERSHIP;
  options.enable_fast_removal = true;
  return options;
}

}  // namespace

OkvisEstimator::OkvisEstimator(const EstimatorOptions& options, const OkvisOptions& okvis_options, SolveFunction solve,
                               const ImuState& start, const Pose& body_from_camera)
    : options_(options), okvis_options_(okvis_options), solve_(std::move(solve)), start_(start), problem_(OwnNothing()) {
  body_from_camera.ToParameters(extrinsic_);
  problem_.AddParameterBlock(extrinsic_, 7, &pose_manifold_);
  if (!options_.free_extrinsics) {
    problem_.SetParameterBlockConstant(extrinsic_);
    return;
  }
  PoseError::Vector6 sigma;
  sigma << Eigen::Vector3d::Constant(kExtrinsicSigmaP), Eigen::Vector3d::Constant(kExtrinsicSigmaR);
  extrinsic_prior_ =
      AddResidual(std::make_unique<PoseError>(body_from_camera, sigma.array().square().inverse()), nullptr, {extrinsic_});
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

void OkvisEstimator::AddBlocks(int id, const Frame& frame) {
  FrameBlocks& blocks = frames_[id];
  problem_.AddParameterBlock(blocks.pose, 7, &pose_manifold_);
  problem_.AddParameterBlock(blocks.speed_bias, 9);
  if (id == 0) {
    StateToBlocks(start_, blocks.pose, blocks.speed_bias);
    SetPosePrior(id, kFirstInformation);
    SpeedAndBiasError::Vector9 sigma;
    sigma << Eigen::Vector3d::Constant(0.1), Eigen::Vector3d::Constant(0.02), Eigen::Vector3d::Constant(0.2);
    blocks.speed_bias_prior = AddResidual(
        std::make_unique<SpeedAndBiasError>(SpeedAndBiasError::Vector9(blocks.speed_bias), sigma.array().square().inverse()),
        nullptr, {blocks.speed_bias});
    return;
  }
  FrameBlocks& before = frames_.at(id - 1);
  const ImuState state = StateFromBlocks(before.pose, before.speed_bias);
  const ImuPreintegration imu(options_.imu_noise, frame.imu, state.ba, state.bg);
  StateToBlocks(Propagate(imu, state), blocks.pose, blocks.speed_bias);
  blocks.imu = AddResidual(std::make_unique<ImuError>(options_.imu_noise, frame.imu, state.ba, state.bg), nullptr,
                           {before.pose, before.speed_bias, blocks.pose, blocks.speed_bias});
}

void OkvisEstimator::AddObservations(int id, const std::vector<Observation>& observations) {
  const double weight = options_.focal_length / options_.pixel_noise;
  for (const Observation& observation : observations) {
    Landmark& landmark = landmarks_[observation.feature];
    Sighting& sighting = landmark.sightings[id];
    sighting.xy = observation.xy;
    sighting.residual.cost = std::make_unique<ReprojectionError>(observation.xy, weight);
    if (landmark.is_variable) {
      sighting.residual = AddResidual(std::move(sighting.residual.cost), &loss_, {frames_.at(id).pose, landmark.x, extrinsic_});
    } else {
      AddLandmarkIfSeenWell(&landmark);
    }
  }
}

void OkvisEstimator::AddLandmarkIfSeenWell(Landmark* landmark) {
  std::vector<Sight> sights;
  for (const auto& [id, sighting] : landmark->sightings) {
    sights.push_back({Pose::FromParameters(frames_.at(id).pose) * Pose::FromParameters(extrinsic_), sighting.xy});
  }
  const auto point = sights.size() >= 2 ? Triangulate(sights) : std::nullopt;
  if (!point) {
    return;
  }
  Eigen::Map<Eigen::Vector4d>{landmark->x} = point->homogeneous();
  landmark->is_variable = true;
  problem_.AddParameterBlock(landmark->x, 4, &point_manifold_);
  for (auto& [id, sighting] : landmark->sightings) {
    sighting.residual = AddResidual(std::move(sighting.residual.cost), &loss_, {frames_.at(id).pose, landmark->x, extrinsic_});
  }
}

bool OkvisEstimator::IsKeyframe(int id, const std::vector<Observation>& observations) const {
  const auto last = std::find_if(frames_.rbegin(), frames_.rend(), [](const auto& frame) { return frame.second.is_keyframe; });
  if (last == frames_.rend()) {
    return true;
  }
  const auto num_shared = std::count_if(observations.begin(), observations.end(), [&](const Observation& observation) {
    return landmarks_.at(observation.feature).sightings.count(last->first) > 0;
  });
  return id > last->first && static_cast<double>(num_shared) < kKeyframeOverlap * static_cast<double>(observations.size());
}

// Position and yaw, which no sensor tells, of the frame that is the oldest now.
void OkvisEstimator::SetPosePrior(int id, double information) {
  RemoveResidual(&pose_prior_);
  PoseError::Vector6 diagonal;
  diagonal << information, information, information, 0.0, 0.0, information;
  double* pose = frames_.at(id).pose;
  pose_prior_ = AddResidual(std::make_unique<PoseError>(Pose::FromParameters(pose), diagonal), nullptr, {pose});
}

void OkvisEstimator::SetAllConstantBut(int newest, bool constant) {
  const FrameBlocks& free = frames_.at(newest);
  ForEachBlock([&](double* block, int /*size*/) {
    if (block == free.pose || block == free.speed_bias || (block == extrinsic_ && !options_.free_extrinsics)) {
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
    ForEachBlock([&](double* block, int size) { solver.linear_solver_ordering->AddElementToGroup(block, size == 4 ? 0 : 1); });
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
  visit(extrinsic_, 7);
}

ImuState OkvisEstimator::newest_state() const {
  return frames_.empty() ? start_ : StateFromBlocks(frames_.rbegin()->second.pose, frames_.rbegin()->second.speed_bias);
}

std::vector<double> OkvisEstimator::Values() {
  std::vector<double> values;
  ForEachBlock([&](const double* block, int size) { values.insert(values.end(), block, block + size); });
  return values;
}

void OkvisEstimator::SetValues(const std::vector<double>& values) {
  auto from = values.begin();
  ForEachBlock([&](double* block, int size) {
    std::copy(from, from + size, block);
    from += size;
  });
}

OkvisEstimator::Residual OkvisEstimator::AddResidual(std::unique_ptr<ceres::CostFunction> cost, ceres::LossFunction* loss,
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
