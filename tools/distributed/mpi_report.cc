#include "tools/distributed/mpi_report.h"

#include <algorithm>
#include <cmath>
#include <cstdio>
#include <utility>
#include <vector>

#include <nlohmann/json.hpp>

#include "tools/command_line/output.h"

namespace inceres::tools {
namespace {

double RmsOf(double cost, const MpiReport& report) {
  return std::sqrt(2.0 * cost / static_cast<double>(report.num_observations));
}

// Without the start, as bal_solve counts them.
int IterationsOf(const Summary& solve) {
  return std::max(0, static_cast<int>(solve.iterations.size()) - 1);
}

std::vector<std::pair<const char*, double>> StagesOf(const MpiReport& report) {
  const StageSeconds& s = report.summary.solve.seconds;
  return {{"read", report.read_seconds},
          {"partition", report.partition_seconds},
          {"setup", s.setup},
          {"residuals", s.residuals},
          {"jacobians", s.jacobians},
          {"hessian", s.hessian},
          {"elimination", s.elimination},
          {"reduced system", s.factorization},
          {"back_substitution", s.back_substitution},
          {"model_cost", s.model_cost}};
}

nlohmann::json ToJson(const RankReport& rank) {
  return {{"num_factors", rank.num_factors},
          {"num_landmarks", rank.num_landmarks},
          {"num_frames", rank.num_frames},
          {"num_shared_frames", rank.num_shared_frames},
          {"num_owned_frames", rank.num_owned_frames},
          {"bytes", rank.bytes},
          {"peak_resident_bytes", rank.peak_resident_bytes},
          {"exchange_bytes_per_product", rank.exchange_bytes_per_product},
          {"shared_frame_bytes", rank.shared_frame_bytes},
          {"num_products", rank.num_products},
          {"bytes_sent", rank.bytes_sent},
          {"reduction_bytes_sent", rank.reduction_bytes_sent},
          {"seconds", rank.seconds},
          {"product_seconds", rank.product_seconds},
          {"exchange_seconds", rank.exchange_seconds},
          {"reduction_seconds", rank.reduction_seconds}};
}

}  // namespace

void PrintTable(const MpiReport& report) {
  const Summary& solve = report.summary.solve;
  std::fprintf(Out(), "\n%-22s %d cameras, %lld points, %lld observations\n", "problem",
               report.num_cameras, static_cast<long long>(report.num_points),
               static_cast<long long>(report.num_observations));
  std::fprintf(Out(), "%-22s %s\n", "solver", solve.reduced_solver.c_str());
  std::fprintf(Out(), "%-22s %zu, with %d threads each\n", "ranks", report.summary.ranks.size(),
               report.num_threads);
  std::fprintf(Out(), "%-22s by %s, %lld copies of cameras, imbalance %.3f\n", "partition",
               report.partition.by.c_str(),
               static_cast<long long>(report.partition.num_frame_copies),
               report.partition.imbalance);
  std::fprintf(Out(), "%-22s %.10e -> %.10e\n", "cost", solve.initial_cost, solve.final_cost);
  if (report.robust == "none") {
    std::fprintf(Out(), "%-22s %.6f -> %.6f px\n", "RMS reprojection error",
                 RmsOf(solve.initial_cost, report), RmsOf(solve.final_cost, report));
  }
  std::fprintf(Out(), "%-22s %d\n%-22s %s\n", "iterations", IterationsOf(solve), "termination",
               solve.message.c_str());
  std::fprintf(Out(), "%-22s %lld\n", "conjugate gradients",
               static_cast<long long>(solve.work.num_conjugate_gradients));
  std::fprintf(Out(), "%-22s %.6f s\n", "time", solve.seconds.total);
  for (const auto& [stage, seconds] : StagesOf(report)) {
    std::fprintf(Out(), "  %-20s %.6f s\n", stage, seconds);
  }
  std::fprintf(Out(), "%4s %9s %9s %7s %7s %10s %12s %12s %10s %10s\n", "rank", "factors", "points",
               "cameras", "shared", "MB", "B/product", "B sent", "exchange s", "reduce s");
  int number = 0;
  for (const RankReport& rank : report.summary.ranks) {
    std::fprintf(
        Out(), "%4d %9lld %9lld %7lld %7lld %10.1f %12lld %12lld %10.3f %10.3f\n", number++,
        static_cast<long long>(rank.num_factors), static_cast<long long>(rank.num_landmarks),
        static_cast<long long>(rank.num_frames), static_cast<long long>(rank.num_shared_frames),
        static_cast<double>(rank.peak_resident_bytes) * 1e-6,
        static_cast<long long>(rank.exchange_bytes_per_product),
        static_cast<long long>(rank.bytes_sent) + static_cast<long long>(rank.reduction_bytes_sent),
        rank.exchange_seconds, rank.reduction_seconds);
  }
}

std::string ToJson(const MpiReport& report) {
  nlohmann::json stages = nlohmann::json::object();
  for (const auto& [stage, seconds] : StagesOf(report)) {
    stages[stage] = seconds;
  }
  nlohmann::json ranks = nlohmann::json::array();
  for (const RankReport& rank : report.summary.ranks) {
    ranks.push_back(ToJson(rank));
  }
  const Summary& solve = report.summary.solve;
  const nlohmann::json json = {{"input", report.problem},
                               {"solver", solve.reduced_solver},
                               {"robust", report.robust},
                               {"threads", report.num_threads},
                               {"num_cameras", report.num_cameras},
                               {"num_points", report.num_points},
                               {"num_observations", report.num_observations},
                               {"initial_cost", solve.initial_cost},
                               {"final_cost", solve.final_cost},
                               {"iterations", IterationsOf(solve)},
                               {"message", solve.message},
                               {"seconds", solve.seconds.total},
                               {"stage_seconds", stages},
                               {"partition",
                                {{"by", report.partition.by},
                                 {"imbalance", report.partition.imbalance},
                                 {"num_frame_copies", report.partition.num_frame_copies}}},
                               {"num_checkpoints", report.summary.num_checkpoints},
                               {"ranks", ranks},
                               {"summary", nlohmann::json::parse(solve.ToJson())}};
  return json.dump(2);
}

}  // namespace inceres::tools
