// Small problems, where setting up weighs as much as solving: ours and stock Ceres in turn, whole
// calls from inceres::Solve or ceres::Solve until it returns, with stock in each linear solver that
// could be the fastest. Prints a row per problem and solver: microseconds of both (medians) and the
// median of the ratios; the last column is the ratio to the fastest stock configuration.
//
//   build/bin/small_solves [ROUNDS]      rounds of one solve each, 501 unless told

#include <array>
#include <chrono>
#include <cmath>
#include <cstdio>
#include <cstdlib>
#include <functional>
#include <string>
#include <vector>

#include <ceres/ceres.h>

#include "inceres/ceres/solve.h"
#include "tools/ab/statistics.h"

namespace {

using inceres::tools::Summarize;

constexpr int kNumSamples = 53;

// y = a exp(b t) + c at one t, and at all of them.
struct OneSample {
  double t;
  double y;
  template <typename T>
  bool operator()(const T* p, T* residual) const {
    residual[0] = p[0] * exp(p[1] * T(t)) + p[2] - T(y);
    return true;
  }
  template <typename T>
  bool operator()(const T* a, const T* b, const T* c, T* residual) const {
    residual[0] = a[0] * exp(b[0] * T(t)) + c[0] - T(y);
    return true;
  }
};

OneSample Sample(int i) {
  const double t = 0.1 * i;
  return {t, 2.0 * std::exp(0.3 * t) + 0.5 + 0.05 * std::sin(17.0 * i)};
}

struct AllSamples {
  AllSamples() {
    for (int i = 0; i < kNumSamples; ++i) {
      samples.push_back(Sample(i));
    }
  }
  template <typename T>
  bool operator()(const T* p, T* residuals) const {
    for (const OneSample& sample : samples) {
      sample(p, residuals++);
    }
    return true;
  }
  std::vector<OneSample> samples;
};

struct SmallProblem {
  std::string name;
  std::function<void(double* parameters, ceres::Problem*)> build;
};

std::vector<SmallProblem> Problems() {
  return {
      {"53 residual blocks, one block of 3",
       [](double* p, ceres::Problem* problem) {
         for (int i = 0; i < kNumSamples; ++i) {
           problem->AddResidualBlock(
               new ceres::AutoDiffCostFunction<OneSample, 1, 3>(new OneSample(Sample(i))), nullptr,
               p);
         }
       }},
      {"53 residual blocks, three blocks of 1",
       [](double* p, ceres::Problem* problem) {
         for (int i = 0; i < kNumSamples; ++i) {
           problem->AddResidualBlock(
               new ceres::AutoDiffCostFunction<OneSample, 1, 1, 1, 1>(new OneSample(Sample(i))),
               nullptr, p, p + 1, p + 2);
         }
       }},
      {"one residual block of 53, one block of 3",
       [](double* p, ceres::Problem* problem) {
         problem->AddResidualBlock(
             new ceres::AutoDiffCostFunction<AllSamples, kNumSamples, 3>(new AllSamples), nullptr,
             p);
       }},
  };
}

struct Run {
  std::vector<double> microseconds;
  double cost = 0.0;
  std::size_t num_iterations = 0;
};

template <typename SolveFunction>
void Time(const SmallProblem& small, const ceres::Solver::Options& options,
          const SolveFunction& solve, Run* run) {
  std::array<double, 3> p = {1.8, 0.31, 0.4};
  ceres::Problem problem;
  small.build(p.data(), &problem);
  ceres::Solver::Summary summary;
  const auto start = std::chrono::steady_clock::now();
  solve(options, &problem, &summary);
  run->microseconds.push_back(
      std::chrono::duration<double, std::micro>(std::chrono::steady_clock::now() - start).count());
  run->cost = summary.final_cost;
  run->num_iterations = summary.iterations.size();
}

void Compare(const SmallProblem& small, int num_rounds) {
  const std::array<ceres::LinearSolverType, 3> types = {
      ceres::DENSE_QR, ceres::DENSE_NORMAL_CHOLESKY, ceres::SPARSE_NORMAL_CHOLESKY};
  std::array<Run, 3> ours;
  std::array<Run, 3> stock;
  for (int round = 0; round < num_rounds; ++round) {
    for (std::size_t k = 0; k < types.size(); ++k) {
      ceres::Solver::Options options;
      options.linear_solver_type = types[k];
      options.logging_type = ceres::SILENT;
      const auto run_ours = [](const auto& o, auto* problem, auto* summary) {
        inceres::Solve(o, problem, summary);
      };
      const auto run_stock = [](const auto& o, auto* problem, auto* summary) {
        ceres::Solve(o, problem, summary);
      };
      Time(small, options, run_ours, &ours[k]);
      Time(small, options, run_stock, &stock[k]);
    }
  }
  double fastest = Summarize(stock[0].microseconds).median;
  for (const Run& run : stock) {
    fastest = std::min(fastest, Summarize(run.microseconds).median);
  }
  std::printf("%s\n", small.name.c_str());
  for (std::size_t k = 0; k < types.size(); ++k) {
    std::printf(
        "  %-24s ours %7.1f us, stock %7.1f us, ratio %5.3f, to the fastest stock %5.3f; "
        "iterations %zu, %zu; cost %.12g, "
        "%.12g\n",
        ceres::LinearSolverTypeToString(types[k]), Summarize(ours[k].microseconds).median,
        Summarize(stock[k].microseconds).median,
        inceres::tools::SummarizeRatios(ours[k].microseconds, stock[k].microseconds).median,
        Summarize(ours[k].microseconds).median / fastest, ours[k].num_iterations,
        stock[k].num_iterations, ours[k].cost, stock[k].cost);
  }
}

}  // namespace

int main(int argc, char** argv) {
  const int num_rounds = argc > 1 ? std::atoi(argv[1]) : 501;
  if (num_rounds < 1 || argc > 2) {
    std::fprintf(stderr, "usage: small_solves [ROUNDS]: ROUNDS is a positive number\n");
    return 2;
  }
  for (const SmallProblem& small : Problems()) {
    Compare(small, num_rounds);
  }
  return 0;
}
