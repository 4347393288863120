#include "trust_region/subset_preconditioner.h"

#include <algorithm>

#include "base/counting_sort.h"
#include "linear/pattern_rows.h"

namespace inceres::internal {

// M = Σ JᵀJ over a subset of the factors, plus the damping: the normal equations of an easier
// problem, say of the odometry of a pose graph, factored sparse. Ceres's SUBSET, where what is in
// the subset is the caller's choice. It is symmetric and, with the damping, positive definite,
// whatever the subset.
//
// The pattern is found once. A factor appears in the list of every frame that it touches, once a
// slot, so that the blocks of a row are summed by one task, in the order of the subset: no two
// tasks add to the same block, and the sums have one order for any number of threads.
//
// The factor is that of clusters of frames, with all frames in one.

namespace {

// Rows a task.
constexpr int kRowTask = 64;

// Ids are the caller's: each may name a family or a place that does not exist, or that was freed,
// or the factor that had the place before.
bool AreThere(const FactorGraph& graph, const std::vector<FactorId>& subset) {
  return std::all_of(subset.begin(), subset.end(), [&](const FactorId& id) {
    return id.family >= 0 && id.family < graph.num_families() && id.index >= 0 &&
           graph.HasFactor(id.family, id.index) &&
           (id.generation < 0 || id.generation == graph.Generation(id.family, id.index));
  });
}

}  // namespace

SubsetPreconditioner::SubsetPreconditioner(const Evaluator& evaluator,
                                           const std::vector<FactorId>& subset, Status* status)
    : evaluator_(evaluator) {
  if (!AreThere(evaluator.graph(), subset)) {
    *status = Status::Error(StatusCode::kInvalidArgument,
                            "conjugate_gradients.subset names a factor that is not there");
    return;
  }
  CollectTerms(subset);
  BuildPattern();
  values_.resize(static_cast<std::size_t>(pattern_.value_begin.back()));
  FrameClusters all;
  all.cluster_of.assign(static_cast<std::size_t>(pattern_.num_blocks()), 0);
  // The symbolic analysis, once for all dampings.
  factor_.emplace(pattern_, all, evaluator.executor(), status);
}

// −1 of a slot whose variable does not move.
int SubsetPreconditioner::FrameThrough(const Linearization& cache, int factor, int slot) const {
  return evaluator_.layout().FrameOf(
      evaluator_.graph().Variables(cache.id, 0)[cache.Entry(factor) + slot]);
}

void SubsetPreconditioner::CollectTerms(const std::vector<FactorId>& subset) {
  // Counting sort by frame, in two passes over the subset.
  const auto for_each_term = [&](const auto& add) {
    for (const FactorId& id : subset) {
      const Linearization& cache = evaluator_.families()[id.family];
      for (int s = 0; s < cache.num_slots; ++s) {
        const int frame = FrameThrough(cache, id.index, s);
        if (frame >= 0) {
          add(frame, Term{id.family, id.index, s});
        }
      }
    }
  };
  CountingSort(evaluator_.layout().num_frames, for_each_term, &terms_begin_, &terms_);
}

void SubsetPreconditioner::BuildPattern() {
  const Layout& layout = evaluator_.layout();
  pattern_ = PatternWithoutBlocks(layout.FrameOffsets());
  RowColumns columns(layout.num_frames);
  for (int row = 0; row < layout.num_frames; ++row) {
    columns.Begin(row);
    for (int k = terms_begin_[row]; k < terms_begin_[row + 1]; ++k) {
      const Linearization& cache = evaluator_.families()[terms_[k].family];
      for (int s = 0; s < cache.num_slots; ++s) {
        const int other = FrameThrough(cache, terms_[k].factor, s);
        // The lower triangle, with the diagonal block always there, so that frames without a factor
        // of the subset have the damping alone.
        if (other >= 0) {
          columns.Add(other);
        }
      }
    }
    AppendRow(columns.Ascending(), &pattern_);
  }
}

// J_rowᵀ J of the factor, as far as it is in the lower triangle.
void SubsetPreconditioner::AddTerm(const Term& term, int row) {
  const Linearization& cache = evaluator_.families()[term.family];
  const SlotJacobians& of_row = cache.slots[term.slot];
  const double* const J_r = of_row.data + term.factor * of_row.factor_stride;
  for (int s = 0; s < cache.num_slots; ++s) {
    const int column = FrameThrough(cache, term.factor, s);
    // The mirrored block is in the upper triangle; the term of the other slot adds it from there.
    if (column < 0 || column > row) {
      continue;
    }
    double* const out = values_.data() + pattern_.value_begin[FindBlock(pattern_, row, column)];
    const SlotJacobians& of_column = cache.slots[s];
    const double* const J_c = of_column.data + term.factor * of_column.factor_stride;
    // Residual by residual, an outer product of two rows of J.
    for (int r = 0; r < cache.residual_size; ++r) {
      for (int i = 0; i < of_row.columns; ++i) {
        const double a = J_r[r * of_row.row_stride + i];
        for (int j = 0; j < of_column.columns; ++j) {
          out[i * of_column.columns + j] += a * J_c[r * of_column.row_stride + j];
        }
      }
    }
  }
}

// At each linearization, undamped. The damping is added in Prepare, which a refused step needs
// alone.
void SubsetPreconditioner::Refresh() {
  std::fill(values_.begin(), values_.end(), 0.0);
  evaluator_.executor().For(pattern_.num_blocks(), kRowTask, [this](int begin, int end) {
    for (int row = begin; row < end; ++row) {
      for (int k = terms_begin_[row]; k < terms_begin_[row + 1]; ++k) {
        AddTerm(terms_[k], row);
      }
    }
  });
}

Status SubsetPreconditioner::Prepare(const double* damping) {
  return factor_->Factorize(values_.data(), damping);
}

void SubsetPreconditioner::Apply(const double* r, double* z) {
  factor_->Apply(r, z);
}

std::int64_t SubsetPreconditioner::Bytes() const {
  return (factor_.has_value() ? factor_->Bytes() : 0) +
         static_cast<std::int64_t>(terms_.size() * sizeof(Term) + values_.size() * sizeof(double));
}

}  // namespace inceres::internal
