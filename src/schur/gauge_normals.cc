#include "schur/gauge_normals.h"

#include <algorithm>
#include <cmath>
#include <utility>

#include "base/counting_sort.h"
#include "linear/pattern_rows.h"
#include "linearize/single_jacobians.h"

namespace inceres::internal {

// Sums for the modes of frames (gauge_modes.cc): C = J_cᵀJ_c, R = −J_cᵀ(J_l w) and ‖J_l w‖² over
// the factors of Euclidean landmarks. w has a column for each generator of a similarity at the
// point p, taken about a center and in units of a radius: e_k (translations), e_k × p (rotations),
// p (scale).
//
// The factor's corrected Jacobians are read, so a loss has its say in what counts. A row of R and
// of C belongs to a frame, and a frame to one task, which sums over sources and factors in their
// order: no task adds to another's rows, and the bits do not depend on the number of threads.
//
// What depends on the structure is set up once: by family and pair of slots, the factors that
// count, sorted by frame; and the pattern of J_cᵀJ_c over these factors, for the sparse Cholesky.

namespace {

constexpr int kPoint = 3;
constexpr int kModesRowGrain = 32;

// Of an even number of values the upper one of the two in the middle. Reorders them.
double Median(std::vector<double>* values) {
  const auto middle = values->begin() + static_cast<std::ptrdiff_t>(values->size() / 2);
  std::nth_element(values->begin(), middle, values->end());
  return *middle;
}

}  // namespace

GaugeSums::GaugeSums(const BlockPattern& pattern)
    : C(static_cast<std::size_t>(pattern.value_begin.back())),
      R(static_cast<std::size_t>(pattern.size()) * kGaugeStride),
      squares(static_cast<std::size_t>(pattern.num_blocks()) * kGaugeStride) {
}

std::int64_t GaugeSums::Bytes() const {
  return static_cast<std::int64_t>((C.size() + R.size() + squares.size()) * sizeof(double));
}

// Sources and pattern depend on connections alone and are made once.
GaugeNormals::GaugeNormals(const Evaluator& evaluator, std::vector<char> is_shared)
    : evaluator_(evaluator), is_shared_(std::move(is_shared)) {
  CollectSources();
  BuildPattern();
}

// −1 also of a shared frame: it is held while the others follow.
int GaugeNormals::FrameThrough(const Linearization& cache, int factor, int slot) const {
  const int frame = evaluator_.layout().FrameOf(
      evaluator_.graph().Variables(cache.id, 0)[cache.Entry(factor) + slot]);
  return frame >= 0 && is_shared_[frame] == 0 ? frame : -1;
}

// If it is Euclidean.
int GaugeNormals::LandmarkThrough(const Linearization& cache, int factor, int slot) const {
  const VariableId id = evaluator_.graph().Variables(cache.id, 0)[cache.Entry(factor) + slot];
  const int landmark = evaluator_.layout().LandmarkOf(id);
  // Three numbers without a manifold: whether they are a point is what the misfit of the modes
  // tells.
  const bool euclidean = landmark >= 0 && evaluator_.graph().AmbientSize(id) == kPoint &&
                         evaluator_.graph().manifold(id) == nullptr;
  return euclidean ? landmark : -1;
}

// A source for each pair of a slot with a Euclidean landmark and another slot that has a frame.
void GaugeNormals::CollectSources() {
  for (const Linearization& cache : evaluator_.families()) {
    for (int p = 0; p < cache.num_slots; ++p) {
      std::vector<std::int32_t> factors;
      for (int i = 0; i < cache.num_factors; ++i) {
        const VariableId id = evaluator_.graph().Variables(cache.id, 0)[cache.Entry(i) + p];
        // Of all landmarks, Euclidean or not: the share decides whether modes are of any use.
        num_of_landmarks_ += evaluator_.layout().LandmarkOf(id) >= 0 ? 1.0 : 0.0;
        if (LandmarkThrough(cache, i, p) >= 0) {
          factors.push_back(i);
        }
      }
      num_of_points_ += static_cast<double>(factors.size());
      for (int s = 0; !factors.empty() && s < cache.num_slots; ++s) {
        if (s != p) {
          AddSource(cache, s, p, factors);
        }
      }
    }
  }
}

void GaugeNormals::AddSource(const Linearization& cache, int slot, int landmark_slot,
                             const std::vector<std::int32_t>& factors) {
  Source source{cache.id, slot, landmark_slot, {}, {}};
  // No frame: that of a constant, or a shared one.
  const auto for_each_factor = [&](const auto& add) {
    for (const std::int32_t i : factors) {
      const int frame = FrameThrough(cache, i, slot);
      if (frame >= 0) {
        add(frame, i);
      }
    }
  };
  CountingSort(evaluator_.layout().num_frames, for_each_factor, &source.begin, &source.factors);
  // The slot may belong to shared frames only: such a source would have nothing to say.
  if (!source.factors.empty()) {
    sources_.push_back(std::move(source));
  }
}

// Two frames are coupled if a factor of a source touches both. The diagonal block is there for all
// frames, also for those without such a factor, and is last in its row.
void GaugeNormals::BuildPattern() {
  const Layout& layout = evaluator_.layout();
  pattern_ = PatternWithoutBlocks(layout.FrameOffsets());
  RowColumns columns(layout.num_frames);
  for (int row = 0; row < layout.num_frames; ++row) {
    columns.Begin(row);
    for (const Source& source : sources_) {
      const Linearization& cache = evaluator_.families()[source.family];
      for (int k = source.begin[row]; k < source.begin[row + 1]; ++k) {
        for (int s = 0; s < cache.num_slots; ++s) {
          const int other = FrameThrough(cache, source.factors[k], s);
          if (other >= 0) {
            columns.Add(other);
          }
        }
      }
    }
    AppendRow(columns.Ascending(), &pattern_);
  }
}

// Medians, for a few points far away would otherwise set both center and radius.
// Whatever the coordinates, modes are numbers of the same size.
GaugeOrigin GaugeNormals::FindOrigin() const {
  const FactorGraph& graph = evaluator_.graph();
  const Layout& layout = evaluator_.layout();
  const double* const state = evaluator_.points().current().data();
  std::vector<const double*> points;
  for (int l = layout.num_frames; l < static_cast<int>(layout.variables.size()); ++l) {
    const VariableId id = layout.variables[l];
    if (graph.AmbientSize(id) == kPoint && graph.manifold(id) == nullptr) {
      points.push_back(graph.ValuesIn(state, id));
    }
  }
  GaugeOrigin origin;
  origin.num_points = static_cast<double>(points.size());
  // num_points tells who merges origins of several processes that this one has no part in it.
  if (points.empty()) {
    return origin;
  }
  std::vector<double> values(points.size());
  double squared_radius = 0.0;
  for (int k = 0; k < kPoint; ++k) {
    std::transform(points.begin(), points.end(), values.begin(),
                   [k](const double* point) { return point[k]; });
    origin.center[k] = Median(&values);
    // The same array again: Median has reordered it, and the order does not matter.
    for (double& value : values) {
      value = std::abs(value - origin.center[k]);
    }
    squared_radius += std::pow(Median(&values), 2);
  }
  // Points that coincide have no size of their own.
  origin.radius = squared_radius > 0.0 ? std::sqrt(squared_radius) : 1.0;
  return origin;
}

// Adds a factor to the frame's rows of R, and to the squares.
void GaugeNormals::AddFactor(const Source& source, int factor, int frame, const GaugeOrigin& origin,
                             Scratch* scratch, GaugeSums* sums) const {
  const Linearization& cache = evaluator_.families()[source.family];
  const double* const point = cache.Parameters(factor)[source.landmark_slot];
  // Coordinates of the order of one, so that columns of w for rotations and scale are as large as
  // those for translations.
  const double scale = 1.0 / origin.radius;
  const double x = (point[0] - origin.center[0]) * scale;
  const double y = (point[1] - origin.center[1]) * scale;
  const double z = (point[2] - origin.center[2]) * scale;
  double* const R = sums->R.data() + std::ptrdiff_t{kGaugeStride} * pattern_.offsets[frame];
  double* const squares = sums->squares.data() + std::ptrdiff_t{frame} * kGaugeStride;
  // Row k is how coordinate k moves under each mode. The eighth column is padding, zero in R and V
  // as well.
  const double w[kPoint][kGaugeStride] = {
      {1, 0, 0, 0, z, -y, x, 0},  // translations, rotations, scale
      {0, 1, 0, -z, 0, x, y, 0},
      {0, 0, 1, y, -x, 0, z, 0}};
  const SlotJacobians& of_point = cache.slots[source.landmark_slot];
  const SlotJacobians& of_frame = cache.slots[source.slot];
  const int record = cache.Record(factor);
  const double* const J_l = WidenedBlock(of_point, record, cache.residual_size, &scratch->landmark);
  const double* const J_c = WidenedBlock(of_frame, record, cache.residual_size, &scratch->frame);
  // A factor of two frames appears in the rows of both, and ‖J_l w‖² counts once.
  bool counts_here = true;  // its first frame counts the factor
  for (int s = 0; s < source.slot; ++s) {
    counts_here = counts_here && FrameThrough(cache, factor, s) < 0;
  }
  // Residual by residual: J_l w of one row of J, for all modes side by side, then its share of R.
  for (int r = 0; r < cache.residual_size; ++r) {
    double moved[kGaugeStride] = {};
    for (int k = 0; k < kPoint; ++k) {
      for (int m = 0; m < kGaugeStride; ++m) {
        moved[m] += J_l[r * of_point.row_stride + k] * w[k][m];
      }
    }
    for (int m = 0; m < kGaugeStride; ++m) {
      squares[m] += counts_here ? moved[m] * moved[m] : 0.0;
    }
    for (int c = 0; c < of_frame.columns; ++c) {
      for (int m = 0; m < kGaugeStride; ++m) {
        R[c * kGaugeStride + m] -= J_c[r * of_frame.row_stride + c] * moved[m];
      }
    }
  }
  AddBlocks(source, factor, frame, J_c, scratch, sums);
}

// And to J_cᵀJ_c.
void GaugeNormals::AddBlocks(const Source& source, int factor, int frame, const double* J_c,
                             Scratch* scratch, GaugeSums* sums) const {
  const Linearization& cache = evaluator_.families()[source.family];
  const SlotJacobians& of_frame = cache.slots[source.slot];
  for (int s = 0; s < cache.num_slots; ++s) {
    const int other = FrameThrough(cache, factor, s);
    // The lower triangle, row by row of `frame`; the rest comes with the rows of the other frame.
    if (other < 0 || other > frame) {
      continue;
    }
    double* const out = sums->C.data() + pattern_.value_begin[FindBlock(pattern_, frame, other)];
    const SlotJacobians& of_other = cache.slots[s];
    const double* const J_o = s == source.slot ? J_c
                                               : WidenedBlock(of_other, cache.Record(factor),
                                                              cache.residual_size, &scratch->other);
    for (int r = 0; r < cache.residual_size; ++r) {
      for (int i = 0; i < of_frame.columns; ++i) {
        const double a = J_c[r * of_frame.row_stride + i];
        for (int j = 0; j < of_other.columns; ++j) {
          out[i * of_other.columns + j] += a * J_o[r * of_other.row_stride + j];
        }
      }
    }
  }
}

// Each task clears and sums its own stretch of R, of the squares and of C: rows of frames lie
// together in all three.
void GaugeNormals::AccumulateRows(int begin, int end, const GaugeOrigin& origin,
                                  GaugeSums* sums) const {
  const auto clear = [](std::vector<double>* values, std::int64_t first, std::int64_t last) {
    std::fill(values->begin() + first, values->begin() + last, 0.0);
  };
  clear(&sums->R, std::int64_t{kGaugeStride} * pattern_.offsets[begin],
        std::int64_t{kGaugeStride} * pattern_.offsets[end]);
  clear(&sums->squares, std::int64_t{kGaugeStride} * begin, std::int64_t{kGaugeStride} * end);
  clear(&sums->C, pattern_.value_begin[pattern_.row_begin[begin]],
        pattern_.value_begin[pattern_.row_begin[end]]);
  Scratch scratch;
  for (int frame = begin; frame < end; ++frame) {
    for (const Source& source : sources_) {
      for (int k = source.begin[frame]; k < source.begin[frame + 1]; ++k) {
        AddFactor(source, source.factors[k], frame, origin, &scratch, sums);
      }
    }
  }
}

void GaugeNormals::Accumulate(const GaugeOrigin& origin, GaugeSums* sums) const {
  // Shared frames have rows too, which stay zero: no source names them.
  evaluator_.executor().For(pattern_.num_blocks(), kModesRowGrain,
                            [&](int begin, int end) { AccumulateRows(begin, end, origin, sums); });
}

// Of the lists of factors, which are most of it.
std::int64_t GaugeNormals::Bytes() const {
  std::int64_t bytes = 0;
  for (const Source& source : sources_) {
    bytes += static_cast<std::int64_t>((source.begin.size() + source.factors.size()) * sizeof(int));
  }
  return bytes;
}

}  // namespace inceres::internal
