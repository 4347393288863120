#include "linear/sparse_cholesky.h"

#include <cholmod.h>

#include <algorithm>
#include <cstdint>
#include <limits>
#include <string>
#include <vector>

// Of the OpenMP runtime that CHOLMOD brings along, if it does.
extern "C" {
__attribute__((weak)) int omp_get_max_active_levels();
__attribute__((weak)) void omp_set_max_active_levels(int levels);
}

namespace inceres::internal {
namespace {

// While one lives, CHOLMOD stays on the calling thread. Its supernodal loops ask OpenMP for four threads whatever the machine and
// the caller have, and waking them costs more than the small supernodes of S win. The setting is the calling thread's own.
class OnOneThread {
 public:
  OnOneThread() : levels_(omp_get_max_active_levels != nullptr ? omp_get_max_active_levels() : 0) {
    if (omp_set_max_active_levels != nullptr) {
      omp_set_max_active_levels(0);
    }
  }
  ~OnOneThread() {
    if (omp_set_max_active_levels != nullptr) {
      omp_set_max_active_levels(levels_);
    }
  }
  OnOneThread(const OnOneThread&) = delete;
  OnOneThread& operator=(const OnOneThread&) = delete;

 private:
  int levels_;
};

// METIS takes tens of milliseconds where AMD takes one: only a factor this expensive may win that back within a solve.
constexpr double kMinFlopsForNestedDissection = 3e7;

// An owned CHOLMOD object, freed with the function of its type.
template <typename T, int (*Free)(T**, cholmod_common*)>
class Owned {
 public:
  explicit Owned(cholmod_common* common, T* object = nullptr) : common_(common), object_(object) {}
  ~Owned() { Free(&object_, common_); }
  Owned(const Owned&) = delete;
  Owned& operator=(const Owned&) = delete;
  void Reset(T* object) {
    Free(&object_, common_);
    object_ = object;
  }
  void Release() { object_ = nullptr; }
  T* get() const { return object_; }

 private:
  cholmod_common* common_;
  T* object_;
};
using OwnedSparse = Owned<cholmod_sparse, cholmod_free_sparse>;
using OwnedFactor = Owned<cholmod_factor, cholmod_free_factor>;
using OwnedDense = Owned<cholmod_dense, cholmod_free_dense>;

double MeanCubedBlockSize(const BlockPattern& pattern) {
  const double mean = static_cast<double>(pattern.size()) / std::max(1, pattern.num_blocks());
  return mean * mean * mean;
}

struct Ordering {
  std::vector<int> permutation;  // of blocks
  double flops = 0.0;            // on the block graph
};

}  // namespace

struct SparseCholesky::Cholmod {
  Cholmod() {
    cholmod_start(&common);
    common.print = 0;
    common.quick_return_if_not_posdef = 1;
  }
  ~Cholmod() {
    factor.Reset(nullptr);
    matrix.Reset(nullptr);
    solution.Reset(nullptr);
    cholmod_free_dense(&workspace_y, &common);
    cholmod_free_dense(&workspace_e, &common);
    cholmod_finish(&common);
  }
  Cholmod(const Cholmod&) = delete;
  Cholmod& operator=(const Cholmod&) = delete;

  OwnedSparse BlockGraph() {
    const int n = pattern->num_blocks();
    cholmod_sparse* graph = cholmod_allocate_sparse(static_cast<std::size_t>(n), static_cast<std::size_t>(n),
                                                    pattern->columns.size(), 1, 1, 1, CHOLMOD_PATTERN, &common);
    if (graph == nullptr) {
      return OwnedSparse(&common);
    }
    std::copy(pattern->row_begin.begin(), pattern->row_begin.end(), static_cast<int*>(graph->p));
    std::copy(pattern->columns.begin(), pattern->columns.end(), static_cast<int*>(graph->i));
    return OwnedSparse(&common, graph);
  }

