#include "incremental/active_set.h"

#include <algorithm>
#include <cmath>
#include <numeric>

namespace inceres::internal {
namespace {

// Which frames and landmarks a step moves (docs/algorithms.md, "Lazy steps").
//
// The cut-off: with the set D left where it is, and every landmark that sees a moved frame
// substituted back, the reduced quadratic loses exactly
//     ½ δ_Dᵀ S' δ_D = ½ Σ_{i∈D} δ_iᵀ S'_ii δ_i + Σ_{i<j∈D} δ_iᵀ S_ij δ_j.
// The first sum ranks the frames; the second one is why a set of cheap frames can be dear, or the
// other way round: neighbors that move as one cancel most of each other's diagonal terms. What is
// left out is postponed only: its gradient stays in b, so that the next step sees it again.

// uᵀ B v for a block with padded rows.
double Product(int rows, int columns, const double* u, const double* B, const double* v) {
  double sum = 0.0;
  for (int r = 0; r < rows; ++r, B += PadToQuad(columns)) {
    double row = 0.0;
    for (int c = 0; c < columns; ++c) {
      row += B[c] * v[c];
    }
    sum += u[r] * row;
  }
  return sum;
}

}  // namespace

// Ranks the candidates by their own gain δ_iᵀ S'_ii δ_i.
void ActiveSet::RankFrames(const std::vector<double>& frame_step,
                           const std::vector<double>& damping, const IncrementalSchur& schur) {
  const SymmetricBlockRows& S = schur.S();
  const std::size_t count = candidates_.size();
  // How many are ranked is not the same from step to step.
  gains_.reserve(S.num_rows());
  order_.reserve(S.num_rows());
  gains_.assign(count, 0.0);
  order_.resize(count);
  std::iota(order_.begin(), order_.end(), 0);
  for (std::size_t at = 0; at < count; ++at) {
    const int i = candidates_[at];
    const int offset = schur.FrameOffset(i);
    const double* delta = frame_step.data() + offset;
    // A free row gains nothing.
    if (S.size_of(i) == 0) {
      continue;
    }
    // The diagonal block is the last one of its row.
    double gain =
        Product(S.size_of(i), S.size_of(i), delta, S.values(S.row(i).back().offset), delta);
    for (int k = 0; k < S.size_of(i); ++k) {
      gain += damping[offset + k] * delta[k] * delta[k];
    }
    // Whatever is no number comes last, and stays in the step: comparisons with it are no order.
    gains_[at] = std::isnan(gain) ? HUGE_VAL : gain;
  }
  // Equal gains go by row: the set must not depend on how the sort breaks ties.
  std::sort(order_.begin(), order_.end(), [this](std::int32_t a, std::int32_t b) {
    return gains_[a] != gains_[b] ? gains_[a] < gains_[b] : a < b;
  });
}

// What leaving candidate `at` behind adds to the cost: ½ δ_iᵀ S'_ii δ_i, and δ_iᵀ S_ij δ_j for each
// frame j left before it. A block stands in the row of the later frame only; so each row is read
// once, when its frame is asked for, and what it says of frames that are still to come waits in
// cross_. Most candidates are never asked for, and S is long.
double ActiveSet::CostOfLeaving(std::int32_t at, const std::vector<double>& frame_step,
                                const IncrementalSchur& schur) {
  const SymmetricBlockRows& S = schur.S();
  const std::int32_t i = candidates_[at];
  const double* delta = frame_step.data() + schur.FrameOffset(i);
  double cost = 0.5 * gains_[at] + cross_[i];
  for (const SymmetricBlockRows::Entry& entry : S.row(i)) {
    if (fates_[entry.column] == Fate::kMoves || entry.column == i) {
      continue;
    }
    const double product =
        Product(S.size_of(i), S.size_of(entry.column), delta, S.values(entry.offset),
                frame_step.data() + schur.FrameOffset(entry.column));
    (fates_[entry.column] == Fate::kIsLeft ? cost : cross_[entry.column]) += product;
  }
  return cost;
}

// All of the step but for the longest leading part of the ranks that costs no more than the budget;
// a negative one leaves nothing.
void ActiveSet::CutOff(const std::vector<double>& frame_step, const std::vector<double>& damping,
                       double budget, IncrementalSystem* system) {
  const IncrementalSchur& schur = system->schur();
  // Rows that are free or held have no step.
  const auto move = [&](std::int32_t frame) {
    if (schur.frames()[frame].size > 0 && !schur.frames()[frame].held) {
      frames_.push_back(frame);
      system->step().SetFrame(frame, frame_step.data() + schur.FrameOffset(frame));
    }
  };
  if (budget < 0.0) {
    std::for_each(candidates_.begin(), candidates_.end(), move);
    return;
  }
  RankFrames(frame_step, damping, schur);
  fates_.resize(schur.frames().size(), Fate::kMoves);
  cross_.resize(schur.frames().size(), 0.0);
  for (const std::int32_t i : candidates_) {
    fates_[i] = Fate::kIsAsked;
  }
  double undone = 0.0;
  std::size_t left = 0;
  // The first rank that does not fit ends it, even where one after it would make the sum fall
  // again.
  for (; left < order_.size(); ++left) {
    undone += CostOfLeaving(order_[left], frame_step, schur);
    if (!(undone <= budget)) {
      break;
    }
    fates_[candidates_[order_[left]]] = Fate::kIsLeft;
  }
  for (std::size_t r = left; r < order_.size(); ++r) {
    move(candidates_[order_[r]]);
  }
  // Back to nothing, which costs the candidates only, not all rows.
  for (const std::int32_t i : candidates_) {
    fates_[i] = Fate::kMoves;
    cross_[i] = 0.0;
  }
}

// Rows that were not solved anew may still have much of their step to take.
void ActiveSet::NameCandidates(const std::vector<double>& frame_step, const ReducedVectors& reduced,
                               const ReducedSolver::Rows& solved, double negligible,
                               const IncrementalSchur& schur) {
  const auto num_rows = static_cast<std::int32_t>(schur.frames().size());
  candidates_.clear();
  // Without a list everything from first_row on counts as solved anew; with one, both the list and
  // the loop ascend, so that one pointer follows.
  std::size_t next = 0;
  for (std::int32_t i = 0; i < num_rows; ++i) {
    bool listed = solved.rows == nullptr && i >= solved.first_row;
    if (solved.rows != nullptr && next < solved.rows->size() && (*solved.rows)[next] == i) {
      listed = true;
      ++next;
    }
    // Σ_k C_kk δ_k²: the same measure by which the wildfire calls a row unchanged.
    double square = 0.0;
    for (int k = schur.FrameOffset(i); k < schur.FrameOffset(i + 1) && !listed; ++k) {
      square += reduced.weights()[k] * frame_step[k] * frame_step[k];
    }
    if (listed || square > negligible) {
      candidates_.push_back(i);
    }
  }
}

// In the partial Bayes tree that the elimination of the landmarks leaves, the frames are the root
// and each landmark is a leaf, conditioned on the frames it is seen from: which frames move, then
// which leaves are visited.
void ActiveSet::Select(const std::vector<double>& frame_step, const ReducedVectors& reduced,
                       const ReducedSolver::Rows& solved, const Limits& limits,
                       IncrementalSystem* system) {
  IncrementalSchur& schur = system->schur();
  is_whole_ = limits.remaining_decrease < 0.0;
  // All lists have room for everything from the start: a steady window must not allocate.
  frames_.clear();
  frames_.reserve(schur.frames().size());
  candidates_.reserve(schur.frames().size());
  landmarks_.clear();
  landmarks_.reserve(schur.landmarks().size());
  listed_.Grow(schur.landmarks().size());
  // The partial step has to gain the whole gain but for the budget; frames that it makes move
  // carry their neighbors' share, so it is asked first.
  if (limits.remaining_decrease >= 0.0 && partial_step_.IsWorthwhile(schur) &&
      partial_step_.Find(schur, reduced, limits.frame_gain - limits.remaining_decrease)) {
    for (int k = 0; k < partial_step_.num_frames(); ++k) {
      frames_.push_back(partial_step_.frame(k));
      system->step().SetFrame(frames_.back(), partial_step_.step(k));
    }
  } else {
    NameCandidates(frame_step, reduced, solved, limits.negligible, schur);
    CutOff(frame_step, reduced.damping(), limits.remaining_decrease, system);
  }
  const auto list = [&](std::int32_t landmark) {
    if (schur.IsInS(landmark) && listed_.Add(landmark)) {
      landmarks_.push_back(landmark);
    }
  };
  // Leaves below a frame that moves must follow, or their residuals would tear off.
  for (const std::int32_t frame : frames_) {
    std::for_each(schur.frames()[frame].landmarks.begin(), schur.frames()[frame].landmarks.end(),
                  list);
  }
  // A landmark without a moved frame may still have a gradient of its own, as a new one has. Its
  // share of the budget keeps the sum of what is left out below the budget.
  const double share = limits.remaining_decrease / std::max(1, schur.structure().num_landmarks());
  const std::vector<std::int32_t>& eager = schur.gains().Above(share);
  std::for_each(eager.begin(), eager.end(), list);
  listed_.Clear();
  system->step().Visit(landmarks_);
}

}  // namespace inceres::internal
