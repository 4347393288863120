#pragma once

#include <cstdint>
#include <optional>
#include <vector>

#include "inceres/problem/factor_graph.h"
#include "linear/cluster_cholesky.h"
#include "linearize/evaluator.h"
#include "trust_region/preconditioner.h"

namespace inceres::internal {

/// Σ JᵀJ over some of the factors, and the damping, factored sparse: Ceres's SUBSET. Of a layout in
/// which all that moves is a frame. Threads: the evaluator's; the same bits for any number.
class SubsetPreconditioner final : public Preconditioner {
 public:
  /// Fails if a factor of the subset is not there, and as the analysis of the sum.
  SubsetPreconditioner(const Evaluator& evaluator, const std::vector<FactorId>& subset,
                       Status* status);

  void Refresh() override;
  Status Prepare(const double* damping) override;
  void Apply(const double* r, double* z) override;
  std::int64_t Bytes() const override;

 private:
  // A factor of the subset, seen from the frame that it touches through a slot.
  struct Term {
    int family;
    int factor;
    int slot;
  };

  void CollectTerms(const std::vector<FactorId>& subset);
  void BuildPattern();
  int FrameThrough(const Linearization& cache, int factor, int slot) const;
  void AddTerm(const Term& term, int row);

  const Evaluator& evaluator_;
  std::vector<int> terms_begin_;  // per frame, one more
  std::vector<Term> terms_;
  BlockPattern pattern_;
  std::vector<double> values_;
  std::optional<ClusterCholesky> factor_;  // none of a subset that is refused
};

}  // namespace inceres::internal
