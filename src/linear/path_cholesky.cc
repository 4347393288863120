#include "linear/path_cholesky.h"

#include <algorithm>
#include <functional>
#include <utility>

#include "linear/not_positive_definite.h"
#include "simd/kernels.h"

namespace inceres::internal {

// Paths of S before the rest of it (docs/algorithms.md, "Reduced linear systems"). With N the block
// between a node and the next one, and A the one between the node and the anchor at which the path
// begins, each node in turn leaves
//
//     S_next,next −= N Nᵀ,    S_anchor,next −= A Nᵀ,    S_anchor,anchor −= A Aᵀ,
//
// so that a path of any length is a band of two blocks a column (simd/path_kernels_body.inc), and
// leaves three blocks in the rest, which is a matrix of nodes. The fronts of a multifrontal factor
// would be as small, and what is around a front takes longer than the arithmetic in it.
//
// A factorization eliminates each path, adds what it leaves to the rest, and factors that; a solve
// goes forwards along each path, solves the rest, and goes backwards along each path. Paths have
// memory of their own and are cut into tasks; what they leave is added by the calling thread, path
// by path, so that a block of the rest in which several paths end is a sum in their order, and the
// bits do not depend on the number of threads.
//
// The order of elimination is one of the many that there are, so stability is that of any Cholesky
// factorization of a positive definite matrix: no pivots are looked for, and one that is not
// positive and finite ends it.

namespace {

// Paths a task.
constexpr int kPathsATask = 8;

// Of rows `stride` apart, to places `row_step` and `column_step` apart. kSize: of a square block.
template <int kSize>
void CopyBlock(const double* from, int stride, int rows, int columns, double* to,
               std::ptrdiff_t row_step, std::ptrdiff_t column_step) {
  const int num_rows = kSize > 0 ? kSize : rows, num_columns = kSize > 0 ? kSize : columns;
#pragma GCC unroll 6
  for (int r = 0; r < num_rows; ++r) {
#pragma GCC unroll 6
    for (int c = 0; c < num_columns; ++c) {
      to[r * row_step + c * column_step] = from[r * stride + c];
    }
  }
}

}  // namespace

template <typename Body>
void PathCholesky::ForPaths(const Body& body) const {
  executor_.For(static_cast<int>(plan_.paths().size()), kPathsATask, [&](int begin, int end) {
    for (int p = begin; p < end; ++p) {
      body(p);
    }
  });
}

Status PathCholesky::Analyze(const ReducedMatrix& A) {
  return Analyze(A.pattern(), FindBlockPaths(A.pattern()));
}

// Arrays only grow: a solve whose pattern changes little takes no new memory. The rest is analyzed
// with the pattern that it has after all paths are gone, and with values that mean nothing yet:
// only where blocks are is looked at.
Status PathCholesky::Analyze(const BlockPattern& pattern, BlockPaths paths) {
  factored_ = Status::Error(StatusCode::kInvalidArgument, "not factored yet");
  plan_ = PathPlan(pattern, std::move(paths));
  tiles_.resize(plan_.sizes().tiles);
  vectors_.resize(plan_.sizes().vectors);
  squares_.resize(plan_.sizes().square);
  failed_.assign(plan_.paths().size(), -1);
  const BlockPattern& rest = plan_.rest_pattern();
  rest_values_.resize(static_cast<std::size_t>(rest.value_begin.back()));
  rest_diagonal_.resize(rest.size());
  rest_b_.resize(rest.size());
  rest_x_.resize(rest.size());
  return rest_.Analyze(ReducedMatrix(rest, rest_values_.data(), rest_diagonal_.data()));
}

// A block goes to its place as it is or turned, by the two steps of the piece; planar and spatial
// poses have loops of constant lengths.
void PathCholesky::PlacePiece(const PathPlan::Piece& piece, const ReducedMatrix& A,
                              double* values) const {
  const double* const block = A.Block(piece.i, piece.block);
  if (block == nullptr) {
    return;  // left out: zeros stay
  }
  const BlockPattern& pattern = plan_.pattern();
  const int j = pattern.columns[piece.block];
  const int rows = pattern.block_size(piece.i), columns = pattern.block_size(j);
  const int stride = pattern.row_stride(j);
  double* const to = values + piece.to;
  if (rows == 3 && columns == 3) {
    CopyBlock<3>(block, stride, 3, 3, to, piece.row_step, piece.column_step);
  } else if (rows == 6 && columns == 6) {
    CopyBlock<6>(block, stride, 6, 6, to, piece.row_step, piece.column_step);
  } else {
    CopyBlock<0>(block, stride, rows, columns, to, piece.row_step, piece.column_step);
  }
}

// From assembly to elimination while it is in the cache. Cleared, filled from S, damped and
// eliminated, one path after the other. The tile behind the last node is cleared with them: what
// the path leaves at its end and between its two ends is summed there, and S has no part in it. So
// is the anchor's own block, which lies apart, because each node adds to it. Returns the scalar
// that fails, counted along the path, or −1.
int PathCholesky::EliminatePath(const PathPlan::Path& path, const ReducedMatrix& A) {
  const int stride = path.stride();
  double* const tiles = tiles_.data() + path.at.tiles;
  std::fill_n(tiles, (path.num_nodes() + 1) * path.tile_size(), 0.0);
  for (int k = path.piece_begin; k < path.piece_end; ++k) {
    PlacePiece(plan_.pieces()[k], A, tiles_.data());
  }
  double* tile = tiles;
  for (int k = path.begin; k < path.end; ++k, tile += path.tile_size()) {
    plan_.ForEachRowOfPath(k, [&](int row, int local) {
      const double* const diagonal = A.diagonal() + plan_.pattern().offsets[row];
      for (int r = 0; r < plan_.pattern().block_size(row); ++r) {
        tile[std::ptrdiff_t{local + r} * (stride + 1)] += diagonal[r];
      }
    });
  }
  double* square = nullptr;
  if (path.anchor != BlockPaths::kNone) {
    square = squares_.data() + path.at.square;
    std::fill_n(square, std::ptrdiff_t{path.size} * path.section(), 0.0);
  }
  return BestKernels().eliminate_path(path.size, path.num_nodes(), tiles, square);
}

// Block (row, column) of the rest gains one of the path, of which a column has `column_stride`
// entries. `is_turned`: what is stored is the transpose.
void PathCholesky::AddBlock(const double* from, int column_stride, int row, int column, int size,
                            bool is_turned) {
  double* const to =
      rest_values_.data() + plan_.RestBlock(std::max(row, column), std::min(row, column));
  const int row_step = is_turned ? 1 : size, column_step = is_turned ? size : 1;
  for (int c = 0; c < size; ++c) {
    for (int r = 0; r < size; ++r) {
      to[r * row_step + c * column_step] += from[c * column_stride + r];
    }
  }
}

// Three blocks: next with next, anchor with anchor, and anchor with next. They have minus signs
// already, for the kernels subtract from zeros. The section for the anchor in the last tile has the
// anchor's rows and the columns of what is next, so it is turned where the rest has that block the
// other way around.
void PathCholesky::AddToRest(const PathPlan::Path& path) {
  if (path.next == BlockPaths::kNone) {
    return;
  }
  const int section = path.section(), stride = path.stride(), size = path.size;
  const double* const end = tiles_.data() + path.at.tiles + path.num_nodes() * path.tile_size();
  const int next = plan_.RestRow(path.next);
  AddBlock(end, stride, next, next, size, /*is_turned=*/false);
  if (path.anchor == BlockPaths::kNone) {
    return;
  }
  const int anchor = plan_.RestRow(path.anchor);
  AddBlock(squares_.data() + path.at.square, section, anchor, anchor, size,
           /*is_turned=*/false);
  AddBlock(end + section, stride, anchor, next, size, /*is_turned=*/anchor < next);
  if (anchor == next) {
    // Of a ring both halves are in one block.
    AddBlock(end + section, stride, anchor, next, size, /*is_turned=*/true);
  }
}

// S's own blocks between nodes of the rest first, then paths in their order, then the damping of
// its rows, which the sparse factor adds. Everything is formed anew: a factorization of the rest is
// dearer than that, and in a batch solve all of S has changed.
Status PathCholesky::FactorizeRest(const ReducedMatrix& A) {
  const BlockPattern& pattern = plan_.pattern();
  std::fill(rest_values_.begin(), rest_values_.end(), 0.0);
  for (const PathPlan::Piece& piece : plan_.rest_pieces()) {
    PlacePiece(piece, A, rest_values_.data());
  }
  for (const PathPlan::Path& path : plan_.paths()) {
    AddToRest(path);
  }
  plan_.ForEachRowOfRest([&](int row, int scalar) {
    std::copy_n(A.diagonal() + pattern.offsets[row], pattern.block_size(row),
                rest_diagonal_.begin() + scalar);
  });
  return rest_.Factorize(
      ReducedMatrix(plan_.rest_pattern(), rest_values_.data(), rest_diagonal_.data()), {});
}

// All paths are eliminated even if one fails, as tasks know nothing of each other; the culprit is
// the first in the order of the paths, and the same for any number of threads. What is returned is
// remembered, so that a solve without a factor says why there is none.
Status PathCholesky::Factorize(const ReducedMatrix& A, const Rows& /*changed*/) {
  work_.factor_flops = PredictedFlops();
  ForPaths([&](int p) { failed_[p] = EliminatePath(plan_.paths()[p], A); });
  const bool is_definite =
      std::all_of(failed_.begin(), failed_.end(), [](int scalar) { return scalar < 0; });
  if (is_definite) {
    factored_ = FactorizeRest(A);
  }
  if (!is_definite || factored_.code == StatusCode::kSingular) {
    factored_ = NotPositiveDefinite(A.RowId(RowThatFails()), &work_);
  }
  return factored_;
}

// Of the first path that fails, in their order; else of the rest, where it is known to a node. Of a
// path the failing scalar tells the node, and within it the last block row that begins at or before
// the scalar. The rest names one of its rows, which is a node; its first block row stands for it.
int PathCholesky::RowThatFails() const {
  const auto failed =
      std::find_if(failed_.begin(), failed_.end(), [](int scalar) { return scalar >= 0; });
  int culprit = -1;
  if (failed == failed_.end()) {
    plan_.ForEachRowOfRest(rest_.failed(),
                           [&](int row, int local) { culprit = local == 0 ? row : culprit; });
    return culprit;
  }
  const PathPlan::Path& path = plan_.paths()[failed - failed_.begin()];
  plan_.ForEachRowOfPath(path.begin + *failed / path.size, [&](int row, int local) {
    culprit = local <= *failed % path.size ? row : culprit;
  });
  return culprit;
}

// y = L⁻¹ b of a path, in padded sections, and what it takes from its two ends. Sections of the two
// ends begin with zeros, and afterwards have −Σ L y of the path, which SolveRest adds to the rest's
// b. Where a path ends freely L has zeros, and such a section stays zero.
void PathCholesky::SolveForward(const PathPlan::Path& path, const double* b) {
  const BlockPattern& pattern = plan_.pattern();
  double* y = VectorsOf(path);
  std::fill_n(y, std::ptrdiff_t{path.num_nodes() + 2} * path.section(), 0.0);
  for (int k = path.begin; k < path.end; ++k, y += path.section()) {
    plan_.ForEachRowOfPath(k, [&](int row, int local) {
      std::copy_n(b + pattern.offsets[row], pattern.block_size(row), y + local);
    });
  }
  BestKernels().solve_path_forward(path.size, path.num_nodes(), tiles_.data() + path.at.tiles,
                                   VectorsOf(path), AnchorOf(path));
}

// Again by the calling thread, in the order of the paths: an entry of b in which several paths end
// is a sum in that order.
Status PathCholesky::SolveRest(const double* b, double* x) {
  const BlockPattern &pattern = plan_.pattern(), &rest = plan_.rest_pattern();
  plan_.ForEachRowOfRest([&](int row, int scalar) {
    std::copy_n(b + pattern.offsets[row], pattern.block_size(row), rest_b_.begin() + scalar);
  });
  const auto add = [&](int node, const double* section, int size) {
    if (node != BlockPaths::kNone) {
      double* const to = rest_b_.data() + rest.offsets[plan_.RestRow(node)];
      std::transform(section, section + size, to, to, std::plus<>());
    }
  };
  for (const PathPlan::Path& path : plan_.paths()) {
    add(path.next, NextOf(path), path.size);
    add(path.anchor, AnchorOf(path), path.size);
  }
  const Status solved = rest_.Solve(rest_b_.data(), {}, {}, rest_x_.data());
  if (solved.ok()) {
    plan_.ForEachRowOfRest([&](int row, int scalar) {
      std::copy_n(rest_x_.begin() + scalar, pattern.block_size(row), x + pattern.offsets[row]);
    });
  }
  return solved;
}

// x = L⁻ᵀ y of a path, whose ends are known by now; where it is free, L has zeros.
void PathCholesky::SolveBackward(const PathPlan::Path& path, double* x) {
  const BlockPattern& pattern = plan_.pattern();
  const auto take = [&](int node, double* section) {
    if (node != BlockPaths::kNone) {
      std::copy_n(rest_x_.begin() + plan_.rest_pattern().offsets[plan_.RestRow(node)], path.size,
                  section);
    }
  };
  take(path.next, NextOf(path));
  take(path.anchor, AnchorOf(path));
  double* y = VectorsOf(path);
  BestKernels().solve_path_backward(path.size, path.num_nodes(), tiles_.data() + path.at.tiles,
                                    AnchorOf(path), y);
  for (int k = path.begin; k < path.end; ++k, y += path.section()) {
    plan_.ForEachRowOfPath(k, [&](int row, int local) {
      std::copy_n(y + local, pattern.block_size(row), x + pattern.offsets[row]);
    });
  }
}

Status PathCholesky::Solve(const double* b, const Rows& /*changed_b*/,
                           const Truncation& /*truncation*/, double* x) {
  if (!factored_.ok()) {
    return factored_;
  }
  ForPaths([&](int p) { SolveForward(plan_.paths()[p], b); });
  const Status solved = SolveRest(b, x);
  if (solved.ok()) {
    ForPaths([&](int p) { SolveBackward(plan_.paths()[p], x); });
  }
  return solved;
}

// Paths in their order, each from its first node on, then what is left, in the order of the sparse
// factor.
std::vector<int> PathCholesky::order() const {
  std::vector<int> rows;
  const auto add = [&rows](int row, int) { rows.push_back(row); };
  for (const PathPlan::Path& path : plan_.paths()) {
    for (int k = path.begin; k < path.end; ++k) {
      plan_.ForEachRowOfPath(k, add);
    }
  }
  for (const int row : rest_.tree().order) {
    plan_.ForEachRowOfRest(row, add);
  }
  return rows;
}

std::size_t PathCholesky::Bytes() const {
  const std::size_t doubles = tiles_.capacity() + squares_.capacity() + vectors_.capacity() +
                              rest_values_.capacity() + 3 * rest_b_.capacity();
  return rest_.Bytes() + plan_.Bytes() + doubles * sizeof(double);
}

}  // namespace inceres::internal