  // Orders the block graph by one method and predicts the flops of the factor.
  Ordering Order(cholmod_sparse* graph, int method) {
    common.nmethods = 1;
    common.method[0].ordering = method;
    common.postorder = 1;
    Ordering ordering;
    OwnedFactor analysis(&common, graph == nullptr ? nullptr : cholmod_analyze(graph, &common));
    if (analysis.get() != nullptr) {
      const int* order = static_cast<const int*>(analysis.get()->Perm);
      ordering.permutation.assign(order, order + analysis.get()->n);
      ordering.flops = common.fl;
    }
    return ordering;
  }

  // The upper triangle of the permuted S by columns, and where each entry is found among the values of the pattern: CHOLMOD is
  // then told that the order is natural, and neither permutes nor transposes at every factorisation.
  bool BuildMatrix(const std::vector<int>& block_order) {
    const int num_blocks = pattern->num_blocks();
    std::vector<int> position(num_blocks);
    permutation.clear();
    for (int at = 0; at < num_blocks; ++at) {
      position[block_order[at]] = at;
      for (int k = 0; k < pattern->block_size(block_order[at]); ++k) {
        permutation.push_back(pattern->offsets[block_order[at]] + k);
      }
    }
    const std::vector<std::vector<Piece>> columns = PiecesByColumn(position);
    std::size_t num_entries = 0;
    for (int at = 0; at < num_blocks; ++at) {
      const auto size = static_cast<std::size_t>(pattern->block_size(block_order[at]));
      for (const Piece& piece : columns[at]) {
        num_entries += piece.position == at ? size * (size + 1) / 2 : size * pattern->block_size(block_order[piece.position]);
      }
    }
    const auto n = static_cast<std::size_t>(pattern->size());
    matrix.Reset(cholmod_allocate_sparse(n, n, num_entries, 1, 1, 1, CHOLMOD_REAL, &common));
    if (matrix.get() == nullptr) {
      return false;
    }
    FillMatrix(block_order, columns);
    return true;
  }

  // A block of the permuted upper triangle: entry (r, c) is values[first + r · row_step + c · column_step].
  struct Piece {
    int position;
    std::int64_t first;
    int row_step;
    int column_step;
  };

  std::vector<std::vector<Piece>> PiecesByColumn(const std::vector<int>& position) const {
    std::vector<std::vector<Piece>> columns(pattern->num_blocks());
    for (int i = 0; i < pattern->num_blocks(); ++i) {
      for (int k = pattern->row_begin[i]; k < pattern->row_begin[i + 1]; ++k) {
        const int j = pattern->columns[k];
        const int stride = pattern->block_size(j);
        if (position[j] <= position[i]) {
          columns[position[i]].push_back({position[j], pattern->value_begin[k], 1, stride});
        } else {
          columns[position[j]].push_back({position[i], pattern->value_begin[k], stride, 1});
        }
      }
    }
    for (std::vector<Piece>& pieces : columns) {
      std::sort(pieces.begin(), pieces.end(), [](const Piece& a, const Piece& b) { return a.position < b.position; });
    }
    return columns;
  }

  void FillMatrix(const std::vector<int>& block_order, const std::vector<std::vector<Piece>>& columns) {
    int* starts = static_cast<int*>(matrix.get()->p);
    int* indices = static_cast<int*>(matrix.get()->i);
    std::vector<int> offsets{0};  // of the blocks, in their new order
    for (const int block : block_order) {
      offsets.push_back(offsets.back() + pattern->block_size(block));
    }
    source.clear();
    source.reserve(matrix.get()->nzmax);
    int entry = 0;
    for (int at = 0; at < pattern->num_blocks(); ++at) {
      for (int c = 0; c < offsets[at + 1] - offsets[at]; ++c) {
        starts[offsets[at] + c] = entry;
        for (const Piece& piece : columns[at]) {
          const int rows = piece.position == at ? c + 1 : offsets[piece.position + 1] - offsets[piece.position];
          for (int r = 0; r < rows; ++r) {
            indices[entry++] = offsets[piece.position] + r;
            source.push_back(static_cast<std::uint32_t>(piece.first + r * piece.row_step + c * piece.column_step));
          }
        }
      }
    }
    starts[pattern->size()] = entry;
  }

