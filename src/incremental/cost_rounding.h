#pragma once

#include <cstdint>
#include <vector>

#include "incremental/incremental_schur.h"
#include "linearize/incremental_family.h"
#include "linearize/variable_store.h"

namespace inceres::internal {

/// How much of a living problem's cost is the rounding of residuals: no minimum is known better
/// (docs/algorithms.md, "Stopping rule").
class CostRounding {
 public:
  CostRounding(const FactorGraph& graph, const VariableStore& variables,
               const std::vector<IncrementalFamily>& families, const IncrementalSchur& schur)
      : graph_(graph), variables_(variables), families_(families), schur_(schur) {}

  /// At most so much, whatever the residuals are: ½ (n ε)² Σ_v ‖x_v‖_∞² tr C_vv, for a residual
  /// that comes of n operations on numbers as large as J_v x_v is exact to n ε ‖x_v‖ ‖J_v‖. Cost: a
  /// pass over the frames, or over the landmarks where no frame can move.
  double AtMost() const;
  /// Of the residuals there are, none of which can be more rounding than it is long: to within
  /// `negligible`, or, where it is more, at least `enough` of it. Cost: that, and the factors of
  /// those variables whose part of it is not negligible, the newest first, until it is enough.
  double OfResiduals(double negligible, double enough) const;

 private:
  // What a variable adds to the most: it is a frame, or else a landmark.
  struct Part {
    VariableId id;
    std::int32_t frame;  // or -1
    std::int32_t landmark;
    double most;
  };

  template <typename Visit>
  void ForEachPart(const Visit& visit) const;
  template <typename Visit>
  void ForEachFactorOf(const Part& part, const Visit& visit) const;
  double OfResidualsOf(const Part& part) const;
  double LargestValue(VariableId id) const;

  const FactorGraph& graph_;
  const VariableStore& variables_;
  const std::vector<IncrementalFamily>& families_;
  const IncrementalSchur& schur_;
};

}  // namespace inceres::internal
