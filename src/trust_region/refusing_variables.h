#pragma once

#include <cstddef>
#include <numeric>
#include <vector>

#include "linearize/evaluator.h"

namespace inceres::internal {

/// The variables of factors that have refused to be evaluated where steps led.
class RefusingVariables {
 public:
  /// Those of the factor at which the evaluator's last pass that failed did so.
  void Add(const Evaluator& evaluator) {
    const FactorId factor = evaluator.failed_factor();
    if (factor.index < 0) {
      return;
    }
    const Layout& layout = evaluator.layout();
    flags_.resize(static_cast<std::size_t>(layout.size()), 0);
    const FactorGraph& graph = evaluator.graph();
    for (int s = 0; s < graph.family(factor.family).num_slots(); ++s) {
      const int at = layout.Position(graph.Variables(factor.family, factor.index)[s]);
      for (int k = at < 0 ? 0 : layout.packed_offset[at];
           at >= 0 && k < layout.packed_offset[at + 1]; ++k) {
        flags_[static_cast<std::size_t>(k)] = 1;
      }
    }
  }
  void Clear() { flags_.clear(); }

  /// Per entry of a packed vector whether it is of one; empty: none is.
  const std::vector<char>& flags() const { return flags_; }
  /// Their degrees of freedom.
  int size() const { return std::accumulate(flags_.begin(), flags_.end(), 0); }

 private:
  std::vector<char> flags_;
};

}  // namespace inceres::internal
