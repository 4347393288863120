#include "linear/sparse_cholesky.h"

#include <cholmod.h>

#include <algorithm>
#include <string>
#include <vector>

namespace inceres::internal {
namespace {

constexpr int kMinBlocksForNestedDissection = 128;  // below, AMD is as good and much quicker

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
      const int* permutation = static_cast<const int*>(analysis.get()->Perm);
      ordering.permutation.assign(permutation, permutation + analysis.get()->n);
      ordering.flops = common.fl;
    }
    return ordering;
  }

  // The upper triangle of S by columns: column r holds row r of the lower triangle, which our blocks store contiguously.
  void BuildMatrix() {
    std::size_t num_entries = 0;
    for (int i = 0; i < pattern->num_blocks(); ++i) {
      ForEachRow(i, [&](int, int, int count) { num_entries += static_cast<std::size_t>(count); });
    }
    const auto n = static_cast<std::size_t>(pattern->size());
    matrix.Reset(cholmod_allocate_sparse(n, n, num_entries, 1, 1, 1, CHOLMOD_REAL, &common));
    if (matrix.get() == nullptr) {
      return;
    }
    int* starts = static_cast<int*>(matrix.get()->p);
    int* indices = static_cast<int*>(matrix.get()->i);
    int entry = 0;
    int last_row = -1;
    for (int i = 0; i < pattern->num_blocks(); ++i) {
      ForEachRow(i, [&](int row, int first_column, int count) {
        if (row != last_row) {
          starts[row] = entry;
          last_row = row;
        }
        for (int c = 0; c < count; ++c) {
          indices[entry++] = first_column + c;
        }
      });
    }
    starts[n] = entry;
  }

  // Calls visit(row, first column, count) for each stretch of the lower triangle of block row i, row by row.
  template <typename Visit>
  void ForEachRow(int i, Visit&& visit) const {
    const int first_row = pattern->offsets[i];
    for (int r = 0; r < pattern->block_size(i); ++r) {
      for (int k = pattern->row_begin[i]; k < pattern->row_begin[i + 1]; ++k) {
        const int column = pattern->columns[k];
        visit(first_row + r, pattern->offsets[column], column == i ? r + 1 : pattern->block_size(column));
      }
    }
  }

  void CopyValues(const double* values, const double* diagonal) {
    double* out = static_cast<double*>(matrix.get()->x);
    for (int i = 0; i < pattern->num_blocks(); ++i) {
      for (int r = 0; r < pattern->block_size(i); ++r) {
        for (int k = pattern->row_begin[i]; k < pattern->row_begin[i + 1]; ++k) {
          const int column = pattern->columns[k];
          const int columns = pattern->block_size(column);
          const double* row = values + pattern->value_begin[k] + r * columns;
          out = std::copy(row, row + (column == i ? r + 1 : columns), out);
        }
        out[-1] += diagonal[pattern->offsets[i] + r];
      }
    }
  }

  cholmod_common common;
  const BlockPattern* pattern = nullptr;
  OwnedSparse matrix{&common};
  OwnedFactor factor{&common};
  OwnedDense solution{&common};
  cholmod_dense* workspace_y = nullptr;
  cholmod_dense* workspace_e = nullptr;
  double predicted_flops = 0.0;
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

Status SparseCholesky::Analyze(const BlockPattern& pattern) {
  Cholmod& c = *cholmod_;
  c.pattern = &pattern;
  OwnedSparse graph = c.BlockGraph();
  Ordering best = c.Order(graph.get(), CHOLMOD_AMD);
  c.nested_dissection = false;
  if (pattern.num_blocks() >= kMinBlocksForNestedDissection) {
    Ordering dissection = c.Order(graph.get(), CHOLMOD_METIS);
    if (!dissection.permutation.empty() && dissection.flops < best.flops) {
      best = std::move(dissection);
      c.nested_dissection = true;
    }
  }
  if (best.permutation.empty()) {
    return Status::Error(StatusCode::kSingular, "CHOLMOD could not order the reduced system (out of memory?)");
  }
  std::vector<int> permutation;
  permutation.reserve(pattern.size());
  for (const int block : best.permutation) {
    for (int k = 0; k < pattern.block_size(block); ++k) {
      permutation.push_back(pattern.offsets[block] + k);
    }
  }
  c.BuildMatrix();
  c.common.nmethods = 1;
  c.common.method[0].ordering = CHOLMOD_GIVEN;
  c.common.postorder = 1;
  c.common.supernodal = CHOLMOD_AUTO;
  c.common.final_ll = 1;
  c.factor.Reset(c.matrix.get() == nullptr ? nullptr
                                           : cholmod_analyze_p(c.matrix.get(), permutation.data(), nullptr, 0, &c.common));
  if (c.factor.get() == nullptr) {
    return Status::Error(StatusCode::kSingular, "CHOLMOD could not analyse the reduced system (out of memory?)");
  }
  c.predicted_flops = c.common.fl;
  return Status::Ok();
}

Status SparseCholesky::Factorize(const double* values, const double* diagonal) {
  Cholmod& c = *cholmod_;
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
  rhs.x = const_cast<double*>(b);  // CHOLMOD's structure is not const-correct; it only reads
  rhs.xtype = CHOLMOD_REAL;
  rhs.dtype = CHOLMOD_DOUBLE;
  cholmod_dense* solution = c.solution.get();
  c.solution.Release();
  const int ok =
      cholmod_solve2(CHOLMOD_A, c.factor.get(), &rhs, nullptr, &solution, nullptr, &c.workspace_y, &c.workspace_e, &c.common);
  c.solution.Reset(solution);
  if (ok == 0) {
    return Status::Error(StatusCode::kSingular, "CHOLMOD's solve failed with status " + std::to_string(c.common.status));
  }
  const double* result = static_cast<const double*>(solution->x);
  std::copy(result, result + rhs.nrow, x);
  return Status::Ok();
}

}  // namespace inceres::internal
