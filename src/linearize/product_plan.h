#pragma once

#include <cstdint>
#include <vector>

#include "inceres/linear/reduced_matrix.h"
#include "linear/frame_clusters.h"
#include "linearize/evaluator.h"
#include "linearize/incidences.h"
#include "simd/kernels.h"

namespace inceres::internal {

/// Which products make up each block of a symmetric block matrix. Terms of one block are sorted by
/// source, in a fixed order: the sum has one order, whoever computes it.
struct ProductPlan {
  struct Segment {
    int source;  // what the terms refer to: see FramePlans
    std::int64_t first_term;
    int count;
  };
  std::vector<ProductTerm> terms;
  std::vector<Segment> segments;
  std::vector<int> segments_begin;  // per block of the pattern, one more
};

/// Which blocks of S are formed. The others of the pattern are those of C. kClustered: those that
/// some clusters of frames keep.
enum class SchurBlocks { kAll, kClustered, kDiagonal, kNone };

/// The pattern of the frame system and the products that fill it: C_ij = Σ_factors J_iᵀJ_j and S_ij
/// = C_ij − Σ_landmarks Y_li Y_ljᵀ.
struct FramePlans {
  FramePlans(const Evaluator& evaluator, const LandmarkIncidences& incidences,
             SchurBlocks blocks = SchurBlocks::kAll, const FrameClusters* clusters = nullptr);

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
  std::vector<HessianSource> hessian_sources;
  std::vector<SchurSource> schur_sources;
  std::vector<int> block_row;  // per block of the pattern
};

}  // namespace inceres::internal
