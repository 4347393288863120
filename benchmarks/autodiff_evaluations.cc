// Residuals and Jacobians by inceres::AutoDiffCostFunction and by ceres::AutoDiffCostFunction, in
// turn, of the same functors. Prints a row per functor: nanoseconds an evaluation of both in their
// fastest rounds, which others on the machine disturb least, and the ratio. CMake builds it once
// per set of flags that a user's program may have: -O2, -O3, both with -march=x86-64-v3.
//
//   build/bin/autodiff_evaluations_O3 FILE [ROUNDS]      FILE: BAL; 41 rounds unless told

#include <algorithm>
#include <chrono>
#include <cmath>
#include <cstdio>
#include <cstdlib>
#include <memory>
#include <string>
#include <vector>

#include <ceres/autodiff_cost_function.h>

#include "inceres/autodiff/jet_eigen.h"
#include "inceres/ceres/autodiff_cost_function.h"
#include "inceres/factors/bal_reprojection.h"
#include "inceres/io/bal.h"
#include "tools/problems/bal_cost.h"
#include "tools/problems/factor_cost_function.h"
#include "tools/problems/pose_graph_cost.h"

namespace {

using inceres::BalObservation;
using inceres::BalProblem;
using inceres::tools::BalReprojectionError;
using inceres::tools::Se3BetweenError;

// A layer of a network: no derivative is zero for long.
struct LayerError {
  double shift;
  template <typename T>
  bool operator()(const T* weights, const T* inputs, T* residuals) const {
    for (int r = 0; r < 4; ++r) {
      T sum(shift);
      for (int k = 0; k < 4; ++k) {
        sum += weights[4 * r + k] * inputs[k];
      }
      residuals[r] = sum / (1.0 + sum * sum);
    }
    const T mean = 0.25 * (residuals[0] + residuals[1] + residuals[2] + residuals[3]);
    for (int r = 0; r < 4; ++r) {
      residuals[r] = residuals[r] * mean - mean / (2.0 + residuals[r] * residuals[r]);
    }
    return true;
  }
};

using CostFunctions = std::vector<std::unique_ptr<const ceres::CostFunction>>;

// Cost functions of one type, at values of their own.
struct Workload {
  CostFunctions stock;
  CostFunctions ours;
  std::vector<std::vector<const double*>> parameters;
};

double NanosecondsAnEvaluation(const CostFunctions& costs, const Workload& workload) {
  const ceres::CostFunction& first = *costs.front();
  std::vector<double> residuals(static_cast<std::size_t>(first.num_residuals()));
  std::vector<std::vector<double>> jacobians;
  std::vector<double*> pointers;
  for (const int size : first.parameter_block_sizes()) {
    jacobians.emplace_back(residuals.size() * static_cast<std::size_t>(size));
    pointers.push_back(jacobians.back().data());
  }
  const auto start = std::chrono::steady_clock::now();
  for (std::size_t i = 0; i < costs.size(); ++i) {
    costs[i]->Evaluate(workload.parameters[i].data(), residuals.data(), pointers.data());
  }
  const std::chrono::duration<double, std::nano> time = std::chrono::steady_clock::now() - start;
  return time.count() / static_cast<double>(costs.size());
}

void Measure(const char* name, const Workload& workload, int rounds) {
  std::vector<double> stock, ours;
  for (int round = 0; round < rounds; ++round) {
    stock.push_back(NanosecondsAnEvaluation(workload.stock, workload));
    ours.push_back(NanosecondsAnEvaluation(workload.ours, workload));
  }
  const double fastest_stock = *std::min_element(stock.begin(), stock.end());
  const double fastest_ours = *std::min_element(ours.begin(), ours.end());
  std::printf("%-28s %9.1f %9.1f %8.3f\n", name, fastest_stock, fastest_ours,
              fastest_ours / fastest_stock);
}

Workload BalWorkload(const BalProblem& bal, bool analytic) {
  Workload workload;
  for (const BalObservation& observation : bal.observations) {
    workload.stock.emplace_back(BalReprojectionError::Create(observation));
    workload.ours.emplace_back(
        analytic ? inceres::tools::MakeFactorCost<inceres::BalReprojectionFamily>(
                       {observation.x, observation.y})
                 : BalReprojectionError::Create<inceres::AutoDiffCostFunction>(observation));
    workload.parameters.push_back(
        {bal.CameraData(observation.camera), bal.PointData(observation.point)});
  }
  return workload;
}

// Of `count` functors, at one of values each.
template <typename Functor, int kResiduals, int... Ns>
Workload FunctorWorkload(const Functor& functor, const std::vector<double>& values, int count) {
  Workload workload;
  std::vector<const double*> parameters;
  const double* next = values.data();
  for (const int size : {Ns...}) {
    parameters.push_back(next);
    next += size;
  }
  for (int i = 0; i < count; ++i) {
    workload.stock.emplace_back(
        new ceres::AutoDiffCostFunction<Functor, kResiduals, Ns...>(new Functor(functor)));
    workload.ours.emplace_back(
        new inceres::AutoDiffCostFunction<Functor, kResiduals, Ns...>(new Functor(functor)));
    workload.parameters.push_back(parameters);
  }
  return workload;
}

std::vector<double> Values(int count) {
  std::vector<double> values(static_cast<std::size_t>(count));
  for (std::size_t i = 0; i < values.size(); ++i) {
    values[i] = std::sin(1.0 + static_cast<double>(i));
  }
  return values;
}

}  // namespace

int main(int argc, char** argv) {
  const int rounds = argc > 2 ? std::atoi(argv[2]) : 41;
  if (argc < 2 || rounds < 1) {
    std::fprintf(stderr, "usage: %s BAL_FILE [ROUNDS]\n", argv[0]);
    return 2;
  }
  BalProblem bal;
  const inceres::Status status = inceres::ReadBal(argv[1], &bal);
  if (!status.ok()) {
    std::fprintf(stderr, "%s\n", status.message.c_str());
    return 1;
  }
  std::printf("%-28s %9s %9s %8s\n", "functor", "Ceres ns", "ours ns", "ratio");
  Measure("Snavely's camera", BalWorkload(bal, false), rounds);
  Measure("the same, ours analytic", BalWorkload(bal, true), rounds);
  const std::vector<double> values = Values(20);
  const Se3BetweenError between(Eigen::Vector3d(1.0, 2.0, 3.0), Eigen::Quaterniond::Identity(),
                                Se3BetweenError::Matrix6d::Identity());
  Measure("relative pose, Eigen",
          FunctorWorkload<Se3BetweenError, 6, 3, 4, 3, 4>(between, values, 10000), rounds);
  Measure("layer of a network",
          FunctorWorkload<LayerError, 4, 16, 4>(LayerError{0.5}, values, 10000), rounds);
  return 0;
}
