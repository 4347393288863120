#include "common/run.h"

#include <algorithm>
#include <chrono>
#include <cmath>
#include <cstdio>
#include <numeric>

#include "common/trajectory_error.h"

namespace sliding_window {
namespace {

struct Statistics {
  double median = 0.0, p95 = 0.0, max = 0.0, total = 0.0;
};

Statistics Summarize(std::vector<double> values) {
  if (values.empty()) {
    return {};
  }
  std::sort(values.begin(), values.end());
  const auto at = [&values](double part) {
    return values[static_cast<std::size_t>(std::lround(part * static_cast<double>(values.size() - 1)))];
  };
  return {at(0.5), at(0.95), values.back(), std::accumulate(values.begin(), values.end(), 0.0)};
}

std::string ToJson(const RunReport& report) {
  const Statistics ms = Summarize(report.solve_ms);
  char text[400];
  std::snprintf(text, sizeof text,
                "{\"frames\": %d, \"solve_ms\": {\"median\": %.6g, \"p95\": %.6g, \"max\": %.6g, \"total\": %.6g}, "
                "\"ate_m\": %.17g, \"final_cost_sum\": %.17g}\n",
                report.num_frames, ms.median, ms.p95, ms.max, ms.total, report.ate_m, report.final_cost_sum);
  return text;
}

}  // namespace

RunReport Run(const RunOptions& options, const MakeEstimator& make_estimator, const SolveFunction& solve) {
  RunReport report;
  report.num_frames = options.num_frames;
  const SolveFunction timed_solve = [&](const ceres::Solver::Options& solver, ceres::Problem* problem,
                                        ceres::Solver::Summary* summary) {
    const auto start = std::chrono::steady_clock::now();
    solve(solver, problem, summary);
    const std::chrono::duration<double, std::milli> elapsed = std::chrono::steady_clock::now() - start;
    report.solve_ms.push_back(elapsed.count());
    report.final_cost_sum += summary->final_cost;
  };

  Simulator simulator(options.simulator);
  ImuState start = simulator.Truth(0.0);
  start.v += Eigen::Vector3d(0.05, -0.03, 0.02);
  start.ba.setZero();
  start.bg.setZero();
  Pose extrinsic = Simulator::TrueExtrinsic();
  if (options.estimator.free_extrinsics) {
    extrinsic = extrinsic * Pose{Eigen::Vector3d(0.01, -0.01, 0.005), Exp(Eigen::Vector3d(0.008, -0.005, 0.004))};
  }
  const AddFrame add_frame = make_estimator(options.estimator, timed_solve, start, extrinsic);
  std::vector<Eigen::Vector3d> estimated;
  std::vector<Eigen::Vector3d> truth;
  for (int i = 0; i < options.num_frames; ++i) {
    const Frame frame = simulator.Next();
    estimated.push_back(add_frame(frame).pose.p);
    truth.push_back(simulator.Truth(frame.time).pose.p);
  }
  report.ate_m = AbsoluteTrajectoryError(estimated, truth);
  return report;
}

bool Write(const RunOptions& options, const RunReport& report) {
  const std::string json = ToJson(report);
  std::fputs(json.c_str(), stdout);
  if (options.json.empty()) {
    return true;
  }
  std::FILE* file = std::fopen(options.json.c_str(), "w");
  const bool written = file != nullptr && std::fputs(json.c_str(), file) >= 0;
  if ((file != nullptr && std::fclose(file) != 0) || !written) {
    std::fprintf(stderr, "--json: cannot write '%s'\n", options.json.c_str());
    return false;
  }
  return true;
}

}  // namespace sliding_window
