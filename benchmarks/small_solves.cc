// Small problems, where setting up weighs as much as solving, and one of mostly constant blocks,
// where reading the problem does: ours and stock Ceres in turn, whole
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
#include <random>
#include <string>
#include <vector>

#include <ceres/ceres.h>
#include <ceres/rotation.h>

#include "curve_samples.h"
#include "inceres/ceres/solve.h"
#include "tools/ab/statistics.h"

namespace {

using inceres::benchmarks::kNumSamples;
using inceres::benchmarks::OneSample;
using inceres::benchmarks::Sample;
using inceres::tools::Summarize;

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

// A point of the map in a camera (angle-axis, translation), in pixels.
struct Seen {
  double u;
  double v;
  template <typename T>
  bool operator()(const T* camera, const T* point, T* residuals) const {
    T p[3];
    ceres::AngleAxisRotatePoint(camera, point, p);
    p[2] += camera[5];
    residuals[0] = 500.0 * (p[0] + camera[3]) / p[2] - u;
    residuals[1] = 500.0 * (p[1] + camera[4]) / p[2] - v;
    return true;
  }
};

// Cameras half a meter apart along x, in front of them points; the camera in the middle is to be
// localized, everything else is constant. Parameters: cameras, then points.
struct ConstantMap {
  static constexpr int kNumCameras = 40;
  static constexpr int kNumPoints = 2000;

  static std::vector<double> Start() {
    std::mt19937 random(1);
    const auto uniform = [&random](double low, double high) {
      return std::uniform_real_distribution<double>(low, high)(random);
    };
    std::vector<double> parameters;
    for (int c = 0; c < kNumCameras; ++c) {
      for (const double size : {0.01, 0.01, 0.01, 0.0, 0.1, 0.1}) {
        parameters.push_back(uniform(-size, size));
      }
      parameters[parameters.size() - 3] = -0.5 * c;
    }
    for (int p = 0; p < kNumPoints; ++p) {
      parameters.insert(parameters.end(),
                        {uniform(0.0, 0.5 * kNumCameras), uniform(-2.0, 2.0), uniform(4.0, 8.0)});
    }
    return parameters;
  }

  static void Build(double* parameters, ceres::Problem* problem) {
    std::mt19937 random(2);
    std::normal_distribution<double> noise(0.0, 0.5);
    double* const points = parameters + 6 * kNumCameras;
    for (double* point = points; point < points + 3 * kNumPoints; point += 3) {
      for (double* camera = parameters; camera < points; camera += 6) {
        if (std::abs(point[0] + camera[3]) < 2.0) {
          Seen seen = {0.0, 0.0};
          std::array<double, 2> pixel;
          seen(camera, point, pixel.data());
          seen = {pixel[0] + noise(random), pixel[1] + noise(random)};
          problem->AddResidualBlock(new ceres::AutoDiffCostFunction<Seen, 2, 6, 3>(new Seen(seen)),
                                    nullptr, camera, point);
          problem->SetParameterBlockConstant(camera);
          problem->SetParameterBlockConstant(point);
        }
      }
    }
    double* const localized = parameters + 6 * (kNumCameras / 2);
    problem->SetParameterBlockVariable(localized);
    localized[3] += 0.02;
  }
};

struct SmallProblem {
  std::string name;
  std::vector<double> start;
  std::function<void(double* parameters, ceres::Problem*)> build;
};

std::vector<SmallProblem> Problems() {
  const std::vector<double> start = {1.8, 0.31, 0.4};
  return {
      {"53 residual blocks, one block of 3", start,
       [](double* p, ceres::Problem* problem) {
         for (int i = 0; i < kNumSamples; ++i) {
           problem->AddResidualBlock(
               new ceres::AutoDiffCostFunction<OneSample, 1, 3>(new OneSample(Sample(i))), nullptr,
               p);
         }
       }},
      {"53 residual blocks, three blocks of 1", start,
       [](double* p, ceres::Problem* problem) {
         for (int i = 0; i < kNumSamples; ++i) {
           problem->AddResidualBlock(
               new ceres::AutoDiffCostFunction<OneSample, 1, 1, 1, 1>(new OneSample(Sample(i))),
               nullptr, p, p + 1, p + 2);
         }
       }},
      {"one residual block of 53, one block of 3", start,
       [](double* p, ceres::Problem* problem) {
         problem->AddResidualBlock(
             new ceres::AutoDiffCostFunction<AllSamples, kNumSamples, 3>(new AllSamples), nullptr,
             p);
       }},
      {"one camera localized in a constant map: 40 cameras, 2000 points", ConstantMap::Start(),
       ConstantMap::Build},
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
  std::vector<double> p = small.start;
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
