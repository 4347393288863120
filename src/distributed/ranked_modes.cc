#include <algorithm>
#include <utility>

#include "distributed/ranked_two_level.h"
#include "linear/pattern_rows.h"

namespace inceres::internal {

// V of the two-level preconditioner over ranks: how each aggregate moves as a whole. The modes v of
// the frames are the least-squares solution of J_c v = −J_l w, w an infinitesimal similarity of the
// landmarks (docs/algorithms.md, "Reduced linear systems", two levels). Its normal equations
// J_cᵀJ_c V = −J_cᵀJ_l w are sums over factors, so each rank forms its own, they are added up, and
// each rank solves the sum for all frames: the same bits everywhere, and no exchange of V.
//
// Two numberings meet here: positions in the layout of this rank, and numbers of frames among those
// of all ranks. Sums are by numbers; a block whose two frames have the opposite order there is
// transposed on the way.
//
// Kept between calls: the patterns, the sums and V. Compute is called when the Jacobians are new; a
// refused step uses V again.

namespace {

// CoarseColumns for V alone: no row is coupled, so no A V is allocated.
CoarseShape ShapeWithoutProducts(const FrameAggregates& all, std::vector<int> widths) {
  CoarseShape shape;
  shape.aggregate_of = all.clusters.cluster_of;
  shape.coupled_begin.assign(widths.size() + 1, 0);
  shape.widths = std::move(widths);
  return shape;
}

// Where the diagonal block of each frame begins.
std::vector<std::int64_t> SquaresOf(const std::vector<int>& sizes) {
  std::vector<std::int64_t> begin{0};
  for (const int size : sizes) {
    begin.push_back(begin.back() + std::int64_t{size} * size);
  }
  return begin;
}

}  // namespace

RankedModes::RankedModes(const RankedParts& parts, const RankedAggregates& aggregates,
                         Status* status)
    : parts_(parts),
      by_frame_(aggregates.by_frame),
      normals_(parts.evaluator, aggregates.here.is_shared),
      C_sums_(parts.ranks, parts.frames.sizes(), PlacesHere()),
      here_(normals_.pattern()),
      all_(C_sums_.pattern()),
      fit_(C_sums_.pattern(), parts.evaluator.executor(), status) {
  // Most of the landmarks of all ranks must be Euclidean; the counts are summed, so all ranks
  // decide the same.
  by_gauge_ = 2.0 * parts.ranks.Sum(normals_.num_of_points()) >
              parts.ranks.Sum(normals_.num_of_landmarks());
  const std::vector<int>& offsets = C_sums_.pattern().offsets;
  columns_ = std::make_unique<ModeColumns>(aggregates.all, offsets, by_gauge_);
  V_ = std::make_unique<CoarseColumns>(offsets,
                                       ShapeWithoutProducts(aggregates.all, columns_->widths()),
                                       parts.evaluator.executor());
  *status = parts.ranks.Agree(*status);
}

// Blocks of the normal equations that factors here add to, by the numbers of the frames.
std::vector<BlockSums::Place> RankedModes::PlacesHere() const {
  std::vector<BlockSums::Place> places;
  ForEachBlock(normals_.pattern(), [&](int i, int j, int /*block*/) {
    const int row = parts_.frames.moving()[i].number, column = parts_.frames.moving()[j].number;
    places.emplace_back(std::max(row, column), std::min(row, column));
  });
  return places;
}

// The mean of those of the ranks: any point amid the landmarks will do.
GaugeOrigin RankedModes::AgreeOnOrigin() const {
  // Weighted by the number of points. The origin and the radius only condition the normal
  // equations; what the modes span hardly depends on them, but all ranks must take the same.
  const GaugeOrigin own = normals_.FindOrigin();
  double sums[5] = {own.num_points, 0.0, 0.0, 0.0, own.num_points * own.radius};
  for (int k = 0; k < 3; ++k) {
    sums[k + 1] = own.num_points * own.center[k];
  }
  parts_.ranks.SumAll(5, sums);
  GaugeOrigin origin;
  if (sums[0] > 0.0) {
    origin.num_points = sums[0];
    origin.radius = sums[4] / sums[0];
    for (int k = 0; k < 3; ++k) {
      origin.center[k] = sums[k + 1] / sums[0];
    }
  }
  return origin;
}

// all_ := the sums of here_.
// Copies each block here to its place in the sums of all; what lies elsewhere is of other ranks,
// and Sum does not send it.
void RankedModes::SumNormals() {
  const BlockPattern& pattern = normals_.pattern();
  for (int i = 0; i < pattern.num_blocks(); ++i) {
    const int row = parts_.frames.moving()[i].number;
    const int rows = pattern.block_size(i);
    for (int k = pattern.row_begin[i]; k < pattern.row_begin[i + 1]; ++k) {
      const int column = parts_.frames.moving()[pattern.columns[k]].number;
      const int columns = pattern.block_size(pattern.columns[k]);
      const double* const from = here_.C.data() + pattern.value_begin[k];
      const int block = C_sums_.Find({std::max(row, column), std::min(row, column)});
      double* const to = all_.C.data() + C_sums_.pattern().value_begin[block];
      for (int r = 0; r < rows; ++r) {  // the other way around where numbers are
        for (int c = 0; c < columns; ++c) {
          // The target is row-major with `columns` of the smaller number.
          to[row >= column ? r * columns + c : c * rows + r] = from[r * columns + c];
        }
      }
    }
    std::copy_n(here_.R.begin() + std::int64_t{kGaugeStride} * pattern.offsets[i],
                kGaugeStride * rows,
                all_.R.begin() + std::int64_t{kGaugeStride} * C_sums_.pattern().offsets[row]);
    std::copy_n(here_.squares.begin() + std::int64_t{kGaugeStride} * i, kGaugeStride,
                all_.squares.begin() + std::int64_t{kGaugeStride} * row);
  }
  // R has kGaugeStride numbers for each scalar row of a frame, the squares as many for each frame.
  C_sums_.Sum(all_.C.data());
  by_frame_.Sum(SegmentBegins(parts_.frames.sizes(), kGaugeStride), all_.R.data());
  by_frame_.Sum(SegmentBegins(std::vector<int>(parts_.frames.sizes().size(), kGaugeStride)),
                all_.squares.data());
}

// Blocks of C on the diagonal, of all frames.
// The norm that makes the columns of V orthonormal within an aggregate: C of all ranks,
// block-diagonal.
std::vector<const double*> RankedModes::SumNorm() {
  const std::vector<std::int64_t> begin = SquaresOf(parts_.frames.sizes());
  norm_.resize(static_cast<std::size_t>(begin.back()));
  const BlockPattern& pattern = parts_.plans.pattern;
  for (int i = 0; i < pattern.num_blocks(); ++i) {
    const int number = parts_.frames.moving()[i].number;
    // The diagonal block is the last one of its row.
    std::copy_n(parts_.hessian.FrameBlock(pattern.row_begin[i + 1] - 1),
                begin[number + 1] - begin[number], norm_.begin() + begin[number]);
  }
  by_frame_.Sum(begin, norm_.data());
  std::vector<const double*> blocks;
  for (std::size_t i = 0; i + 1 < begin.size(); ++i) {
    blocks.push_back(norm_.data() + begin[i]);
  }
  return blocks;
}

// Collective where V comes from modes, and for the norm in any case. Modes that do not fit are
// replaced by columns of unit vectors, by all ranks alike: the fit is computed from the same sums.
void RankedModes::Compute() {
  bool fits = false;
  if (by_gauge_) {
    normals_.Accumulate(AgreeOnOrigin(), &here_);
    SumNormals();
    fits = fit_.Solve(all_);
  }
  columns_->Write(fits ? &fit_ : nullptr, V_.get());
  V_->Orthonormalize(SumNorm());
}

std::int64_t RankedModes::Bytes() const {
  return normals_.Bytes() + here_.Bytes() + all_.Bytes() + fit_.Bytes() + V_->Bytes() +
         static_cast<std::int64_t>(norm_.size() * sizeof(double));
}

}  // namespace inceres::internal
