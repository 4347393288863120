#pragma once

#include <cstdint>
#include <vector>

#include "base/aligned_vector.h"
#include "inceres/linear/reduced_solver.h"
#include "linear/aggregation.h"
#include "linearize/evaluator.h"
#include "linearize/incidences.h"
#include "simd/kernels.h"

namespace inceres::internal {

/// Which products make up each block of a symmetric block matrix, and each block of a vector that
/// goes with it. Terms of one block are sorted by source, in a fixed order: the sum has one order,
/// whoever computes it. Those of a block on the diagonal are symmetric, and have with each factor
/// the place of what it is multiplied by in the vector's sum.
struct ProductPlan {
  struct Segment {
    std::int64_t first_term;
    int count;
    int source;  // what the terms refer to: see FramePlans
  };
  UnwrittenVector<ProductTerm> terms;
  std::vector<Segment> segments;
  std::vector<int> segments_begin;  // per block of the pattern, one more
};

/// Which blocks of S are formed. The others of the pattern are those of C. kClustered: those that
/// some clusters of frames keep.
enum class SchurBlocks { kAll, kClustered, kDiagonal, kNone };

/// The pattern of the frame system and the products that fill it: C_ij = Σ_factors J_iᵀJ_j and S_ij
/// = C_ij − Σ_landmarks Y_li Y_ljᵀ; and with their diagonal blocks g_i = Σ_factors J_iᵀf and b_i =
/// −g_i − Σ_landmarks Y_li z_l, where f are residuals of a family, and z_l a quad.
struct FramePlans {
  FramePlans(const Evaluator& evaluator, const LandmarkIncidences& incidences,
             SchurBlocks blocks = SchurBlocks::kAll, const FrameClusters* clusters = nullptr);

  /// Products of Y that make up S.
  std::int64_t num_schur_products() const {
    return forms_schur ? static_cast<std::int64_t>(schur.terms.size()) : 0;
  }

  /// A source of the Hessian plan: a family seen through the slot of the row frame and the slot of
  /// the column frame.
  struct HessianSource {
    int family;
    int row_slot;
    int column_slot;
  };

  /// A source of the Schur plan: the landmarks of one size in one chunk. By ascending chunk.
  struct SchurSource {
    int chunk;
    int landmark_size;
  };

  BlockPattern pattern;
  ProductPlan hessian;  // sources: indices into hessian_sources
  ProductPlan schur;    // sources: indices into schur_sources
  bool forms_schur;     // else it is there for b alone, where Y has one chunk, or empty
  std::vector<HessianSource> hessian_sources;  // each has a segment, where there are many
  std::vector<SchurSource> schur_sources;
  std::vector<int> block_row;  // per block of the pattern
};

}  // namespace inceres::internal
