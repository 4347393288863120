#include <algorithm>
#include <cmath>
#include <cstddef>
#include <cstdint>
#include <memory>
#include <random>
#include <string>
#include <utility>
#include <vector>

#include "inceres/problem/rotation.h"
#include "inceres/solver/solver.h"
#include "tools/problems/problem_source.h"
#include "tools/replay/replay_scripts.h"

namespace inceres::tools {
namespace {

constexpr double kRotationNoise = 1e-3;     // rad
constexpr double kTranslationNoise = 1e-4;  // of the median point distance
constexpr double kPointNoise = 2e-3;        // of the median point distance
constexpr double kPriorFactor = 10.0;  // standard deviations of the prior over those of the noise

// Standard normal numbers from the engine's bits by Box and Muller's formula: the same with every
// standard library.
class Gauss {
 public:
  explicit Gauss(unsigned seed) : engine_(seed) {}

  double operator()() {
    const double u = (static_cast<double>(engine_() >> 11) + 1.0) * 0x1p-53;  // (0, 1]
    const double v = static_cast<double>(engine_() >> 11) * 0x1p-53;
    return std::sqrt(-2.0 * std::log(u)) * std::cos(2.0 * M_PI * v);
  }

 private:
  std::mt19937_64 engine_;
};

// ‖R X + t‖ of every observation.
double MedianPointDistance(const BalProblem& bal) {
  std::vector<double> distances;
  for (const BalObservation& observation : bal.observations) {
    const double* camera = bal.CameraData(observation.camera);
    const RotationCoefficients k =
        CoefficientsOfAngle(camera[0] * camera[0] + camera[1] * camera[1] + camera[2] * camera[2]);
    double R[9], P[3];
    RotationPolynomial(camera, k.sinc, k.cosc, R);
    MultiplyMatrixVector(R, bal.PointData(observation.point), P);
    distances.push_back(std::hypot(P[0] + camera[3], P[1] + camera[4], P[2] + camera[5]));
  }
  const auto middle = distances.begin() + static_cast<std::ptrdiff_t>(distances.size() / 2);
  std::nth_element(distances.begin(), middle, distances.end());
  return *middle;
}

// Observations by camera and by point, as indices.
struct Sightings {
  explicit Sightings(const BalProblem& bal)
      : of_camera(static_cast<std::size_t>(bal.num_cameras)),
        of_point(static_cast<std::size_t>(bal.num_points)) {
    for (std::size_t i = 0; i < bal.observations.size(); ++i) {
      of_camera[static_cast<std::size_t>(bal.observations[i].camera)].push_back(i);
      of_point[static_cast<std::size_t>(bal.observations[i].point)].push_back(i);
    }
  }
  std::vector<std::vector<std::size_t>> of_camera;
  std::vector<std::vector<std::size_t>> of_point;
};

class BalScript {
 public:
  BalScript(const BalProblem& bal, const BalReplayOptions& options)
      : bal_(bal),
        options_(options),
        sightings_(bal),
        distance_(MedianPointDistance(bal)),
        gauss_(options.seed),
        camera_variable_(static_cast<std::size_t>(bal.num_cameras), -1),
        point_variable_(static_cast<std::size_t>(bal.num_points), -1) {}

  std::vector<ReplayStep> Make() {
    std::vector<ReplayStep> steps(static_cast<std::size_t>(bal_.num_cameras - 1));
    for (int camera = 0; camera < bal_.num_cameras; ++camera) {
      AddCamera(camera, &steps[static_cast<std::size_t>(std::max(camera - 1, 0))]);
    }
    return steps;
  }

 private:
  void AddCamera(int camera, ReplayStep* step) {
    const double* values = bal_.CameraData(camera);
    ReplayVariable variable;
    variable.kind = options_.free_intrinsics ? ReplayVariable::Kind::kBalCamera
                                             : ReplayVariable::Kind::kBalCameraPose;
    variable.constant = camera == 0;
    std::copy_n(values, 9, variable.start.begin());
    std::vector<double> sigmas(3, kRotationNoise);
    sigmas.resize(6, kTranslationNoise * distance_);
    camera_variable_[static_cast<std::size_t>(camera)] = Add(variable, sigmas, step);

    for (const std::size_t i : sightings_.of_camera[static_cast<std::size_t>(camera)]) {
      const int point = bal_.observations[i].point;
      step->closes_loop = step->closes_loop || WasLost(point, camera);
      if (point_variable_[static_cast<std::size_t>(point)] >= 0) {
        AddObservation(bal_.observations[i], step);
      } else if (SeenByAnotherBefore(point, camera)) {
        AddPoint(point, camera, step);
      }
    }
  }

