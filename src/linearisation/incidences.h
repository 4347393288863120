#pragma once

#include <cstdint>
#include <vector>

#include "block/kernels.h"
#include "linearisation/evaluator.h"

namespace inceres::internal {

/// Which frames each landmark is seen from (its separator) and by which factors: the symbolic half of the elimination.
///
/// Every pair (landmark l, frame i) that shares a factor has one block Y_li = W_li U_invᵀ, stored as landmark-size rows of padded
/// frame-size entries. Blocks of one frame lie together, so that forming a block S_ij walks through two short, sorted
/// stretches of memory.
struct LandmarkIncidences {
  explicit LandmarkIncidences(const Evaluator& evaluator);

  int num_landmarks() const { return static_cast<int>(begin.size()) - 1; }

  // Per landmark: its incidences, in order of first appearance.
  std::vector<int> begin;  // num_landmarks + 1
  std::vector<Incidence> incidences;
  std::vector<std::int32_t> frames;  // frame index per incidence

  // Per frame: the same incidences, sorted by landmark size, then landmark.
  std::vector<int> frame_begin;         // num_frames + 1
  std::vector<int> frame_incidences;    // incidence index
  std::vector<std::int32_t> landmarks;  // landmark index per incidence

  // Per landmark: its factors, one entry a family (and slot).
  std::vector<int> factors_begin;  // num_landmarks + 1
  std::vector<LandmarkFactors> factors;

  std::vector<char> sizes;   // tangent size per landmark
  std::int64_t y_quads = 0;  // size of Y in quads

 private:
  void CollectFactors(const Evaluator& evaluator);
  void CollectIncidences(const Evaluator& evaluator);
  void PlaceBlocks(const Layout& layout);
  void SetTargets();

  std::vector<std::vector<std::int32_t>> factor_lists_;  // per (family, slot): factors by landmark
  std::vector<std::vector<std::int32_t>> y_targets_;     // per family
};

}  // namespace inceres::internal
