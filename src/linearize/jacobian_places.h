#pragma once

#include <cstddef>
#include <cstdint>
#include <vector>

#include "linearize/layout.h"
#include "linearize/linearization.h"

namespace inceres::internal {

// Where the Jacobians of a family's factors lie, and which columns of J they are.

/// Whole rows where there are no landmarks, at most 16 unknowns and 1,024 residuals, and within
/// each family all factors touch the same variables, as in curve fitting and calibration: then J is
/// one small dense matrix.
JacobianStorage StorageFor(const FactorGraph& graph, const Layout& layout);

/// Whether rows padded to quads would spend so much memory that it is worth more than the few
/// instructions that products of padded rows take less: of Jacobians that no cache holds anyway.
bool IsPaddingDear(const FactorGraph& graph);

/// Memory for the Jacobians of a family as they are stored, once, instead of Linearization::Grow;
/// none for those in chunks. By slot anything may be in them until ClearUnwritten.
void PlaceJacobians(const Layout& layout, JacobianStorage storage, Linearization* cache);

/// Makes zeros of what no evaluation writes: blocks without a place in the tangent vector, as
/// tangent_offsets now says, and the padding of the others.
void ClearUnwritten(Linearization* cache);

/// Whether a family that is stored by factor has its records in an order of their own, where
/// landmarks are eliminated: where factors of a landmark that moves are not neighbors, but for
/// those without one between them, and not of small families, which stay in the cache.
bool HasRecordsByLandmark(const FactorGraph& graph, FamilyId id);

/// Tangent offsets of the entries (factor and slot) from begin to end, stored by slot.
void PlaceInTangent(const Layout& layout, std::ptrdiff_t begin, std::ptrdiff_t end,
                    Linearization* cache);

/// Before zero blocks are left out, once tangent offsets are known.
void KeepAllOffsets(bool keep, std::vector<Linearization>* families);

/// Where zero blocks are left out, gives these factors, just evaluated, the tangent offsets of all
/// blocks but those of which their family says that they are zero (FactorBatch::zero_blocks).
void PlaceNonzeroBlocks(int begin, int end, Linearization* cache);

/// Takes the tangent offsets of other blocks that are all zeros away, of these factors.
void LeaveOutZeroBlocks(int begin, int end, Linearization* cache);

}  // namespace inceres::internal
