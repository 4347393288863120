#pragma once

#include <nlohmann/json.hpp>

#include "tools/fuzz/life.h"

namespace inceres::fuzz {

/// Adds what was counted in one life to `sum`.
void Add(const Counts& counts, Counts* sum);
nlohmann::json ToJson(const Counts& counts);

/// Live in a process of its own, a copy of this one: what a life does to the heap is no business of
/// the next, so that one alone goes as it went among others, and a life that ends in a crash, or
/// hangs for five minutes, is a defect ("crash") and not the end of the run. Nothing of ours may
/// have run in this process before.
std::optional<Defect> LiveInProcess(const LifePlan& plan, Counts* counts);

}  // namespace inceres::fuzz
