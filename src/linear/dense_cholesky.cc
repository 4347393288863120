#include "linear/dense_cholesky.h"

#include <algorithm>

#include "linear/dense_panel.h"
#include "linear/not_positive_definite.h"
#include "simd/kernels.h"

namespace inceres::internal {

// Left-looking Cholesky by panels of columns (Golub & Van Loan, section 4.2; docs/algorithms.md,
// "Reduced linear systems"). For each panel: subtract what all columns ahead of it contribute,
// factor its diagonal block, solve for the rows below. Each entry is so updated by one long
// product, which the kernels keep in registers, where a right-looking form would read and write the
// rest of the matrix once a panel.
//
// The rows of the factor begin where the envelope of the order does: what is ahead of a row's first
// block stays zero and is left out, rounded to whole panels and to granules of rows. Strips of rows
// with the same beginning are the unit of work and of tasks. They are cut by the structure alone
// and in whole granules, so the arithmetic does not depend on the number of threads.

namespace {

// Columns a panel: few lose little to the rounding of row starts, more read a matrix beyond the
// caches less often.
constexpr int kNarrowPanel = 12;
constexpr int kWidePanel = 24;
constexpr int kWidePanelSize = 600;
// rows whose first column is looked at together: whole vectors of every kernel
constexpr int kGranule = 12;
constexpr int kRowStrip = 96;  // rows a task: whole granules, so tasks do not change the arithmetic
// Such a matrix is not worth waking a thread. Its rows begin where they do, and columns are taken a
// tile at a time: windows of some poses leave much out. The kernel takes its sums in one slice
// each, so that nothing but zeros is left out of them.
constexpr int kSmallSize = 192;
constexpr int kTileColumns = 4;

}  // namespace

Status DenseCholesky::Analyze(const ReducedMatrix& A) {
  const BlockPattern& pattern = A.pattern();
  pattern_ = &pattern;
  // The symbolic work, kept until the pattern changes.
  order_ = OrderForEnvelope(pattern);
  size_ = pattern.size();
  padded_size_ = PadToQuad(size_);
  panel_ = size_ < kWidePanelSize ? kNarrowPanel : kWidePanel;
  stride_ = padded_size_;
  // A power-of-two distance between columns would map them all to the same few cache sets.
  if (stride_ % 128 == 0) {
    stride_ += kQuad;
  }
  // Above the diagonal nothing is read but within a panel, so that pages of a large matrix up there
  // are never touched. Room of a larger system before is kept: CopyIn overwrites what it holds.
  const std::size_t room = stride_ * static_cast<std::size_t>(size_);
  if (L_.size() < room) {
    L_ = ZeroedArray::Unwritten(room);
  }
  right_side_.assign(padded_size_, 0.0);
  FindRowStarts();
  CutPanels();
  return Status::Ok();
}

bool DenseCholesky::IsSmall() const {
  return size_ <= kSmallSize;
}

void DenseCholesky::FindRowStarts() {
  offset_of_.resize(pattern_->num_blocks());
  quad_start_.assign(padded_size_ / kQuad, padded_size_);
  // Down to the first column of a panel in a larger matrix: a panel is taken as a whole or not at
  // all.
  const int step = IsSmall() ? 1 : panel_;
  for (int place = 0; place < pattern_->num_blocks(); ++place) {
    offset_of_[order_.blocks[place]] = order_.offsets[place];
    const int start = order_.offsets[order_.first[place]] / step * step;
    for (int row = order_.offsets[place]; row < order_.offsets[place + 1]; ++row) {
      quad_start_[row / kQuad] = std::min(quad_start_[row / kQuad], start);
    }
  }
}

// The first column in which any of these rows has something.
int DenseCholesky::StartOf(int top, int bottom) const {
  return *std::min_element(quad_start_.begin() + top / kQuad,
                           quad_start_.begin() + PadToQuad(bottom) / kQuad);
}

// Granule by granule: neighbors with the same start become one strip, up to the length of a task.
void DenseCholesky::Append(const Strip& granule, std::vector<Strip>* strips) {
  if (!strips->empty() && strips->back().bottom == granule.top &&
      strips->back().start == granule.start && granule.top - strips->back().top < kRowStrip) {
    strips->back().bottom = granule.bottom;
  } else {
    strips->push_back(granule);
  }
}

// The rows from the group's first on that products with the columns ahead of `first` reach. They
// begin at the later of a strip's start and that of the group's own rows.
void DenseCholesky::CutGroup(int first, Group* group) const {
  std::vector<Strip>& strips = group->updated;
  strips.clear();
  const int earliest = StartOf(group->left, group->right);
  for (int top = group->left; earliest < first && top < padded_size_; top += kGranule) {
    const int bottom = std::min(top + kGranule, padded_size_);
    const int start = std::max(earliest, StartOf(top, bottom));
    if (start < first) {
      Append({top, bottom, start}, &strips);
    }
  }
}

// The rows behind a panel that have something in its columns.
void DenseCholesky::CutBelow(int first, int end, std::vector<Strip>* strips) const {
  strips->clear();
  for (int top = end; top < padded_size_; top += kGranule) {
    const int bottom = std::min(top + kGranule, padded_size_);
    if (StartOf(top, bottom) < end) {
      Append({top, bottom, first}, strips);
    }
  }
}

void DenseCholesky::CutPanels() {
  panels_.resize(static_cast<std::size_t>((size_ + panel_ - 1) / panel_));
  const int columns = IsSmall() ? kTileColumns : panel_;
  int first = 0;
  for (Panel& panel : panels_) {
    const int end = std::min(first + panel_, size_);
    panel.groups.resize(static_cast<std::size_t>((end - first + columns - 1) / columns));
    int left = first;
    for (Group& group : panel.groups) {
      group.left = left;
      group.right = left = std::min(left + columns, end);
      CutGroup(first, &group);
    }
    CutBelow(first, end, &panel.below);
    first = end;
  }
}

double DenseCholesky::ProductFlops() const {
  double flops = 0.0;
  int first = 0;
  for (const Panel& panel : panels_) {
    for (const Group& group : panel.groups) {
      for (const Strip& strip : group.updated) {
        flops +=
            2.0 * (strip.bottom - strip.top) * (group.right - group.left) * (first - strip.start);
      }
    }
    first += panel_;
  }
  return flops;
}

// The blocks of S keep to one side of the diagonal; in another order some belong on the other.
void DenseCholesky::CopyIn(const ReducedMatrix& A) {
  for (int j = 0; j < size_; ++j) {
    // From the panel's first row on: the kernels take the diagonal block as a square.
    std::fill(Column(j) + j / panel_ * panel_, Column(j) + padded_size_, 0.0);
  }
  A.ForEachBlock([this](int i, int j, const double* block, int stride) {
    PlaceBlock(block, stride, pattern_->block_size(i), pattern_->block_size(j), offset_of_[i],
               offset_of_[j], L_.data(), stride_);
  });
  for (int block = 0; block < pattern_->num_blocks(); ++block) {
    for (int r = 0; r < pattern_->block_size(block); ++r) {
      // The diagonal is packed by the pattern's order, the columns by this one's.
      Column(offset_of_[block] + r)[offset_of_[block] + r] +=
          A.diagonal()[pattern_->offsets[block] + r];
    }
  }
}

// Subtracts what the columns ahead of the panel contribute to a group of its columns. The rows of
// the padding are zero and stay so: with them there is nothing left over for the kernels to do one
// by one.
void DenseCholesky::UpdateGroup(int first, const Group& group) {
  const Kernels& kernels = BestKernels();
  const std::vector<Strip>& strips = group.updated;
  const auto update = [&](int begin, int end) {
    for (int k = begin; k < end; ++k) {
      const auto [top, bottom, start] = strips[k];
      kernels.subtract_outer(bottom - top, group.right - group.left, first - start,
                             Column(start) + top, stride_, Column(start) + group.left, stride_,
                             Column(group.left) + top, stride_);
    }
  };
  const int num_strips = static_cast<int>(strips.size());
  // One task for all of them where the matrix is small.
  executor_.For(num_strips, IsSmall() ? num_strips : 1, update);
}

void DenseCholesky::SolvePanel(int first, int width) {
  for (const Strip& strip : PanelAt(first).below) {
    BestKernels().solve_lower_transposed(strip.bottom - strip.top, width, Column(first) + first,
                                         stride_, Column(first) + strip.top, stride_);
  }
}

Status DenseCholesky::Factorize(const ReducedMatrix& A, const Rows& /*changed*/) {
  // Always all of it, whatever has changed.
  work_.factor_flops = order_.flops;
  CopyIn(A);
  factored_ = Status::Ok();
  for (int first = 0; first < size_ && factored_.ok(); first += panel_) {
    const int width = std::min(panel_, size_ - first);
    int failed = 0;
    for (const Group& group : PanelAt(first).groups) {
      UpdateGroup(first, group);
    }
    if (FactorDiagonalBlock(Column(first) + first, stride_, width, &failed)) {
      SolvePanel(first, width);
      continue;
    }
    // Back from a scalar row to the place whose rows it is among, and to the frame of the pattern.
    const auto place =
        std::upper_bound(order_.offsets.begin(), order_.offsets.end(), first + failed) -
        order_.offsets.begin() - 1;
    factored_ = NotPositiveDefinite(A.RowId(order_.blocks[place]), &work_);
  }
  return factored_;
}

// A panel at a time: its own triangle, then what is below by a kernel.
Status DenseCholesky::Solve(const double* b, const Rows& /*changed_b*/,
                            const Truncation& /*truncation*/, double* x) {
  if (!factored_.ok()) {
    return factored_;
  }
  const Kernels& kernels = BestKernels();
  double* y = right_side_.data();
  for (int block = 0; block < pattern_->num_blocks(); ++block) {
    std::copy_n(b + pattern_->offsets[block], pattern_->block_size(block), y + offset_of_[block]);
  }
  for (int first = 0; first < size_; first += panel_) {
    const int below = std::min(first + panel_, size_);
    SolveTriangle(Column(first) + first, stride_, below - first, y + first);
    for (const auto& [top, bottom, start] : PanelAt(first).below) {
      kernels.subtract_outer(bottom - top, 1, below - first, Column(first) + top, stride_,
                             y + first, 1, y + top, padded_size_);
    }
  }
  // Backwards the columns below are dot products: L is stored by columns, so Lᵀ by rows.
  for (int first = (static_cast<int>(panels_.size()) - 1) * panel_; first >= 0; first -= panel_) {
    const int below = std::min(first + panel_, size_);
    for (const auto& [top, bottom, start] : PanelAt(first).below) {
      kernels.subtract_row_dots(below - first, 1, bottom - top, Column(first) + top, stride_,
                                y + top, size_, y + first, 1);
    }
    SolveTransposedTriangle(Column(first) + first, stride_, below - first, y + first);
  }
  for (int block = 0; block < pattern_->num_blocks(); ++block) {
    std::copy_n(y + offset_of_[block], pattern_->block_size(block), x + pattern_->offsets[block]);
  }
  return Status::Ok();
}

}  // namespace inceres::internal
