#include "schur/projected_products.h"

#include <algorithm>
#include <utility>

namespace inceres::internal {

// A V for the coarse space, A = S + Λ_c, aggregate by aggregate: an aggregate's columns of A V are
// written by one task and by nobody else. Where S is formed that is a sparse product with few
// columns. Where it is not, the landmarks that the aggregate sees are gone through one by one:
//     Z_la = Σ_{j∈a} Y_lj V_j,   (A V)_ia −= Y_liᵀ Z_la
//
// which is what eliminating l does to the columns, and reads Y twice instead of forming Y Yᵀ.
// Landmarks come in ascending order and frames in the order of l's list: the sums have one order.
//
// Rows of V and A V are padded to quads with zeros, so that inner loops run over whole quads.

namespace {

// Aggregates a task; the scratch is one a task as well.
constexpr int kAggregateTask = 4;

// out += scale · in, whole quads.
inline void AddScaled(double scale, const double* __restrict in, int count,
                      double* __restrict out) {
  for (int k = 0; k < count; k += kQuad) {
    for (int lane = 0; lane < kQuad; ++lane) {
      out[k + lane] += scale * in[k + lane];
    }
  }
}

}  // namespace

// place_of is not wiped between aggregates: it is read only for frames that this aggregate reaches,
// which are written first.
struct ProjectedProducts::Scratch {
  std::vector<int> place_of;  // per frame: of its block of A V in the aggregate's columns
  std::vector<double> Z;
};

ProjectedProducts::ProjectedProducts(const LandmarkIncidences& incidences, const FramePlans& plans,
                                     std::vector<const double*> blocks,
                                     const Elimination* without_S)
    : incidences_(incidences),
      plans_(plans),
      blocks_(std::move(blocks)),
      elimination_(without_S),
      rows_(plans.pattern, /*keeps=*/[this](int block) { return blocks_[block] != nullptr; }) {
}

void ProjectedProducts::Form(const AggregateReach& reach, const double* damping,
                             const Executor& executor, CoarseColumns* columns) const {
  executor.For(reach.shape.num_aggregates(), kAggregateTask, [&](int begin, int end) {
    Scratch scratch;
    scratch.place_of.resize(plans_.pattern.num_blocks());
    for (int aggregate = begin; aggregate < end; ++aggregate) {
      FormAggregate(aggregate, reach, damping, columns, &scratch);
    }
  });
}

// Zero, add the columns of C + Λ_c (or of S + Λ_c) for the aggregate's own frames, subtract its
// landmarks.
void ProjectedProducts::FormAggregate(int aggregate, const AggregateReach& reach,
                                      const double* damping, CoarseColumns* columns,
                                      Scratch* scratch) const {
  const CoarseShape& shape = reach.shape;
  const int stride = columns->stride(aggregate);
  const int first = shape.coupled_begin[aggregate], last = shape.coupled_begin[aggregate + 1];
  for (int place = first; place < last; ++place) {
    const int frame = shape.coupled[place];
    scratch->place_of[frame] = place;
    std::fill_n(columns->AV(place), columns->block_size(frame) * stride, 0.0);
  }
  for (int place = first; place < last; ++place) {
    if (shape.aggregate_of[shape.coupled[place]] == aggregate) {
      AddFrameBlocks(shape.coupled[place], stride, damping, columns, *scratch);
    }
  }
  // Blocks are those of S: the landmarks are in them.
  if (elimination_ == nullptr) {
    return;
  }
  for (int k = reach.landmarks_begin[aggregate]; k < reach.landmarks_begin[aggregate + 1]; ++k) {
    SubtractLandmark(reach.landmarks[k], aggregate, stride, columns, scratch);
  }
}

// Column `frame` of C + Λ_c, times V of the frame.
void ProjectedProducts::AddFrameBlocks(int frame, int stride, const double* damping,
                                       CoarseColumns* columns, const Scratch& scratch) const {
  const int size = columns->block_size(frame);
  const double* const V = columns->V(frame);
  // An aggregate reaches its own frames.
  double* const own = columns->AV(scratch.place_of[frame]);
  const double* const lambda = damping + plans_.pattern.offsets[frame];
  // Λ_c is diagonal: row r of V, scaled.
  for (int r = 0; r < size; ++r) {
    AddScaled(lambda[r], V + r * stride, stride, own + r * stride);
  }
  for (int k = rows_.begin[frame]; k < rows_.begin[frame + 1]; ++k) {
    const auto [block, other] = rows_.places[k];
    const double* const A = blocks_[block];
    double* const out = columns->AV(scratch.place_of[other]);
    const int other_size = columns->block_size(other);
    for (int r = 0; r < other_size; ++r) {
      for (int c = 0; c < size; ++c) {
        // A row of block (other, frame) as it is stored, else a column of block (frame, other).
        const double a = other >= frame ? A[r * size + c] : A[c * other_size + r];
        AddScaled(a, V + c * stride, stride, out + r * stride);
      }
    }
  }
}

// Two passes over the frames of l: those of the aggregate give Z, and then all of them take their
// share of it.
void ProjectedProducts::SubtractLandmark(int landmark, int aggregate, int stride,
                                         CoarseColumns* columns, Scratch* scratch) const {
  const auto l = static_cast<std::size_t>(landmark);
  const int depth = incidences_.sizes[l];
  // One row of Z for each degree of freedom of the landmark.
  scratch->Z.assign(static_cast<std::size_t>(depth) * stride, 0.0);
  for (int q = incidences_.begin[l]; q < incidences_.begin[l + 1]; ++q) {
    const int frame = incidences_.frames[q];
    // V of other aggregates' frames is zero in these columns.
    if (columns->shape().aggregate_of[frame] != aggregate) {
      continue;
    }
    // Y_lj: a row for each degree of freedom of the landmark, as long as the frame, padded.
    const double* Y = elimination_->Y(incidences_.incidences[q]);
    const double* const V = columns->V(frame);
    const int size = columns->block_size(frame);
    for (int d = 0; d < depth; ++d, Y += PadToQuad(size)) {
      for (int c = 0; c < size; ++c) {
        AddScaled(Y[c], V + c * stride, stride, scratch->Z.data() + d * stride);
      }
    }
  }
  // All frames that see l are reached by this aggregate, in it or not.
  for (int q = incidences_.begin[l]; q < incidences_.begin[l + 1]; ++q) {
    const int frame = incidences_.frames[q];
    const double* const Y = elimination_->Y(incidences_.incidences[q]);
    double* const out = columns->AV(scratch->place_of[frame]);
    const int size = columns->block_size(frame), row = PadToQuad(size);
    for (int c = 0; c < size; ++c) {
      for (int d = 0; d < depth; ++d) {
        AddScaled(-Y[d * row + c], scratch->Z.data() + d * stride, stride, out + c * stride);
      }
    }
  }
}

}  // namespace inceres::internal
