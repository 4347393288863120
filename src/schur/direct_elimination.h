#pragma once

#include <cstdint>
#include <vector>

#include "base/zeroed_array.h"
#include "inceres/linear/reduced_solver.h"
#include "linear/pattern_rows.h"
#include "linearize/evaluator.h"
#include "linearize/incidences.h"
#include "schur/product_lists.h"
#include "simd/kernels.h"

namespace inceres::internal {

/// S = C − W P⁻¹ Wᵀ of Jacobians that are looked at once, undamped and without a right-hand side:
/// what Elimination forms for every step of a solve, without a plan of all products, which takes as
/// long to make as to carry out. A chunk of landmarks after the other is evaluated and adds to S:
/// where Jacobians come in chunks none of them leaves the processor's cache.
///
/// Threads: those of the evaluator; the same bits for any number of them. Source: Triggs et al.
/// 1999, section 6.1.
class DirectElimination {
 public:
  /// Of Y in a chunk: what stays in the second-level cache.
  static constexpr std::int64_t kQuadsPerChunk = std::int64_t{1} << 13;

  /// Finds the pattern of S. The evaluator keeps Jacobians by slot or in chunks.
  DirectElimination(Evaluator* evaluator, const LandmarkIncidences& incidences);

  /// Evaluates at the current point and forms S. *open: the landmarks, ascending, that have a
  /// coordinate whose variance for known frames exceeds that with all else known by more than
  /// max_inflation: if there are any, S is not formed to its end.
  Status Eliminate(double max_inflation, std::vector<int>* open);

  const BlockPattern& pattern() const { return pattern_; }
  const double* S() const { return S_.data(); }
  /// diag(C), packed: what S has before landmarks are eliminated.
  const std::vector<double>& diagonal() const { return diagonal_; }
  /// The same with the squares of each landmark's rows times its inflation, the largest variance
  /// for known frames in units of that with all else known: S_kk is exact to ε times this.
  const std::vector<double>& rounding() const { return rounding_; }
  /// U_inv of landmark l, with U_invᵀ U_inv = P⁻¹: rows four apart, up to the diagonal.
  const double* UInv(int l) const { return U_inv_.data() + std::ptrdiff_t{l} * kQuad * kQuad; }

 private:
  // All products of Jacobians of two slots, in a chunk.
  struct Source {
    const Linearization* cache;
    int row_slot;
    int column_slot;
    std::int32_t row_quads;  // from factor to factor
    std::int32_t column_quads;
    ProductLists lists;
  };

  void FindOthers();
  void FindOthersOf(const Linearization& cache);
  void FindPattern();
  void MakeSources();
  void AddChunk(int chunk);
  void EliminateLandmarks(int first, int last);
  double FactorizeLandmark(int landmark);
  void EliminateLandmark(int landmark);
  void ListLandmark(int landmark);
  void ListRecords(const Linearization& cache, const std::int32_t* records, int count,
                   double inflation);
  void AddSquares(const Linearization& cache, std::int32_t record, int slot, int frame,
                  double inflation);
  void ListOthers(int chunk);
  void IndexBlocks();
  void AddLists();
  void AddProducts(const BlockProducts& kind, double sign, ProductLists* lists);
  int FactorAt(FamilyId family, int record) const {
    return chunks_ == nullptr ? record : chunks_->FactorAt(family, record);
  }
  int BlockAt(int row, int column) const {
    return block_of_.empty() ? FindBlock(pattern_, row, column)
                             : block_of_[static_cast<std::size_t>(row_place_[row] + column)];
  }

  Evaluator& evaluator_;
  const LandmarkIncidences& incidences_;
  const Kernels& kernels_;
  JacobianChunks* chunks_;  // null: Jacobians are kept
  BlockPattern pattern_;
  std::vector<int> block_row_;  // per block
  std::vector<int> block_of_;   // by row_place_ and column; empty if few places have a block
  std::vector<std::int64_t> row_place_;  // where column 0 of a row would be: rows begin with their
                                         // first block
  std::vector<std::vector<std::int32_t>> others_;  // per family: records without a landmark
  std::vector<Source> sources_;
  std::vector<std::size_t> first_source_;  // per family
  std::vector<ProductLists> of_sizes_;     // products of Y, by the size of their landmarks less one
  double max_inflation_ = 0.0;
  std::vector<double> inflation_;  // per landmark; infinite: it is open
  std::vector<double> diagonal_;
  std::vector<double> rounding_;
  ZeroedArray U_inv_;
  ZeroedArray Y_;  // of a chunk
  ZeroedArray S_;
};

}  // namespace inceres::internal
