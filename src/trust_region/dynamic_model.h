#pragma once

#include <cstdint>
#include <memory>
#include <vector>

#include "trust_region/schur_model.h"

namespace inceres::internal {

/// S = H of the blocks of J that are not all zeros at the current point
/// (Evaluator::set_leaves_out_zero_blocks): where factors touch many variables of which few count,
/// a few that change from step to step. Pattern, plans and symbolic factorization are made anew
/// whenever the zeros have moved, and kept while they have not.
class DynamicModel final : public LinearModel {
 public:
  DynamicModel(const SolverOptions& options, const Evaluator& evaluator);

  void Refresh() override;
  const std::vector<double>& Gradient() const override { return model_->Gradient(); }
  const std::vector<double>& Diagonal() const override { return model_->Diagonal(); }
  Status Solve(const double* damping, double* step) override;
  const char* SolverName() const override {
    return model_ == nullptr ? "found at each linearization" : model_->SolverName();
  }
  void Describe(WorkCounts* work) const override;

 private:
  bool ZerosAreAsBefore() const;
  void Rebuild();

  const SolverOptions options_;
  std::unique_ptr<PlainModel> model_;
  Status status_;
  // per family, as model_ was made for them
  std::vector<UnwrittenVector<std::int32_t>> tangent_offsets_;
};

}  // namespace inceres::internal
