// Lesson 2, swap Ceres: one ceres::Problem, solved by ceres::Solve and by inceres::Solve.
//
//     02_swap_ceres bal_data/street-16-1200-pre.txt
#include <chrono>
#include <cmath>
#include <cstdio>
#include <iostream>

#include <ceres/ceres.h>
#include <ceres/rotation.h>
#include <inceres/ceres/solve.h>
#include <inceres/io/bal.h>

namespace {

// What a user of Ceres has already: a cost function and a problem.
struct ReprojectionError {
  double x, y;
  template <typename T>
  bool operator()(const T* camera, const T* point, T* residuals) const {
    T p[3];
    ceres::AngleAxisRotatePoint(camera, point, p);
    const T u = -(p[0] + camera[3]) / (p[2] + camera[5]);
    const T v = -(p[1] + camera[4]) / (p[2] + camera[5]);
    const T r2 = u * u + v * v;
    const T scale = camera[6] * (1.0 + r2 * (camera[7] + r2 * camera[8]));
    residuals[0] = scale * u - x;
    residuals[1] = scale * v - y;
    return true;
  }
};

void Build(inceres::BalProblem* bal, ceres::Problem* problem) {
  for (const inceres::BalObservation& seen : bal->observations) {
    using Cost = ceres::AutoDiffCostFunction<ReprojectionError, 2, 9, 3>;
    problem->AddResidualBlock(new Cost(new ReprojectionError{seen.x, seen.y}), nullptr,
                              bal->CameraData(seen.camera), bal->PointData(seen.point));
  }
}

ceres::Solver::Options Options() {
  ceres::Solver::Options options;
  options.linear_solver_type = ceres::DENSE_SCHUR;
  options.logging_type = ceres::SILENT;
  return options;
}

// [quoted in docs/lessons/02_swap_ceres.md]
struct CeresItself {
  void operator()(const ceres::Solver::Options& options, ceres::Problem* problem,
                  ceres::Solver::Summary* summary) const {
    ceres::Solve(options, problem, summary);
  }
};

struct Inceres {
  void operator()(const ceres::Solver::Options& options, ceres::Problem* problem,
                  ceres::Solver::Summary* summary) const {
    inceres::SolveReport report;  // optional, as is the argument before it
    inceres::Solve(options, problem, summary, inceres::SolveOptions(), &report);
    if (!report.fallback_reason.empty()) {  // Ceres has solved it after all, and here is why
      std::cout << "handed to Ceres: " << report.fallback_reason << '\n';
    }
  }
};
// [end of quote]

// Solves a copy of the problem, so that all start from the same place; the first of two solves
// meets cold caches and is not timed.
template <typename Solver>
ceres::Solver::Summary Run(const char* name, const inceres::BalProblem& bal, Solver solve) {
  ceres::Solver::Summary summary;
  double milliseconds = 0.0;
  for (int round = 0; round < 2; ++round) {
    inceres::BalProblem copy = bal;
    ceres::Problem problem;
    Build(&copy, &problem);
    const auto begin = std::chrono::steady_clock::now();
    solve(Options(), &problem, &summary);
    milliseconds =
        std::chrono::duration<double, std::milli>(std::chrono::steady_clock::now() - begin).count();
  }
  std::printf("%-8s %10.4f %10d   %-12s %7.1f ms\n", name, summary.final_cost,
              summary.num_successful_steps + summary.num_unsuccessful_steps - 1,
              ceres::TerminationTypeToString(summary.termination_type), milliseconds);
  return summary;
}

}  // namespace

int main(int argc, char** argv) {
  if (argc != 2) {
    std::cerr << "usage: 02_swap_ceres FILE\n";
    return 2;
  }
  inceres::BalProblem bal;
  if (const inceres::Status status = inceres::ReadBal(argv[1], &bal); !status.ok()) {
    std::cerr << status.message << '\n';
    return 1;
  }
  std::printf("%-8s %10s %10s   %-12s %10s\n", "", "cost", "iterations", "end", "time");
  const ceres::Solver::Summary stock = Run("ceres", bal, CeresItself());
  const ceres::Solver::Summary ours = Run("inceres", bal, Inceres());
  std::printf("\nSame trace: ");
  double largest = 0.0;
  for (std::size_t i = 0; i < stock.iterations.size() && i < ours.iterations.size(); ++i) {
    const double difference = ours.iterations[i].cost - stock.iterations[i].cost;
    largest = std::max(largest, std::fabs(difference) / stock.iterations[i].cost);
  }
  std::printf("the costs of %zu and %zu iterations agree to %s\n", stock.iterations.size(),
              ours.iterations.size(), largest < 1e-10 ? "ten digits" : "fewer than ten digits");
  return largest < 1e-10 && stock.iterations.size() == ours.iterations.size() ? 0 : 1;
}
