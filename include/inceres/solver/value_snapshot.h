#pragma once

#include <cstddef>
#include <cstdint>
#include <vector>

#include "inceres/export.h"
#include "inceres/problem/factor_graph.h"
#include "inceres/solver/summary.h"

namespace inceres {

/// All values that an IncrementalSolver held at the end of one Update, and the cost there: what
/// other threads (a display, a planner) read while the solver goes on. A copy, which is the
/// reader's own: it stays as it is, whatever the solver does.
///
/// IncrementalSolver::ReadSnapshot fills one; reading into the same one again and again uses its
/// memory again.
class INCERES_EXPORT ValueSnapshot {
 public:
  /// How many Updates with publish_snapshots there had been, this one included; 0: never filled.
  std::int64_t number() const { return number_; }
  /// ½ Σ ρ at these values.
  double cost() const { return cost_; }
  /// How that Update ended.
  Termination termination() const { return termination_; }
  /// Ids the graph had given out: what is 0 … size() − 1.
  int num_variables() const { return static_cast<int>(offsets_.size()); }
  /// The ambient values of a variable, constants too; null if there was none of this id.
  const double* Values(VariableId id) const {
    const bool known = id >= 0 && id < num_variables() && offsets_[Index(id)] >= 0;
    return known ? values_.data() + offsets_[Index(id)] : nullptr;
  }

 private:
  friend class IncrementalSolver;
  static std::size_t Index(VariableId id) { return static_cast<std::size_t>(id); }

  std::int64_t number_ = 0;
  double cost_ = 0.0;
  Termination termination_ = Termination::kFailure;
  std::vector<std::ptrdiff_t> offsets_;  // by id: into values_, −1 of a removed variable
  std::vector<double> values_;
};

}  // namespace inceres
