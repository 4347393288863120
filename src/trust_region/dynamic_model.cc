#include "trust_region/dynamic_model.h"

#include <algorithm>

namespace inceres::internal {

// Dynamic sparsity: a PlainModel that is made anew when the pattern of J has changed. Whether it
// has is seen by the tangent offsets of all entries, which are -1 where a block is all zeros: a
// comparison costs far less than a plan. What a new pattern needs of memory is asked for as it is
// made.

DynamicModel::DynamicModel(const SolverOptions& options, const Evaluator& evaluator)
    : LinearModel(evaluator), options_(options), tangent_offsets_(evaluator.families().size()) {
}

void DynamicModel::Refresh() {
  if (model_ == nullptr || !ZerosAreAsBefore()) {
    Rebuild();
  }
  // Clocks are those of the solve, which the new model does not know yet.
  model_->TimeInto(seconds_, clock_);
  model_->Refresh();
}

// The evaluator takes offsets of zero blocks away (LeaveOutZeroBlocks).
bool DynamicModel::ZerosAreAsBefore() const {
  const std::vector<Linearization>& families = evaluator_.families();
  return std::equal(families.begin(), families.end(), tangent_offsets_.begin(),
                    [](const Linearization& cache, const auto& offsets) {
                      return cache.tangent_offsets == offsets;
                    });
}

void DynamicModel::Rebuild() {
  model_.reset();  // its memory serves the new one
  model_ = std::make_unique<PlainModel>(options_, evaluator_, nullptr, &status_);
  for (const Linearization& cache : evaluator_.families()) {
    tangent_offsets_[cache.id] = cache.tangent_offsets;
  }
}

// A system that cannot be set up is an error of its solves.
Status DynamicModel::Solve(const double* damping, double* step) {
  return status_.ok() ? model_->Solve(damping, step) : status_;
}

// Asked before the first linearization, too, when there is nothing to tell but the sizes.
void DynamicModel::Describe(WorkCounts* work) const {
  if (model_ != nullptr) {
    model_->Describe(work);
    return;
  }
  work->num_frames = evaluator_.layout().num_frames;
  work->reduced_size = evaluator_.layout().size();
  for (const Linearization& cache : evaluator_.families()) {
    work->bytes += static_cast<std::int64_t>(sizeof(std::int32_t) * cache.tangent_offsets.size());
  }
}

}  // namespace inceres::internal
