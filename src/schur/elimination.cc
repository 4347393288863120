#include "schur/elimination.h"

#include <algorithm>
#include <atomic>
#include <cmath>

#include "schur/landmark_factor.h"

namespace inceres::internal {
namespace {

constexpr int kBlockGrain = 4;
constexpr int kLandmarkGrain = 64;

}  // namespace

Elimination::Elimination(const Evaluator& evaluator, const LandmarkIncidences& incidences, const FramePlans& plans,
                         const Hessian& hessian)
    : evaluator_(evaluator), incidences_(incidences), plans_(plans), hessian_(hessian), kernels_(BestKernels()) {
  const auto num_landmarks = static_cast<std::size_t>(incidences.num_landmarks());
  U_inv_.resize(num_landmarks * Hessian::kLandmarkStride);
  z_.resize(num_landmarks * kQuad);
  Y_.resize(incidences.y_quads * kQuad);
  S_.resize(plans.pattern.value_begin.back());
  b_.resize(plans.pattern.size());
  const Layout& layout = evaluator.layout();
  padded_frame_step_.resize(layout.quad_offset[layout.num_frames] * kQuad);
  rhs_terms_.reserve(incidences.frame_incidences.size());
  for (const int q : incidences.frame_incidences) {
    const auto k = static_cast<std::size_t>(q);
    rhs_terms_.push_back({incidences.incidences[k].y, incidences.landmarks[k] * kQuad});
  }
}

int Elimination::DampingOffset(int landmark) const {
  const Layout& layout = evaluator_.layout();
  return layout.packed_offset[layout.num_frames + landmark] - layout.frame_size();
}

bool Elimination::FactorLandmark(int landmark, const double* damping) {
  const auto l = static_cast<std::size_t>(landmark);
  const int size = incidences_.sizes[l];
  double* U_inv = U_inv_.data() + static_cast<std::ptrdiff_t>(landmark) * Hessian::kLandmarkStride;
  if (!InvertCholeskyFactor(size, hessian_.P(landmark), damping, U_inv)) {
    return false;
  }
  const double* eta = hessian_.LandmarkEta(landmark);
  double* z = z_.data() + static_cast<std::ptrdiff_t>(landmark) * kQuad;
  MultiplyLower(size, U_inv, eta, z);
  return true;
}

void Elimination::FormY(int landmark) {
  const auto l = static_cast<std::size_t>(landmark);
  const double* U_inv = U_inv_.data() + static_cast<std::ptrdiff_t>(landmark) * Hessian::kLandmarkStride;
  for (int k = incidences_.factors_begin[l]; k < incidences_.factors_begin[l + 1]; ++k) {
    kernels_.eliminate(incidences_.sizes[l], incidences_.factors[k], U_inv, Y_.data());
  }
}

// Calls function(first, last) for stretches of the chunk's landmarks, possibly concurrently.
template <typename Function>
void Elimination::ForLandmarks(int chunk, Function&& function) {
  const int first = incidences_.chunk_begin[chunk];
  evaluator_.executor().For(incidences_.chunk_begin[chunk + 1] - first, kLandmarkGrain,
                            [&](int begin, int end) { function(first + begin, first + end); });
}

Status Elimination::Eliminate(const double* landmark_damping) {
  const Executor& executor = evaluator_.executor();
  const auto num_blocks = static_cast<int>(plans_.block_row.size());
  const int num_landmarks = incidences_.num_landmarks();
  if (num_landmarks == 0) {
    executor.For(num_blocks, kBlockGrain, [&](int begin, int end) { FormBlocks(0, begin, end); });
  }
  for (int chunk = 0; chunk < incidences_.num_chunks(); ++chunk) {
    std::atomic<int> singular{num_landmarks};
    chunk_in_Y_ = chunk;
    ForLandmarks(chunk, [&](int begin, int end) {
      for (int l = begin; l < end; ++l) {
        if (!FactorLandmark(l, landmark_damping + DampingOffset(l))) {
          int lowest = singular.load();
          while (l < lowest && !singular.compare_exchange_weak(lowest, l)) {
          }
          return;
        }
        FormY(l);
      }
    });
    if (singular.load() < num_landmarks) {
      const Layout& layout = evaluator_.layout();
      const VariableId id = layout.variables[layout.num_frames + singular.load()];
      return Status::Error(StatusCode::kSingular, "the block of landmark variable " + std::to_string(id) +
                                                      " is not positive definite: its factors do not determine it");
    }
    executor.For(num_blocks, kBlockGrain, [&](int begin, int end) { FormBlocks(chunk, begin, end); });
  }
  return Status::Ok();
}

// The diagonal block comes last in its row: what b takes is then still in the cache.
void Elimination::FormBlocks(int chunk, int begin, int end) {
  BlockScratch scratch;
  for (int block = begin; block < end; ++block) {
    FormBlock(chunk, block, &scratch);
    const int row = plans_.block_row[block];
    if (plans_.pattern.columns[block] == row) {
      FormRightHandSide(chunk, row, &scratch);
    }
  }
}

void Elimination::FormBlock(int chunk, int block, BlockScratch* scratch) {
  const BlockPattern& pattern = plans_.pattern;
  const auto k = static_cast<std::size_t>(block);
  const int rows = pattern.block_size(plans_.block_row[k]);
  const int columns = pattern.block_size(pattern.columns[k]);
  const int stride = PadToQuad(columns);
  double* out = S_.data() + pattern.value_begin[k];
  const double* before = chunk == 0 ? hessian_.C().data() + pattern.value_begin[k] : out;
  const auto source_of = [&](int s) { return plans_.schur_sources[plans_.schur.segments[s].source]; };
  int first = plans_.schur.segments_begin[k];
  const int end = plans_.schur.segments_begin[k + 1];
  while (first < end && source_of(first).chunk < chunk) {
    ++first;
  }
  if (first == end || source_of(first).chunk > chunk) {
    if (chunk == 0) {
      std::copy(before, before + rows * columns, out);
    }
    return;
  }
  double* sum = scratch->Zeroed(rows, columns);
  for (int s = first; s < end && source_of(s).chunk == chunk; ++s) {
    const ProductPlan::Segment& segment = plans_.schur.segments[s];
    BlockProducts products;
    products.a = Y_.data();
    products.b = Y_.data();
    products.terms = plans_.schur.terms.data() + segment.first_term;
    products.count = segment.count;
    products.depth = source_of(s).landmark_size;
    products.a_size = columns;
    products.b_size = rows;
    kernels_.accumulate_products(products, -1.0, sum);
  }
  for (int r = 0; r < rows; ++r) {
    for (int c = 0; c < columns; ++c) {
      out[r * columns + c] = before[r * columns + c] + sum[r * stride + c];
    }
  }
}

void Elimination::FormRightHandSide(int chunk, int frame, BlockScratch* scratch) {
  const BlockPattern& pattern = plans_.pattern;
  const auto i = static_cast<std::size_t>(frame);
  const int size = pattern.block_size(frame);
  double* sum = scratch->Zeroed(1, size);
  const auto landmark_of = [&](int k) { return incidences_.landmarks[incidences_.frame_incidences[k]]; };
  const auto size_of = [&](int k) { return incidences_.sizes[landmark_of(k)]; };
  int first = incidences_.frame_begin[i];
  int end = incidences_.frame_begin[i + 1];
  if (incidences_.num_chunks() > 1) {
    const auto begin_of = [&](int k) {
      const auto* all = incidences_.frame_incidences.data();
      const int landmark = incidences_.chunk_begin[k];
      return static_cast<int>(std::partition_point(all + incidences_.frame_begin[i], all + incidences_.frame_begin[i + 1],
                                                   [&](int q) { return incidences_.landmarks[q] < landmark; }) -
                              all);
    };
    first = begin_of(chunk);
    end = begin_of(chunk + 1);
  }
  while (first < end) {
    int last = first;
    while (last < end && size_of(last) == size_of(first)) {
      ++last;
    }
    VectorProducts products;
    products.a = Y_.data();
    products.v = z_.data();
    products.terms = rhs_terms_.data() + first;
    products.count = last - first;
    products.depth = size_of(first);
    products.a_size = size;
    kernels_.accumulate_vectors(products, -1.0, sum);
    first = last;
  }
  for (int k = 0; k < size; ++k) {
    const int at = pattern.offsets[i] + k;
    b_[at] = sum[k] + (chunk == 0 ? -hessian_.gradient()[at] : b_[at]);
  }
}

void Elimination::BackSubstitute(const double* frame_step, double* landmark_step) {
  const Layout& layout = evaluator_.layout();
  for (int i = 0; i < layout.num_frames; ++i) {
    const auto k = static_cast<std::size_t>(i);
    std::copy(frame_step + layout.packed_offset[k], frame_step + layout.packed_offset[k + 1],
              padded_frame_step_.data() + static_cast<std::ptrdiff_t>(layout.quad_offset[k]) * kQuad);
  }
  for (int chunk = incidences_.num_chunks() - 1; chunk >= 0; --chunk) {  // Y is that of the last
    const bool is_in_Y = chunk == chunk_in_Y_;
    chunk_in_Y_ = chunk;
    ForLandmarks(chunk, [&](int begin, int end) {
      for (int landmark = begin; landmark < end; ++landmark) {
        if (!is_in_Y) {
          FormY(landmark);
        }
        BackSubstituteLandmark(landmark, landmark_step);
      }
    });
  }
}

void Elimination::BackSubstituteLandmark(int landmark, double* landmark_step) {
  const auto l = static_cast<std::size_t>(landmark);
  const int size = incidences_.sizes[l];
  const double* z = z_.data() + static_cast<std::ptrdiff_t>(landmark) * kQuad;
  const double* U_inv = U_inv_.data() + static_cast<std::ptrdiff_t>(landmark) * Hessian::kLandmarkStride;
  double y[kQuad] = {z[0], z[1], z[2], z[3]};
  kernels_.back_substitute(size, incidences_.incidences.data() + incidences_.begin[l],
                           incidences_.begin[l + 1] - incidences_.begin[l], Y_.data(), padded_frame_step_.data(), y);
  MultiplyLowerTransposed(size, U_inv, y, landmark_step + DampingOffset(landmark));
}

std::int64_t Elimination::Bytes() const {
  return static_cast<std::int64_t>(sizeof(double) * (U_inv_.size() + z_.size() + Y_.size() + S_.size() + b_.size()));
}

}  // namespace inceres::internal
