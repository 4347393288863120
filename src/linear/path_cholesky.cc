#include "linear/path_cholesky.h"

#include <algorithm>
#include <iterator>
#include <utility>

#include "base/counting_sort.h"
#include "linear/not_positive_definite.h"

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

namespace {

// Of all nodes: those on paths, less two for each path, which is what its ends take.
constexpr double kLeastShare = 0.25;
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

bool AreWorthEliminating(const BlockPaths& paths) {
  const double saved =
      static_cast<double>(paths.nodes.size()) - 2.0 * static_cast<double>(paths.paths.size());
  return saved > kLeastShare * paths.num_nodes();
}

// visit(row of S, its first scalar in the node).
template <typename Visit>
void PathCholesky::ForEachRow(int node, const Visit& visit) const {
  for (int k = paths_.node_begin[node]; k < paths_.node_begin[node + 1]; ++k) {
    visit(paths_.blocks[k], local_[paths_.blocks[k]]);
  }
}

template <typename Body>
void PathCholesky::ForPaths(const Body& body) const {
  executor_.For(num_paths(), kPathsATask, [&](int begin, int end) {
    for (int p = begin; p < end; ++p) {
      body(p);
    }
  });
}

Status PathCholesky::Analyze(const ReducedMatrix& A) {
  return Analyze(A.pattern(), FindBlockPaths(A.pattern()));
}

Status PathCholesky::Analyze(const BlockPattern& pattern, BlockPaths paths) {
  pattern_ = &pattern;
  paths_ = std::move(paths);
  factored_ = Status::Error(StatusCode::kInvalidArgument, "not factored yet");
  local_.assign(pattern.num_blocks(), 0);
  for (int n = 0; n < paths_.num_nodes(); ++n) {
    int size = 0;
    for (int k = paths_.node_begin[n]; k < paths_.node_begin[n + 1]; ++k) {
      local_[paths_.blocks[k]] = size;
      size += pattern.block_size(paths_.blocks[k]);
    }
  }
  PlacePaths();
  ListRestRows();
  MakeRestPattern();
  ListPieces();
  return rest_.Analyze(ReducedMatrix(rest_pattern_, rest_values_.data(), rest_diagonal_.data()));
}

void PathCholesky::PlacePaths() {
  places_.assign(paths_.paths.size(), Place());
  path_of_.assign(paths_.num_nodes(), BlockPaths::kNone);
  index_.assign(paths_.num_nodes(), 0);
  path_flops_ = path_entries_ = 0.0;
  std::ptrdiff_t tiles = 0, vectors = 0, squares = 0;
  for (int p = 0; p < num_paths(); ++p) {
    const BlockPaths::Path& path = paths_.paths[p];
    places_[p].tiles = tiles;
    places_[p].vectors = vectors;
    places_[p].square = squares;
    const int count = path.end - path.begin;
    tiles += (count + 1) * TileSize(p);
    vectors += std::ptrdiff_t{count + 2} * Section(p);
    squares += std::ptrdiff_t{path.size} * Section(p);
    for (int k = path.begin; k < path.end; ++k) {
      path_of_[paths_.nodes[k]] = p;
      index_[paths_.nodes[k]] = k - path.begin;
    }
    const double d = path.size;
    path_flops_ += count * d * d * d * (1.0 / 3.0 + 2.0 + 4.0);
    path_entries_ += count * (0.5 * d * (d + 1.0) + 2.0 * d * d);
  }
  tiles_.resize(tiles);
  vectors_.resize(vectors);
  squares_.resize(squares);
  failed_.assign(paths_.paths.size(), -1);
}

void PathCholesky::ListRestRows() {
  rest_nodes_.clear();
  for (int n = 0; n < paths_.num_nodes(); ++n) {
    if (path_of_[n] == BlockPaths::kNone) {
      index_[n] = static_cast<int>(rest_nodes_.size());
      rest_nodes_.push_back(n);
    }
  }
}

// The blocks of S between nodes of the rest, and those that paths leave between their ends.
void PathCholesky::MakeRestPattern() {
  std::vector<std::pair<int, int>> pairs;
  const auto add = [&pairs](int a, int b) { pairs.emplace_back(std::max(a, b), std::min(a, b)); };
  for (int i = 0; i < pattern_->num_blocks(); ++i) {
    const int row = paths_.node_of[i];
    for (int k = pattern_->row_begin[i];
         path_of_[row] == BlockPaths::kNone && k < pattern_->row_begin[i + 1]; ++k) {
      const int column = paths_.node_of[pattern_->columns[k]];
      if (path_of_[column] == BlockPaths::kNone) {
        add(index_[row], index_[column]);
      }
    }
  }
  for (const BlockPaths::Path& path : paths_.paths) {
    if (path.anchor != BlockPaths::kNone) {
      add(index_[path.anchor], index_[path.next]);
    }
  }
  std::sort(pairs.begin(), pairs.end());
  pairs.erase(std::unique(pairs.begin(), pairs.end()), pairs.end());
  rest_pattern_ = BlockPattern();
  rest_pattern_.offsets.assign(1, 0);
  for (const int node : rest_nodes_) {
    int size = 0;
    ForEachRow(node, [&](int row, int) { size += pattern_->block_size(row); });
    rest_pattern_.offsets.push_back(rest_pattern_.offsets.back() + size);
  }
  // A row's own block is its last pair.
  rest_pattern_.row_begin.assign(1, 0);
  rest_pattern_.value_begin.assign(1, 0);
  for (const auto& [row, column] : pairs) {
    rest_pattern_.columns.push_back(column);
    rest_pattern_.value_begin.push_back(rest_pattern_.value_begin.back() +
                                        std::int64_t{rest_pattern_.block_size(row)} *
                                            rest_pattern_.block_size(column));
    if (row == column) {
      rest_pattern_.row_begin.push_back(static_cast<int>(rest_pattern_.columns.size()));
    }
  }
  rest_values_.resize(static_cast<std::size_t>(rest_pattern_.value_begin.back()));
  rest_diagonal_.resize(rest_pattern_.size());
  rest_b_.resize(rest_pattern_.size());
  rest_x_.resize(rest_pattern_.size());
}

// Where a block of the rest begins; row ≥ column.
std::ptrdiff_t PathCholesky::RestBlock(int row, int column) const {
  const auto begin = rest_pattern_.columns.begin();
  const auto at = std::lower_bound(begin + rest_pattern_.row_begin[row],
                                   begin + rest_pattern_.row_begin[row + 1], column);
  return rest_pattern_.value_begin[at - begin];
}

// By the tile that they go to, and those of the rest.
void PathCholesky::ListPieces() {
  rest_pieces_.clear();
  std::vector<int> begin;
  const auto for_each_on_path = [this](const auto& add) {
    for (int i = 0; i < pattern_->num_blocks(); ++i) {
      for (int k = pattern_->row_begin[i]; k < pattern_->row_begin[i + 1]; ++k) {
        const int j = pattern_->columns[k];
        const int p = std::max(path_of_[paths_.node_of[i]], path_of_[paths_.node_of[j]]);
        if (p != BlockPaths::kNone) {
          add(p, PieceOnPath(i, j, k));
        }
      }
    }
  };
  CountingSort(paths_.paths.size(), for_each_on_path, &begin, &pieces_);
  for (int p = 0; p < num_paths(); ++p) {
    places_[p].piece_begin = begin[p];
    places_[p].piece_end = begin[p + 1];
    std::sort(pieces_.begin() + begin[p], pieces_.begin() + begin[p + 1],
              [](const Piece& a, const Piece& b) { return a.to < b.to; });
  }
  for (int i = 0; i < pattern_->num_blocks(); ++i) {
    for (int k = pattern_->row_begin[i]; k < pattern_->row_begin[i + 1]; ++k) {
      const int j = pattern_->columns[k];
      if (path_of_[paths_.node_of[i]] == BlockPaths::kNone &&
          path_of_[paths_.node_of[j]] == BlockPaths::kNone) {
        rest_pieces_.push_back(PieceOfRest(i, j, k));
      }
    }
  }
}

// In the tile of the node that is eliminated first: which section, then the place in it.
PathCholesky::Piece PathCholesky::PieceOnPath(int i, int j, int block) const {
  const int a = paths_.node_of[i], b = paths_.node_of[j];
  const bool is_turned = path_of_[a] != BlockPaths::kNone && a != b &&
                         (path_of_[b] == BlockPaths::kNone || index_[a] < index_[b]);
  // Columns of the tile are those of `own`.
  const int own = is_turned ? a : b, other = is_turned ? b : a;
  const int p = path_of_[own];
  const BlockPaths::Path& path = paths_.paths[p];
  const int section = Section(p), stride = 3 * section;
  int at = 0;
  if (own != other) {
    const bool is_last = index_[own] == path.end - path.begin - 1;
    // Of a ring both ends have the same neighbor, and the last node comes by the section for next.
    const bool is_next =
        path_of_[other] != BlockPaths::kNone ||
        (is_last && other == path.next && !(index_[own] == 0 && path.anchor == other));
    at = is_next ? 2 * section : section;
  }
  const int row = local_[is_turned ? j : i], column = local_[is_turned ? i : j];
  return {i, block,
          places_[p].tiles + index_[own] * TileSize(p) + std::ptrdiff_t{column} * stride + at + row,
          is_turned ? stride : 1, is_turned ? 1 : stride};
}

PathCholesky::Piece PathCholesky::PieceOfRest(int i, int j, int block) const {
  const int a = index_[paths_.node_of[i]], b = index_[paths_.node_of[j]];
  const int row = std::max(a, b), column = std::min(a, b);
  const int stride = rest_pattern_.block_size(column);
  const bool is_turned = a < b;
  const int in_row = local_[is_turned ? j : i], in_column = local_[is_turned ? i : j];
  return {i, block, RestBlock(row, column) + std::ptrdiff_t{in_row} * stride + in_column,
          is_turned ? 1 : stride, is_turned ? stride : 1};
}

void PathCholesky::PlacePiece(const Piece& piece, const ReducedMatrix& A, double* values) const {
  const double* const block = A.Block(piece.i, piece.block);
  if (block == nullptr) {
    return;  // left out: zeros stay
  }
  const int j = pattern_->columns[piece.block];
  const int rows = pattern_->block_size(piece.i), columns = pattern_->block_size(j);
  const int stride = pattern_->row_stride(j);
  double* const to = values + piece.to;
  if (rows == 3 && columns == 3) {
    CopyBlock<3>(block, stride, 3, 3, to, piece.row_step, piece.column_step);
  } else if (rows == 6 && columns == 6) {
    CopyBlock<6>(block, stride, 6, 6, to, piece.row_step, piece.column_step);
  } else {
    CopyBlock<0>(block, stride, rows, columns, to, piece.row_step, piece.column_step);
  }
}

// From assembly to elimination while it is in the cache.
int PathCholesky::EliminatePath(int p, const ReducedMatrix& A) {
  const BlockPaths::Path& path = paths_.paths[p];
  const Place& place = places_[p];
  const int count = path.end - path.begin, stride = 3 * Section(p);
  double* const tiles = tiles_.data() + place.tiles;
  std::fill_n(tiles, (count + 1) * TileSize(p), 0.0);
  for (int k = place.piece_begin; k < place.piece_end; ++k) {
    PlacePiece(pieces_[k], A, tiles_.data());
  }
  double* tile = tiles;
  for (int k = path.begin; k < path.end; ++k, tile += TileSize(p)) {
    ForEachRow(paths_.nodes[k], [&](int row, int local) {
      for (int r = 0; r < pattern_->block_size(row); ++r) {
        tile[std::ptrdiff_t{local + r} * (stride + 1)] += A.diagonal()[pattern_->offsets[row] + r];
      }
    });
  }
  double* square = nullptr;
  if (path.anchor != BlockPaths::kNone) {
    square = squares_.data() + place.square;
    std::fill_n(square, std::ptrdiff_t{path.size} * Section(p), 0.0);
  }
  return BestSmallKernels().eliminate_path(path.size, count, tiles, square);
}

// The rest gains a block of the path, of which a column has `column_stride` entries.
void PathCholesky::AddBlock(const double* from, int column_stride, int row, int column, int size) {
  const bool is_turned = row < column;
  double* const to = rest_values_.data() + RestBlock(std::max(row, column), std::min(row, column));
  const int row_step = is_turned ? 1 : size, column_step = is_turned ? size : 1;
  for (int c = 0; c < size; ++c) {
    for (int r = 0; r < size; ++r) {
      to[r * row_step + c * column_step] += from[c * column_stride + r];
    }
  }
}

void PathCholesky::AddToRest(int p) {
  const BlockPaths::Path& path = paths_.paths[p];
  if (path.next == BlockPaths::kNone) {
    return;
  }
  const int section = Section(p), stride = 3 * section;
  const double* const end =
      tiles_.data() + places_[p].tiles + (path.end - path.begin) * TileSize(p);
  const int next = index_[path.next];
  AddBlock(end, stride, next, next, path.size);
  if (path.anchor == BlockPaths::kNone) {
    return;
  }
  const int anchor = index_[path.anchor];
  AddBlock(squares_.data() + places_[p].square, section, anchor, anchor, path.size);
  AddBlock(end + section, stride, anchor, next, path.size);
  if (anchor == next) {
    // Of one block both halves: what is added for (anchor, next), and for (next, anchor).
    double* const to = rest_values_.data() + RestBlock(next, next);
    for (int c = 0; c < path.size; ++c) {
      for (int r = 0; r < path.size; ++r) {
        to[c * path.size + r] += end[section + c * stride + r];
      }
    }
  }
}

Status PathCholesky::FactorizeRest(const ReducedMatrix& A) {
  std::fill(rest_values_.begin(), rest_values_.end(), 0.0);
  for (const Piece& piece : rest_pieces_) {
    PlacePiece(piece, A, rest_values_.data());
  }
  for (int p = 0; p < num_paths(); ++p) {
    AddToRest(p);
  }
  for (std::size_t row = 0; row < rest_nodes_.size(); ++row) {
    ForEachRow(rest_nodes_[row], [&](int i, int local) {
      std::copy_n(A.diagonal() + pattern_->offsets[i], pattern_->block_size(i),
                  rest_diagonal_.begin() + rest_pattern_.offsets[row] + local);
    });
  }
  const Status status =
      rest_.Factorize(ReducedMatrix(rest_pattern_, rest_values_.data(), rest_diagonal_.data()), {});
  return rest_.failed() < 0
             ? status
             : NotPositiveDefinite(paths_.blocks[paths_.node_begin[rest_nodes_[rest_.failed()]]]);
}

// The first path that fails, in their order, is what is told.
Status PathCholesky::Factorize(const ReducedMatrix& A, const Rows& /*changed*/) {
  work_.factor_flops = PredictedFlops();
  ForPaths([&](int p) { failed_[p] = EliminatePath(p, A); });
  const auto failed =
      std::find_if(failed_.begin(), failed_.end(), [](int scalar) { return scalar >= 0; });
  if (failed == failed_.end()) {
    factored_ = FactorizeRest(A);
    return factored_;
  }
  const BlockPaths::Path& path = paths_.paths[failed - failed_.begin()];
  const int node = paths_.nodes[path.begin + *failed / path.size];
  int culprit = paths_.blocks[paths_.node_begin[node]];
  ForEachRow(node,
             [&](int row, int local) { culprit = local <= *failed % path.size ? row : culprit; });
  factored_ = NotPositiveDefinite(culprit);
  return factored_;
}

Status PathCholesky::Solve(const double* b, const Rows& /*changed_b*/,
                           const Truncation& /*truncation*/, double* x) {
  if (!factored_.ok()) {
    return factored_;
  }
  const SmallKernels& kernels = BestSmallKernels();
  const auto anchor_of = [this](int p) {
    const BlockPaths::Path& path = paths_.paths[p];
    return vectors_.data() + places_[p].vectors +
           std::ptrdiff_t{path.end - path.begin + 1} * Section(p);
  };
  // Sections of the nodes, padded, then two of zeros.
  ForPaths([&](int p) {
    const BlockPaths::Path& path = paths_.paths[p];
    double* y = vectors_.data() + places_[p].vectors;
    std::fill_n(y, std::ptrdiff_t{path.end - path.begin + 2} * Section(p), 0.0);
    for (int k = path.begin; k < path.end; ++k, y += Section(p)) {
      ForEachRow(paths_.nodes[k], [&](int row, int local) {
        std::copy_n(b + pattern_->offsets[row], pattern_->block_size(row), y + local);
      });
    }
    kernels.solve_path_forward(path.size, path.end - path.begin, tiles_.data() + places_[p].tiles,
                               vectors_.data() + places_[p].vectors, anchor_of(p));
  });
  for (std::size_t row = 0; row < rest_nodes_.size(); ++row) {
    ForEachRow(rest_nodes_[row], [&](int i, int local) {
      std::copy_n(b + pattern_->offsets[i], pattern_->block_size(i),
                  rest_b_.begin() + rest_pattern_.offsets[row] + local);
    });
  }
  const auto add = [&](int node, const double* section, int size) {
    double* const to = rest_b_.data() + rest_pattern_.offsets[index_[node]];
    std::transform(section, section + size, to, to, std::plus<>());
  };
  for (int p = 0; p < num_paths(); ++p) {
    const BlockPaths::Path& path = paths_.paths[p];
    if (path.next != BlockPaths::kNone) {
      add(path.next, anchor_of(p) - Section(p), path.size);
    }
    if (path.anchor != BlockPaths::kNone) {
      add(path.anchor, anchor_of(p), path.size);
    }
  }
  const Status solved = rest_.Solve(rest_b_.data(), {}, {}, rest_x_.data());
  if (!solved.ok()) {
    return solved;
  }
  ForPaths([&](int p) {
    const BlockPaths::Path& path = paths_.paths[p];
    const auto take = [&](int node, double* section) {
      if (node != BlockPaths::kNone) {
        std::copy_n(rest_x_.begin() + rest_pattern_.offsets[index_[node]], path.size, section);
      }
    };
    double* y = vectors_.data() + places_[p].vectors;
    take(path.next, anchor_of(p) - Section(p));
    take(path.anchor, anchor_of(p));
    kernels.solve_path_backward(path.size, path.end - path.begin, tiles_.data() + places_[p].tiles,
                                anchor_of(p), y);
    for (int k = path.begin; k < path.end; ++k, y += Section(p)) {
      ForEachRow(paths_.nodes[k], [&](int row, int local) {
        std::copy_n(y + local, pattern_->block_size(row), x + pattern_->offsets[row]);
      });
    }
  });
  for (std::size_t row = 0; row < rest_nodes_.size(); ++row) {
    ForEachRow(rest_nodes_[row], [&](int i, int local) {
      std::copy_n(rest_x_.begin() + rest_pattern_.offsets[row] + local, pattern_->block_size(i),
                  x + pattern_->offsets[i]);
    });
  }
  return solved;
}

std::vector<int> PathCholesky::order() const {
  std::vector<int> rows;
  const auto add = [&](int node) { ForEachRow(node, [&](int row, int) { rows.push_back(row); }); };
  std::for_each(paths_.nodes.begin(), paths_.nodes.end(), add);
  for (const int row : rest_.tree().order) {
    add(rest_nodes_[row]);
  }
  return rows;
}

std::size_t PathCholesky::Bytes() const {
  const std::size_t doubles = tiles_.capacity() + squares_.capacity() + vectors_.capacity() +
                              rest_values_.capacity() + 3 * rest_b_.capacity();
  return rest_.Bytes() + doubles * sizeof(double) +
         (pieces_.capacity() + rest_pieces_.capacity()) * sizeof(Piece);
}

}  // namespace inceres::internal