  // The lower triangle in the place of the upper one: the supernodal factorisation would form it anew each time. False if out of
  // memory.
  bool TurnMatrix() {
    cholmod_sparse* lower = cholmod_transpose(matrix.get(), 0, &common);
    if (lower == nullptr) {
      return false;
    }
    const int* starts = static_cast<const int*>(matrix.get()->p);
    const int* rows = static_cast<const int*>(matrix.get()->i);
    const int* lower_starts = static_cast<const int*>(lower->p);
    std::vector<int> next(lower_starts, lower_starts + lower->ncol);
    std::vector<std::uint32_t> turned(source.size());
    for (int column = 0; column < pattern->size(); ++column) {
      for (int k = starts[column]; k < starts[column + 1]; ++k) {
        turned[static_cast<std::size_t>(next[rows[k]]++)] = source[static_cast<std::size_t>(k)];
      }
    }
    source = std::move(turned);
    matrix.Reset(lower);
    cholmod_sparse_xtype(CHOLMOD_REAL, lower, &common);
    return common.status == CHOLMOD_OK;
  }

  void CopyValues(const double* values, const double* diagonal) {
    double* out = static_cast<double*>(matrix.get()->x);
    const int* starts = static_cast<const int*>(matrix.get()->p);
    for (std::size_t k = 0; k < source.size(); ++k) {
      out[k] = values[source[k]];
    }
    const bool lower = matrix.get()->stype < 0;
    for (int column = 0; column < pattern->size(); ++column) {
      // The diagonal entry is the first of a column of the lower triangle, the last of the upper one.
      out[lower ? starts[column] : starts[column + 1] - 1] += diagonal[permutation[column]];
    }
  }

