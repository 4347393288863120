#pragma once

#include <deque>
#include <functional>
#include <memory>
#include <random>
#include <utility>
#include <vector>

#include <ceres/ceres.h>

#include "support/ceres_lambdas.h"

namespace inceres::testing {

/// A ceres::Problem with the memory of its parameter blocks. Built twice from the same recipe, it
/// gives the same problem at other addresses.
struct TestProblem {
  explicit TestProblem(const ceres::Problem::Options& options = ceres::Problem::Options())
      : problem(options), evaluation_callback(options.evaluation_callback) {}

  ceres::Problem problem;
  ceres::EvaluationCallback* evaluation_callback;
  std::deque<std::vector<double>> blocks;

  double* Add(std::vector<double> values) { return blocks.emplace_back(std::move(values)).data(); }
};

/// Records what it sees, and the memory of the problem then; stops at an iteration.
class Recorder : public ceres::IterationCallback {
 public:
  explicit Recorder(const TestProblem* test, int stop_at = -1,
                    ceres::CallbackReturnType stop_with = ceres::SOLVER_CONTINUE)
      : test_(test), stop_at_(stop_at), stop_with_(stop_with) {}
  ceres::CallbackReturnType operator()(const ceres::IterationSummary& summary) override {
    iterations.push_back(summary);
    memory.push_back(test_->blocks);
    return summary.iteration == stop_at_ ? stop_with_ : ceres::SOLVER_CONTINUE;
  }

  std::vector<ceres::IterationSummary> iterations;
  std::vector<std::deque<std::vector<double>>> memory;

 private:
  const TestProblem* test_;
  int stop_at_;
  ceres::CallbackReturnType stop_with_;
};

using Recipe = std::function<std::unique_ptr<TestProblem>()>;

/// A cost function with given sizes whose Evaluate is never called in the tests that use it: for
/// tests of structure.
class ShapeOnlyCost : public lambdas::Cost {
 public:
  ShapeOnlyCost(int num_residuals, const std::vector<int>& sizes)
      : Cost(num_residuals, sizes, [](auto...) { return false; }) {}
};

/// r = x − target, any size, with a hook called after each evaluation; the hook's result is
/// returned.
class TargetCost : public lambdas::Cost {
 public:
  explicit TargetCost(const std::vector<double>& target, const Function& hook = nullptr);
};

/// Powell's singular function: four blocks of size 1, four residual blocks.
std::unique_ptr<TestProblem> MakePowell();

/// y = exp(m x + c) with noise and two outliers; `loss_width` > 0 adds a Cauchy loss.
std::unique_ptr<TestProblem> MakeCurveFit(double loss_width);

/// Angle-axis cameras of size 9 on an arc and points of size 3; the first camera is constant if
/// asked for.
std::unique_ptr<TestProblem> MakeBundle(int num_cameras, int num_points,
                                        bool first_camera_constant);

/// A window as VINS writes it: poses 7/6 through a LocalParameterization (first constant), a
/// constant extrinsic, inverse depths, velocity blocks of size 9, one dense prior, one residual
/// block that touches only constants, one block that nothing touches.
std::unique_ptr<TestProblem> MakeWindow(int num_poses, int num_features, bool huber);

/// 6 cameras, the first one constant, and 80 points; 6 poses and 40 features with a Huber loss.
std::unique_ptr<TestProblem> MediumBundle();
std::unique_ptr<TestProblem> MediumWindow();

/// A closed curve of 30 control points fitted to 120 points: residual blocks that touch all control
/// points, of which three count (support/closed_curve.h), and springs between neighbors.
std::unique_ptr<TestProblem> MakeClosedCurve(unsigned seed, bool huber);

}  // namespace inceres::testing
