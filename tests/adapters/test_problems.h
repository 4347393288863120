#pragma once

#include <deque>
#include <functional>
#include <memory>
#include <random>
#include <utility>
#include <vector>

#include <ceres/ceres.h>

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

using Recipe = std::function<std::unique_ptr<TestProblem>()>;

/// A cost function with given sizes whose Evaluate is never called in the tests that use it: for
/// tests of structure.
class ShapeOnlyCost : public ceres::CostFunction {
 public:
  ShapeOnlyCost(int num_residuals, std::vector<int> sizes) {
    set_num_residuals(num_residuals);
    mutable_parameter_block_sizes()->assign(sizes.begin(), sizes.end());
  }
  bool Evaluate(double const* const*, double*, double**) const override { return false; }
};

/// r = x − target, any size, with a hook called before each evaluation; the hook's result is
/// returned.
class TargetCost : public ceres::CostFunction {
 public:
  using Hook =
      std::function<bool(double const* const* parameters, double* residuals, double** jacobians)>;
  explicit TargetCost(std::vector<double> target, Hook hook = nullptr);
  bool Evaluate(double const* const* parameters, double* residuals,
                double** jacobians) const override;

 private:
  std::vector<double> target_;
  Hook hook_;
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

}  // namespace inceres::testing
