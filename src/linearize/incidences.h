#pragma once

#include <cstdint>
#include <vector>

#include "base/aligned_vector.h"
#include "linearize/evaluator.h"
#include "simd/kernels.h"

namespace inceres::internal {

/// Which frames each landmark is seen from (its separator) and by which factors: the symbolic half
/// of the elimination.
///
/// Every pair (landmark l, frame i) that shares a factor has one block Y_li = W_li U_invᵀ, stored
/// as landmark-size rows of padded frame-size entries, or, where that saves memory and all frames
/// are alike, with their last column apart (`tail`; see MayHaveTail). Blocks of one frame lie
/// together, so that forming a block S_ij walks through two short, sorted stretches of memory.
///
/// Landmarks are eliminated in chunks, one after the other, that all use the same memory for their
/// Y: large problems would otherwise spend a quarter of theirs on it. A chunk is as long as its Y
/// takes no more than quads_per_chunk, but at least one landmark; nor its Jacobians, where they are
/// not kept either (JacobianStorage::kInChunks).
struct LandmarkIncidences {
  static constexpr int kMaxLandmarkSize = 4;
  static constexpr std::int64_t kQuadsPerChunk = std::int64_t{1} << 16;  // 2 MiB

  explicit LandmarkIncidences(const Evaluator& evaluator,
                              std::int64_t quads_per_chunk = kQuadsPerChunk,
                              bool may_have_tail = true);

  int num_landmarks() const { return static_cast<int>(begin.size()) - 1; }
  int num_chunks() const { return static_cast<int>(chunk_begin.size()) - 1; }
  int ChunkOf(int landmark) const;

  /// Gives back the columns by incidence that only planning reads, but for those of `incidences`
  /// where substitution needs them, and `factors`: for who has all plans, and asks for FactorsAt.
  void ForgetPlaces();
  std::int64_t Bytes() const;
  /// Entry k of `factors`, wherever it is.
  LandmarkFactors FactorsAt(int k) const {
    if (few_numbers_.empty()) {
      return factors[k];
    }
    const FewNumbers& entry = few_numbers_[k];
    LandmarkFactors result = of_lists_[entry.list];
    result.factors += entry.first;
    result.count = entry.count;
    return result;
  }

  FamilyId FamilyOf(const LandmarkFactors& entry) const { return factor_lists_[entry.list].family; }

  // Per landmark: its incidences, in order of first appearance.
  std::vector<int> begin;  // num_landmarks + 1
  UnwrittenVector<Incidence> incidences;
  UnwrittenVector<std::int32_t> frames;  // frame index per incidence

  // First landmark of each chunk, of which there is at least one, and the number of landmarks.
  std::vector<int> chunk_begin;

  // Per frame: the same incidences, sorted by chunk, then landmark size, then landmark.
  std::vector<int> frame_begin;             // num_frames + 1
  UnwrittenVector<int> frame_incidences;    // incidence index
  UnwrittenVector<std::int32_t> landmarks;  // landmark index per incidence

  // Per landmark: its factors, one entry a family (and slot), by their records.
  std::vector<int> factors_begin;  // num_landmarks + 1
  std::vector<LandmarkFactors> factors;

  std::vector<char> sizes;   // tangent size per landmark
  int largest_size = 0;      // of them
  std::int64_t y_quads = 0;  // size of the largest chunk's Y in quads
  bool tail = false;         // blocks of Y have their last column apart

 private:
  // Of a family and slot all factors with a landmark there, by landmark, and where those of each
  // begin; one more.
  struct FactorsThroughSlot {
    LandmarkFactors all;
    std::vector<int> begin;
  };
  void CollectFactors(const Evaluator& evaluator);
  void ShortenFactors();
  void ListFactors(const std::vector<FactorsThroughSlot>& slots);
  void CollectIncidences(const Evaluator& evaluator);
  void ChooseStorage(const Layout& layout, bool may_have_tail);
  int QuadsOfBlock(int incidence) const;
  std::int64_t QuadsOfJacobians(int landmark) const;
  void CutIntoChunks(const Evaluator& evaluator, std::int64_t quads_per_chunk);
  void PlaceBlocks(const Evaluator& evaluator);
  void PlaceBlocksOf(int chunk, int num_frames, int* order, std::vector<std::int64_t>* next);
  void SetTargets(const Evaluator& evaluator);
  void NameRecords(const Evaluator& evaluator);

  struct FactorList {  // of a family and slot
    FamilyId family;
    UnwrittenVector<std::int32_t> factors;  // by landmark
  };
  // All that entries of `factors` with the same family and slot do not share.
  struct FewNumbers {
    int list;
    int first;
    int count;
  };
  std::vector<FewNumbers> few_numbers_;    // per entry of `factors`; or empty
  std::vector<LandmarkFactors> of_lists_;  // per list, without their count; or empty
  std::vector<FactorList> factor_lists_;
  std::vector<std::vector<std::int32_t>> y_targets_;  // per family
};

}  // namespace inceres::internal
