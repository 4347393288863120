// A pose graph as slam_toolbox keeps it: one ceres::Problem that lives as long as the robot drives,
// solved again at every loop that closes, with constraints and nodes taken out as they age. Knows
// nothing of inceres: run as it is, or with the drop-in preloaded.
//
//     living_pose_graph [--one_block]      a pose is three scalar blocks, or one of three
//
// Options are slam_toolbox's: sparse_normal_cholesky, dynamic_sparsity, steps that may go up,
// removal without a search.
#include <algorithm>
#include <array>
#include <cmath>
#include <cstdio>
#include <cstring>
#include <deque>
#include <random>
#include <string>
#include <vector>

#include <ceres/autodiff_cost_function.h>
#include <ceres/loss_function.h>
#include <ceres/problem.h>
#include <ceres/solver.h>
#include <ceres/version.h>
#if CERES_VERSION_MAJOR > 2 || CERES_VERSION_MINOR > 0
#include <ceres/autodiff_manifold.h>
#endif

namespace {

constexpr int kLap = 60;
constexpr int kNumPoses = 5 * kLap;
constexpr int kNumAged = 40;  // of the first lap, taken out at the end
constexpr double kSigmaMeters = 0.02;
constexpr double kSigmaRadians = 0.005;

using Pose = std::array<double, 3>;

template <typename T>
T Wrapped(const T& angle) {
  using std::floor;
  return angle - T(2.0 * M_PI) * floor((angle + T(M_PI)) / T(2.0 * M_PI));
}

// The motion from a to b, seen from a, less the one that was measured; whitened.
struct MotionError {
  explicit MotionError(const Pose& motion) : measured(motion) {}

  template <typename T>
  bool operator()(const T* x_a, const T* y_a, const T* yaw_a, const T* x_b, const T* y_b,
                  const T* yaw_b, T* residuals) const {
    using std::cos;
    using std::sin;
    const T dx = *x_b - *x_a, dy = *y_b - *y_a, c = cos(*yaw_a), s = sin(*yaw_a);
    residuals[0] = (c * dx + s * dy - measured[0]) / kSigmaMeters;
    residuals[1] = (c * dy - s * dx - measured[1]) / kSigmaMeters;
    residuals[2] = Wrapped(*yaw_b - *yaw_a - measured[2]) / kSigmaRadians;
    return true;
  }
  template <typename T>
  bool operator()(const T* a, const T* b, T* residuals) const {
    return (*this)(a, a + 1, a + 2, b, b + 1, b + 2, residuals);
  }

  const Pose measured;
};

#if CERES_VERSION_MAJOR > 2 || CERES_VERSION_MINOR > 0
struct AngleManifold {
  template <typename T>
  bool Plus(const T* x, const T* delta, T* result) const {
    *result = Wrapped(*x + *delta);
    return true;
  }
  template <typename T>
  bool Minus(const T* y, const T* x, T* delta) const {
    *delta = Wrapped(*y - *x);
    return true;
  }
};
#endif

class LivingGraph {
 public:
  explicit LivingGraph(bool one_block) : one_block_(one_block), problem_(Options()) {}

  void AddPose(const Pose& start) {
    poses_.push_back(start);
    double* pose = poses_.back().data();
    if (one_block_) {
      problem_.AddParameterBlock(pose, 3);
    } else {
      problem_.AddParameterBlock(pose, 1);
      problem_.AddParameterBlock(pose + 1, 1);
      problem_.AddParameterBlock(pose + 2, 1);
#if CERES_VERSION_MAJOR > 2 || CERES_VERSION_MINOR > 0
      problem_.SetManifold(pose + 2, new ceres::AutoDiffManifold<AngleManifold, 1, 1>);
#endif
    }
    if (poses_.size() == 1) {
      Hold(pose);
    }
  }

  void Hold(double* pose) {
    for (int k = 0; k < (one_block_ ? 1 : 3); ++k) {
      problem_.SetParameterBlockConstant(pose + k);
    }
  }

  void Connect(int a, int b, const Pose& measured) {
    double* from = poses_[static_cast<std::size_t>(a)].data();
    double* to = poses_[static_cast<std::size_t>(b)].data();
    ceres::LossFunction* loss = b - a > 1 ? new ceres::HuberLoss(3.0) : nullptr;
    if (one_block_) {
      problem_.AddResidualBlock(
          new ceres::AutoDiffCostFunction<MotionError, 3, 3, 3>(new MotionError(measured)), loss,
          from, to);
    } else {
      problem_.AddResidualBlock(new ceres::AutoDiffCostFunction<MotionError, 3, 1, 1, 1, 1, 1, 1>(
                                    new MotionError(measured)),
                                loss, from, from + 1, from + 2, to, to + 1, to + 2);
    }
  }

