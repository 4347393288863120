#pragma once

#include <cstddef>
#include <vector>

#include "base/aligned_vector.h"
#include "base/executor.h"
#include "linear/front_rows.h"
#include "linear/sparse_cholesky.h"

namespace inceres::internal {

/// The entries of A⁻¹ where the sparse factor L of A has any, from L alone and without another
/// solve. Front by front, parents first: with L₁ the triangle of a front's pivots and L₂ its other
/// rows,
///
///     M = L₂ L₁⁻¹,   Σ₂₁ = −Σ₂₂ M,   Σ₁₁ = (L₁ L₁ᵀ)⁻¹ − Mᵀ Σ₂₁,
///
/// where Σ₂₂ is a part of what the front's parent knows. All blocks of A are among these entries,
/// and all pairs of the frames that a landmark connects. Cost: about three factorizations; memory:
/// once more the factor, and for a time the Σ₂₂ of the fronts that children wait for. The same bits
/// for any number of threads. Sources: Takahashi, Fagan & Chen, "Formation of a sparse bus
/// impedance matrix", 1973; Erisman & Tinney, "On computing certain elements of the inverse of a
/// sparse matrix", CACM 18(3), 1975; Campbell & Davis, "Computing the sparse inverse subset", 1995.
class SelectedInverse {
 public:
  /// Of a matrix that `factor` has factored; `factor` stays as it is as long as this is used.
  SelectedInverse(const SparseCholesky& factor, const BlockPattern& pattern,
                  const Executor& executor);

  /// What the constructor takes, predicted.
  static double PredictedFlops(const FrontTree& tree);

  /// Whether Block(i, j) is there.
  bool Has(int i, int j) const;
  /// Writes the block of A⁻¹ at block row i and block column j of A, row-major. It must be there.
  void Block(int i, int j, double* block) const;
  /// Entry (k, k) of A⁻¹.
  double Diagonal(int block, int k) const;

 private:
  // Of one front, column-major, both padded to quads.
  struct Waiting {
    AlignedVector<double> values;  // Σ₂₂
    int stride = 0;
  };

  void Invert(const SparseCholesky& factor, int f, const Executor& executor);
  void GatherRest(int f);
  void InvertPivots(const SparseCholesky& factor, int f);
  void InvertTriangle(const Front& front, const double* L);
  void SquareInverse(const Front& front, double* square) const;
  void Eliminate(int f, const Executor& executor);
  double* Transposed(int f) { return values_.data() + begin_[f]; }
  const double* Transposed(int f) const { return values_.data() + begin_[f]; }
  double Entry(int front, int pivot, int position) const;
  double FromParent(int parent, int row, int column) const;

  const FrontTree& tree_;
  FrontRows rows_;
  // Per front [Σ₁₁ Σ₂₁ᵀ], width × (width + height), column-major, columns padded to quads.
  ZeroedArray values_;
  std::vector<std::size_t> begin_;
  std::vector<Waiting> waiting_;  // per front, while a child may ask
  AlignedVector<double> X_;       // L₁⁻ᵀ of the front at hand, with the strides of Σ₁₁
  AlignedVector<double> T_;       // its Mᵀ
};

}  // namespace inceres::internal
