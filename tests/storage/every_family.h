#pragma once

#include "inceres/problem/factor_graph.h"

namespace inceres::test {

/// Families, the last ones, that everything_version_1.graph does not have: they came after it.
constexpr int kNumLaterFamilies = 1;

/// A graph with all that a saved one may have: two factors of every built-in family and, once, a
/// third that was removed; variables on every built-in manifold, some removed, constant, bounded,
/// pinned or borrowed; every built-in loss, one of them shared and some within others. What is
/// borrowed lives as long as the program.
void MakeEverything(FactorGraph* graph);

}  // namespace inceres::test
