#include "tools/distributed/mpi_report.h"

#include <algorithm>
#include <cmath>
#include <cstdio>
#include <utility>
#include <vector>

#include "tools/command_line/json_values.h"
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

long long Long(std::int64_t count) {
  return static_cast<long long>(count);
}

template <typename... Values>
void PrintRow(const char* name, const char* format, Values... values) {
  std::fprintf(Out(), "%-22s ", name);
  std::fprintf(Out(), format, values...);  // NOLINT: formats are literals of this file
  std::fprintf(Out(), "\n");
}

void PrintRanks(const std::vector<RankReport>& ranks) {
  std::fprintf(Out(), "%4s %9s %9s %7s %7s %10s %12s %12s %10s %10s\n", "rank", "factors", "points",
               "cameras", "shared", "MB", "B/product", "B sent", "exchange s", "reduce s");
  int number = 0;
  for (const RankReport& rank : ranks) {
    std::fprintf(Out(), "%4d %9lld %9lld %7lld %7lld %10.1f %12lld %12lld %10.3f %10.3f\n",
                 number++, Long(rank.num_factors), Long(rank.num_landmarks), Long(rank.num_frames),
                 Long(rank.num_shared_frames), static_cast<double>(rank.peak_resident_bytes) * 1e-6,
                 Long(rank.exchange_bytes_per_product),
                 Long(rank.bytes_sent + rank.reduction_bytes_sent), rank.exchange_seconds,
                 rank.reduction_seconds);
  }
}

}  // namespace

void PrintTable(const MpiReport& report) {
  const Summary& solve = report.summary.solve;
  std::fprintf(Out(), "\n");
  PrintRow("problem", "%d cameras, %lld points, %lld observations", report.num_cameras,
           Long(report.num_points), Long(report.num_observations));
  PrintRow("solver", "%s", solve.reduced_solver.c_str());
  PrintRow("ranks", "%zu, with %d threads each", report.summary.ranks.size(), report.num_threads);
  PrintRow("partition", "by %s, %lld copies of cameras, imbalance %.3f",
           report.partition.by.c_str(), Long(report.partition.num_frame_copies),
           report.partition.imbalance);
  PrintRow("cost", "%.10e -> %.10e", solve.initial_cost, solve.final_cost);
  if (report.robust == "none") {
    PrintRow("RMS reprojection error", "%.6f -> %.6f px", RmsOf(solve.initial_cost, report),
             RmsOf(solve.final_cost, report));
  }
  PrintRow("iterations", "%d", IterationsOf(solve));
  PrintRow("termination", "%s", solve.message.c_str());
  PrintRow("conjugate gradients", "%lld", Long(solve.work.num_conjugate_gradients));
  PrintRow("time", "%.6f s", solve.seconds.total);
  for (const auto& [stage, seconds] : StagesOf(report)) {
    std::fprintf(Out(), "  %-20s %.6f s\n", stage, seconds);
  }
  PrintRanks(report.summary.ranks);
}

nlohmann::json ToJson(const MpiReport& report) {
  nlohmann::json ranks = nlohmann::json::array();
  for (const RankReport& rank : report.summary.ranks) {
    ranks.push_back(ToJson(rank));
  }
  const Summary& solve = report.summary.solve;
  return {{"input", report.problem},
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
          {"stage_seconds", JsonObject(StagesOf(report))},
          {"partition",
           {{"by", report.partition.by},
            {"imbalance", report.partition.imbalance},
            {"num_frame_copies", report.partition.num_frame_copies}}},
          {"num_checkpoints", report.summary.num_checkpoints},
          {"ranks", ranks},
          {"summary", nlohmann::json::parse(solve.ToJson())}};
}

}  // namespace inceres::tools