  cholmod_common common;
  const BlockPattern* pattern = nullptr;
  std::vector<int> permutation;       // scalar row of S per row of the matrix
  std::vector<std::uint32_t> source;  // per entry of the matrix: index into the pattern's values
  std::vector<double> permuted;
  OwnedSparse matrix{&common};
  OwnedFactor factor{&common};
  OwnedDense solution{&common};
  cholmod_dense* workspace_y = nullptr;
  cholmod_dense* workspace_e = nullptr;
  double predicted_flops = 0.0;
  double predicted_entries = 0.0;
  bool nested_dissection = false;
};

SparseCholesky::SparseCholesky() : cholmod_(std::make_unique<Cholmod>()) {
}
SparseCholesky::~SparseCholesky() = default;

const char* SparseCholesky::Name() const {
  return cholmod_->nested_dissection ? "CHOLMOD, nested dissection" : "CHOLMOD, AMD";
}

double SparseCholesky::PredictedFlops() const {
  return cholmod_->predicted_flops;
}

double SparseCholesky::PredictedEntries() const {
  return cholmod_->predicted_entries;
}

bool SparseCholesky::IsSupernodal() const {
  return cholmod_->factor.get() != nullptr && cholmod_->factor.get()->is_super != 0;
}

std::size_t SparseCholesky::Bytes() const {
  const Cholmod& c = *cholmod_;
  return c.common.memory_inuse + c.permutation.capacity() * sizeof(int) + c.source.capacity() * sizeof(std::uint32_t) +
         c.permuted.capacity() * sizeof(double);
}

Status SparseCholesky::Analyze(const BlockPattern& pattern) {
  Cholmod& c = *cholmod_;
  c.pattern = &pattern;
  OwnedSparse graph = c.BlockGraph();
  Ordering best = c.Order(graph.get(), CHOLMOD_AMD);
  c.nested_dissection = false;
  if (best.flops * MeanCubedBlockSize(pattern) >= kMinFlopsForNestedDissection) {
    Ordering dissection = c.Order(graph.get(), CHOLMOD_METIS);
    if (!dissection.permutation.empty() && dissection.flops < best.flops) {
      best = std::move(dissection);
      c.nested_dissection = true;
    }
  }
  if (best.permutation.empty()) {
    return Status::Error(StatusCode::kSingular, "CHOLMOD could not order the reduced system (out of memory?)");
  }
  if (pattern.value_begin.back() > std::numeric_limits<std::uint32_t>::max()) {
    return Status::Error(StatusCode::kInvalidArgument, "the reduced system is too large: its blocks exceed 32 GiB");
  }
  const bool built = c.BuildMatrix(best.permutation);
  c.common.nmethods = 1;
  c.common.method[0].ordering = CHOLMOD_NATURAL;
  c.common.postorder = 0;  // the block order is a postorder of the blocks already
  c.common.supernodal = CHOLMOD_AUTO;
  c.common.final_ll = 1;
  c.factor.Reset(built ? cholmod_analyze(c.matrix.get(), &c.common) : nullptr);
  if (c.factor.get() == nullptr) {
    return Status::Error(StatusCode::kSingular, "CHOLMOD could not analyse the reduced system (out of memory?)");
  }
  c.predicted_flops = c.common.fl;
  c.predicted_entries = c.common.lnz;
  if (c.factor.get()->is_super != 0 && !c.TurnMatrix()) {
    return Status::Error(StatusCode::kSingular, "CHOLMOD could not turn the reduced system (out of memory?)");
  }
  return Status::Ok();
}

Status SparseCholesky::Factorize(const double* values, const double* diagonal) {
  Cholmod& c = *cholmod_;
  const OnOneThread on_one_thread;
  c.CopyValues(values, diagonal);
  cholmod_factorize(c.matrix.get(), c.factor.get(), &c.common);
  if (c.common.status != CHOLMOD_OK || c.factor.get()->minor < c.factor.get()->n) {
    const bool numeric =
        c.common.status == CHOLMOD_OK || c.common.status == CHOLMOD_NOT_POSDEF || c.common.status == CHOLMOD_DSMALL;
    return Status::Error(StatusCode::kSingular, numeric ? "the reduced system is not positive definite (CHOLMOD, column " +
                                                              std::to_string(c.factor.get()->minor) + ")"
                                                        : "CHOLMOD failed with status " + std::to_string(c.common.status));
  }
  // CHOLMOD lets a NaN pass for a positive pivot; its condition estimate does not.
  if (cholmod_rcond(c.factor.get(), &c.common) == 0.0) {
    return Status::Error(StatusCode::kSingular, "the reduced system is not positive definite (an entry is not finite)");
  }
  return Status::Ok();
}

Status SparseCholesky::Solve(const double* b, double* x) {
  Cholmod& c = *cholmod_;
  cholmod_dense rhs = {};
  rhs.nrow = c.factor.get()->n;
  rhs.ncol = 1;
  rhs.nzmax = rhs.nrow;
  rhs.d = rhs.nrow;
  c.permuted.resize(rhs.nrow);
  std::transform(c.permutation.begin(), c.permutation.end(), c.permuted.begin(), [b](int row) { return b[row]; });
  rhs.x = c.permuted.data();
  rhs.xtype = CHOLMOD_REAL;
  rhs.dtype = CHOLMOD_DOUBLE;
  cholmod_dense* solution = c.solution.get();
  c.solution.Release();
  const int ok =
      cholmod_solve2(CHOLMOD_A, c.factor.get(), &rhs, nullptr, &solution, nullptr, &c.workspace_y, &c.workspace_e, &c.common);
  c.solution.Reset(solution);
  if (c.workspace_y != nullptr && c.workspace_y->ncol > 0) {
    // A simplicial solve allocates 4 x n, leaves it as 1 x n, and would not know it again next time.
    c.workspace_y->nrow = c.workspace_y->d = c.workspace_y->nzmax / c.workspace_y->ncol;
  }
  if (ok == 0) {
    return Status::Error(StatusCode::kSingular, "CHOLMOD's solve failed with status " + std::to_string(c.common.status));
  }
  const double* result = static_cast<const double*>(solution->x);
  for (std::size_t k = 0; k < rhs.nrow; ++k) {
    x[c.permutation[k]] = result[k];
  }
  return Status::Ok();
}

}  // namespace inceres::internal
