#include "common/run.h"

#include <algorithm>
#include <chrono>
#include <cmath>
#include <cstdint>
#include <cstdio>
#include <cstring>
#include <numeric>

#include "common/start.h"
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
    return values[static_cast<std::size_t>(
        std::lround(part * static_cast<double>(values.size() - 1)))];
  };
  return {at(0.5), at(0.95), values.back(), std::accumulate(values.begin(), values.end(), 0.0)};
}

// JSON has no word for what is not finite.
std::string Number(double value) {
  char text[32];
  std::snprintf(text, sizeof text, "%.17g", value);
  return std::isfinite(value) ? text : "null";
}

std::string ToJson(const RunReport& report) {
  const Statistics ms = Summarize(report.solve_ms);
  char text[400];
  std::snprintf(text, sizeof text,
                "{\"frames\": %d, \"solve_ms\": {\"median\": %.6g, \"p95\": %.6g, \"max\": %.6g, "
                "\"total\": %.6g}, "
                "\"ate_m\": %s, \"position_rmse_m\": %s, \"final_cost_sum\": %s}\n",
                report.num_frames, ms.median, ms.p95, ms.max, ms.total,
                Number(report.ate_m).c_str(), Number(report.position_rmse_m).c_str(),
                Number(report.final_cost_sum).c_str());
  return text;
}

// Up or down by what value, seed and solve say, so that it does not matter in which order the
// values come.
double Kicked(double value, std::uint64_t seed) {
  std::uint64_t bits = 0;
  std::memcpy(&bits, &value, sizeof bits);
  bits = (bits ^ seed) * 0x9e3779b97f4a7c15U;
  bits = (bits ^ (bits >> 29U)) * 0xbf58476d1ce4e5b9U;
  return value == 0.0 ? value : std::nextafter(value, (bits >> 63U) != 0 ? INFINITY : -INFINITY);
}

void KickAll(std::uint64_t seed, ceres::Problem* problem) {
  std::vector<double*> blocks;
  problem->GetParameterBlocks(&blocks);
  for (double* block : blocks) {
    if (!problem->IsParameterBlockConstant(block)) {
      const int size = problem->ParameterBlockSize(block);
      std::transform(block, block + size, block,
                     [seed](double value) { return Kicked(value, seed); });
    }
  }
}

double PositionRmse(const std::vector<Eigen::Vector3d>& estimated,
                    const std::vector<Eigen::Vector3d>& truth) {
  double sum = 0.0;
  for (std::size_t i = 0; i < truth.size(); ++i) {
    sum += (estimated[i] - truth[i]).squaredNorm();
  }
  return std::sqrt(sum / static_cast<double>(truth.size()));
}

}  // namespace

RunReport Run(const RunOptions& options, const MakeEstimator& make_estimator,
              const SolveFunction& solve) {
  RunReport report;
  report.num_frames = options.num_frames;
  std::uint64_t num_solves = 0;
  const SolveFunction timed_solve = [&](const ceres::Solver::Options& solver,
                                        ceres::Problem* problem, ceres::Solver::Summary* summary) {
    if (options.kick != 0) {
      KickAll(static_cast<std::uint64_t>(options.kick) << 32U | num_solves, problem);
    }
    ++num_solves;
    const auto start = std::chrono::steady_clock::now();
    solve(solver, problem, summary);
    const std::chrono::duration<double, std::milli> elapsed =
        std::chrono::steady_clock::now() - start;
    if (!summary->IsSolutionUsable()) {
      ++report.num_failed_solves;
      return;
    }
    report.solve_ms.push_back(elapsed.count());
    report.final_cost_sum += summary->final_cost;
  };

  Simulator simulator(options.simulator);
  const Start start = MakeStart(options, simulator);
  const AddFrame add_frame =
      make_estimator(options.estimator, timed_solve, start.state, start.body_from_cameras);
  std::vector<Eigen::Vector3d> estimated;
  std::vector<Eigen::Vector3d> truth;
  for (int i = 0; i < options.num_frames; ++i) {
    const Frame frame = simulator.Next();
    estimated.push_back(add_frame(frame).pose.p);
    truth.push_back(simulator.Truth(frame.time).pose.p);
  }
  report.ate_m = AbsoluteTrajectoryError(estimated, truth);
  report.position_rmse_m = PositionRmse(estimated, truth);
  return report;
}

bool Write(const RunOptions& options, const RunReport& report) {
  const std::string json = ToJson(report);
  std::fputs(json.c_str(), stdout);
  if (report.num_failed_solves > 0) {
    std::fprintf(stderr, "%d solves failed\n", report.num_failed_solves);
  }
  if (!options.json.empty()) {
    std::FILE* file = std::fopen(options.json.c_str(), "w");
    const bool written = file != nullptr && std::fputs(json.c_str(), file) >= 0;
    if ((file != nullptr && std::fclose(file) != 0) || !written) {
      std::fprintf(stderr, "--json: cannot write '%s'\n", options.json.c_str());
      return false;
    }
  }
  return report.num_failed_solves == 0;
}

}  // namespace sliding_window
