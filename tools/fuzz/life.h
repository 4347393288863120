#pragma once

#include <cstdint>
#include <optional>
#include <string>

#include "tools/fuzz/trial.h"

namespace inceres::fuzz {

/// One random problem and what happens to it, decided by seed, life and mode.
struct LifePlan {
  std::uint64_t seed = 1;
  std::uint64_t life = 0;
  std::string mode;
  int max_edits = 60;
  int max_threads = 2;      ///< of a solve
  bool bounds = false;      ///< in all modes, on a third of the blocks
  bool degenerate = false;  ///< cameras and points alone, some of them degenerate
  Judges judges = Judges::kDescent;
  bool verbose = false;  ///< prints every edit and solve
};

/// Where a life met a defect; it ends there.
struct Defect {
  LifePlan plan;
  long edits = 0;   ///< before the solve
  long solves = 0;  ///< this one included
  Finding finding;
};

std::optional<Defect> Live(const LifePlan& plan, Counts* counts);

}  // namespace inceres::fuzz