  // With its constraints, as Ceres does.
  void RemovePose(int i) {
    double* pose = poses_[static_cast<std::size_t>(i)].data();
    for (int k = 0; k < (one_block_ ? 1 : 3); ++k) {
      problem_.RemoveParameterBlock(pose + k);
    }
  }

  ceres::Solver::Summary Solve() {
    ceres::Solver::Options options;
    options.linear_solver_type = ceres::SPARSE_NORMAL_CHOLESKY;
    options.dynamic_sparsity = true;
    options.use_nonmonotonic_steps = true;
    options.max_num_consecutive_invalid_steps = 3;
    options.max_consecutive_nonmonotonic_steps = 3;
    options.max_num_iterations = 50;
    options.function_tolerance = 1e-6;
    options.logging_type = ceres::SILENT;
    ceres::Solver::Summary summary;
    ceres::Solve(options, &problem_, &summary);
    return summary;
  }

  const Pose& pose(int i) const {
    return poses_[static_cast<std::size_t>(i)];
  }

 private:
  static ceres::Problem::Options Options() {
    ceres::Problem::Options options;
    options.enable_fast_removal = true;
    return options;
  }

  const bool one_block_;
  std::deque<Pose> poses_;  // stay where they are
  ceres::Problem problem_;
};

Pose TruePose(int i) {
  const double angle = 2.0 * M_PI * i / kLap;
  return {8.0 * std::cos(angle), 5.0 * std::sin(angle),
          std::atan2(5.0 * std::cos(angle), -8.0 * std::sin(angle))};
}

Pose Motion(const Pose& a, const Pose& b) {
  const double c = std::cos(a[2]), s = std::sin(a[2]), dx = b[0] - a[0], dy = b[1] - a[1];
  return {c * dx + s * dy, c * dy - s * dx, Wrapped(b[2] - a[2])};
}

Pose After(const Pose& a, const Pose& motion) {
  const double c = std::cos(a[2]), s = std::sin(a[2]);
  return {a[0] + c * motion[0] - s * motion[1], a[1] + s * motion[0] + c * motion[1],
          a[2] + motion[2]};
}

class Robot {
 public:
  Pose Measure(int a, int b) {
    Pose motion = Motion(TruePose(a), TruePose(b));
    motion[0] += kSigmaMeters * noise_(engine_);
    motion[1] += kSigmaMeters * noise_(engine_);
    motion[2] += kSigmaRadians * noise_(engine_);
    return motion;
  }

 private:
  std::mt19937 engine_{42};
  std::normal_distribution<double> noise_;
};

int Drive(bool one_block) {
  LivingGraph graph(one_block);
  Robot robot;
  int num_solves = 0;
  ceres::Solver::Summary summary;
  for (int i = 0; i < kNumPoses; ++i) {
    const Pose step = i == 0 ? Pose() : robot.Measure(i - 1, i);
    graph.AddPose(i == 0 ? TruePose(0) : After(graph.pose(i - 1), step));
    if (i > 0) {
      graph.Connect(i - 1, i, step);
    }
    if (i >= kLap && i % 10 == 0) {  // recognized: here we were a lap ago
      graph.Connect(i - kLap, i, robot.Measure(i - kLap, i));
      summary = graph.Solve();
      ++num_solves;
      if (!summary.IsSolutionUsable()) {
        std::printf("pose %d: %s\n", i, summary.message.c_str());
        return 1;
      }
    }
  }
  for (int i = 1; i <= kNumAged; ++i) {  // the first lap's places, seen four times since
    if (i % 10 != 0) {
      graph.RemovePose(i);
    }
  }
  summary = graph.Solve();
  double largest = 0.0;
  for (int i = kLap; i < kNumPoses; ++i) {
    const Pose error = Motion(TruePose(i), graph.pose(i));
    largest = std::max(largest, std::hypot(error[0], error[1]));
  }
  std::printf("%d solves, the last after %d poses were removed\n", num_solves + 1,
              kNumAged - kNumAged / 10);
  std::printf("cost %.6f, largest error %.4f m\n", summary.final_cost, largest);
  return summary.IsSolutionUsable() ? 0 : 1;
}

}  // namespace

int main(int argc, char** argv) {
  const bool one_block = argc > 1 && std::strcmp(argv[1], "--one_block") == 0;
  if (argc > 2 || (argc == 2 && !one_block)) {
    std::fprintf(stderr, "usage: %s [--one_block]\n", argv[0]);
    return 2;
  }
  return Drive(one_block);
}