  bool SeenByAnotherBefore(int point, int camera) const {
    const std::vector<std::size_t>& all = sightings_.of_point[static_cast<std::size_t>(point)];
    return std::any_of(all.begin(), all.end(),
                       [&](std::size_t i) { return bal_.observations[i].camera < camera; });
  }

  // Whether the point was seen before, but not lately.
  bool WasLost(int point, int camera) const {
    int last = -1;
    for (const std::size_t i : sightings_.of_point[static_cast<std::size_t>(point)]) {
      const int seen_by = bal_.observations[i].camera;
      last = seen_by < camera ? std::max(last, seen_by) : last;
    }
    return options_.loop_gap > 0 && last >= 0 && camera - last > options_.loop_gap;
  }

  // The point with its observations by earlier cameras and the first by this one; the caller goes
  // on with any others.
  void AddPoint(int point, int camera, ReplayStep* step) {
    ReplayVariable variable;
    variable.kind = ReplayVariable::Kind::kPoint;
    std::copy_n(bal_.PointData(point), 3, variable.start.begin());
    point_variable_[static_cast<std::size_t>(point)] =
        Add(variable, std::vector<double>(3, kPointNoise * distance_), step);
    bool first_by_this_camera = true;
    for (const std::size_t i : sightings_.of_point[static_cast<std::size_t>(point)]) {
      const int seen_by = bal_.observations[i].camera;
      if (seen_by < camera || (seen_by == camera && first_by_this_camera)) {
        AddObservation(bal_.observations[i], step);
        first_by_this_camera = first_by_this_camera && seen_by != camera;
      }
    }
  }

  void AddObservation(const BalObservation& observation, ReplayStep* step) {
    step->factors.push_back({BalReprojectionFamily::Measurement{observation.x, observation.y},
                             {camera_variable_[static_cast<std::size_t>(observation.camera)],
                              point_variable_[static_cast<std::size_t>(observation.point)]},
                             kUnitHuber});
  }

  // Adds noise to the leading coordinates, the variable to the step, and the prior. Returns the
  // variable's number.
  int Add(ReplayVariable variable, const std::vector<double>& sigmas, ReplayStep* step) {
    const int number = num_variables_++;
    if (!variable.constant) {
      DiagonalPriorFamily::Measurement prior;
      for (std::size_t k = 0; k < sigmas.size(); ++k) {
        variable.start[k] += sigmas[k] * gauss_();
        prior.mean.push_back(variable.start[k]);
        prior.sqrt_information.push_back(1.0 / (kPriorFactor * sigmas[k]));
      }
      if (options_.priors) {
        step->factors.push_back({prior, {number}, {}});
      }
    }
    step->variables.push_back(variable);
    return number;
  }

  const BalProblem& bal_;
  const BalReplayOptions& options_;
  const Sightings sightings_;
  const double distance_;
  Gauss gauss_;
  std::vector<int> camera_variable_;
  std::vector<int> point_variable_;  // -1: not in the problem yet
  int num_variables_ = 0;
};

}  // namespace

Status SolveForReplay(int num_threads, BalProblem* bal) {
  const BalSource source(*bal);
  std::unique_ptr<FactorGraph> graph;
  Status status = source.MakeGraph(kUnitHuber, &graph);
  if (!status.ok()) {
    return status;
  }
  SolverOptions options;
  options.num_threads = num_threads;
  options.max_num_iterations = 400;
  const Summary summary = inceres::Solve(options, graph.get());
  if (!summary.IsSolutionUsable()) {
    return Status::Error(StatusCode::kEvaluationFailed,
                         "solving the whole problem first: " + summary.message + summary.detail);
  }
  *bal = source.WithParameters(source.ParametersOf(*graph));
  return Status::Ok();
}

ReplayScript MakeBalReplay(const BalProblem& bal, const BalReplayOptions& options) {
  ReplayScript script;
  script.description = std::to_string(bal.num_cameras) + " cameras, " +
                       std::to_string(bal.num_points) + " points, " +
                       std::to_string(bal.observations.size()) + " observations";
  script.steps = BalScript(bal, options).Make();
  return script;
}

}  // namespace inceres::tools
