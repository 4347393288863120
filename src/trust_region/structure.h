#pragma once

#include <cstdint>
#include <vector>

#include "inceres/problem/factor_graph.h"

namespace inceres::internal {

/// All that the set-up of a solve depends on: sizes, roles, constants, connections, and which
/// families prepare or recenter; neither values nor measurements, losses, bounds or what a manifold
/// computes, and no addresses. Two graphs of equal structure have the same layout, sparsity,
/// elimination and symbolic factorization.
///
/// One list of numbers; cost of taking and of comparing it: linear in the slots of the factors, a
/// comparison stops at the first difference.
class Structure {
 public:
  explicit Structure(const FactorGraph& graph);

  bool IsThatOf(const FactorGraph& graph) const;
  std::int64_t Bytes() const {
    return static_cast<std::int64_t>(numbers_.capacity() * sizeof(std::int32_t));
  }

 private:
  std::vector<std::int32_t> numbers_;
};

}  // namespace inceres::internal
