#pragma once

#include <cstdint>
#include <string>

#include <nlohmann/json.hpp>

#include "inceres/distributed/distributed_solver.h"
#include "tools/distributed/partition.h"

namespace inceres::tools {

/// What bal_solve_mpi tells of a solve.
struct MpiReport {
  std::string problem;
  std::string robust;
  int num_threads = 1;
  int num_cameras = 0;
  std::int64_t num_points = 0;
  std::int64_t num_observations = 0;
  Partition partition;
  double read_seconds = 0.0;
  double partition_seconds = 0.0;
  DistributedSummary summary;
};

/// The table of bal_solve, and a line a rank.
void PrintTable(const MpiReport& report);
/// The same for programs.
nlohmann::json ToJson(const MpiReport& report);

}  // namespace inceres::tools
