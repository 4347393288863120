#pragma once

#include <cstdint>
#include <vector>

#include "base/sum_tree.h"
#include "incremental/incremental_schur.h"
#include "incremental/index_set.h"
#include "linearize/incremental_family.h"
#include "linearize/variable_store.h"

namespace inceres::internal {

/// How much of a living problem's cost is the rounding of residuals: no minimum is known better
/// (docs/algorithms.md, "Stopping rule"). What a frame adds is kept until its row of S, its entry
/// of b or its values change. Bits do not depend on what was before.
class CostRounding {
 public:
  /// Made before `schur` has a row, and the only one that asks its RowChanges for TakeUnbounded.
  CostRounding(const FactorGraph& graph, const VariableStore& variables,
               const std::vector<IncrementalFamily>& families, IncrementalSchur* schur)
      : graph_(graph), variables_(variables), families_(families), schur_(*schur) {}

  /// At most so much, whatever the residuals are: ½ (n ε)² Σ_v ‖x_v‖_∞² tr C_vv, for a residual
  /// that comes of n operations on numbers as large as J_v x_v is exact to n ε ‖x_v‖ ‖J_v‖. Cost:
  /// that of the frames that have changed since, or a pass over the landmarks where no frame can
  /// move.
  double AtMost();
  /// Of the residuals there are, none of which can be more rounding than it is long, and of which a
  /// few that are rounding for the most part do not count. Cost: that, and the factors of what has
  /// changed since it was asked last.
  double OfResiduals();

  std::int64_t Bytes() const {
    return static_cast<std::int64_t>(most_.Bytes() + sums_.Bytes() + roots_.Bytes() +
                                     counts_.Bytes() + changed_.capacity() * sizeof(std::int32_t) +
                                     shares_.capacity() * sizeof(Share));
  }

 private:
  // A frame or a landmark; the other one is -1.
  struct Part {
    VariableId id;
    std::int32_t frame;
    std::int32_t landmark;
  };
  // Of what its factors are rounded by: their sum, that of the fourth roots, and how many are not
  // zero.
  struct Share {
    double sum = 0.0;
    double roots = 0.0;
    double count = 0.0;
    double Typical(double most) const;
  };

  double Follow();
  double MostOf(VariableId id, int size, const double* diagonal, int stride) const;
  double MostOfFrame(std::int32_t row) const;
  double MostOfLandmark(std::int32_t landmark) const;
  template <typename Visit>
  void ForEachFactorOf(const Part& part, const Visit& visit) const;
  void AddTo(Share* share, const Part& part) const;
  double LargestValue(VariableId id) const;

  const FactorGraph& graph_;
  const VariableStore& variables_;
  const std::vector<IncrementalFamily>& families_;
  IncrementalSchur& schur_;
  // By row of S.
  SumTree most_, sums_, roots_, counts_;
  IndexSet unasked_;  // where the second has not followed
  std::vector<std::int32_t> changed_;
  std::vector<Share> shares_;  // scratch, by row
};

}  // namespace inceres::internal
