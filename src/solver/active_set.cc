#include "solver/active_set.h"

#include <algorithm>

namespace inceres::internal {
namespace {

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

void ActiveSet::RankFrames(const std::vector<double>& frame_step, const std::vector<double>& damping, int first_row,
                           const LiveSchur& schur) {
  const SymmetricBlockRows& S = schur.S();
  const int num_rows = S.num_rows();
  const int count = num_rows - first_row;
  gains_.assign(count, 0.0);
  order_.resize(count);
  for (int i = first_row; i < num_rows; ++i) {
    order_[i - first_row] = i - first_row;
    const int offset = schur.FrameOffset(i);
    const double* delta = frame_step.data() + offset;
    if (S.size_of(i) == 0) {
      continue;
    }
    double gain = Product(S.size_of(i), S.size_of(i), delta, S.values(S.row(i).back().offset), delta);
    for (int k = 0; k < S.size_of(i); ++k) {
      gain += damping[offset + k] * delta[k] * delta[k];
    }
    gains_[i - first_row] = gain;
  }
  std::sort(order_.begin(), order_.end(),
            [this](std::int32_t a, std::int32_t b) { return gains_[a] != gains_[b] ? gains_[a] < gains_[b] : a < b; });
  rank_.resize(count);
  costs_.assign(count, 0.0);
  for (int r = 0; r < count; ++r) {
    rank_[order_[r]] = r;
    costs_[r] = 0.5 * gains_[order_[r]];
  }
  for (int i = first_row; i < num_rows; ++i) {
    const double* delta = frame_step.data() + schur.FrameOffset(i);
    for (const SymmetricBlockRows::Entry& entry : S.row(i)) {
      if (entry.column < first_row || entry.column == i) {
        continue;
      }
      const double product = Product(S.size_of(i), S.size_of(entry.column), delta, S.values(entry.offset),
                                     frame_step.data() + schur.FrameOffset(entry.column));
      costs_[std::max(rank_[i - first_row], rank_[entry.column - first_row])] += product;
    }
  }
}

void ActiveSet::Select(const std::vector<double>& frame_step, const std::vector<double>& damping, int first_row, double budget,
                       LiveSystem* system) {
  LiveSchur& schur = system->schur();
  RankFrames(frame_step, damping, first_row, schur);
  double undone = 0.0;
  std::size_t left = 0;
  while (left < order_.size() && undone + costs_[left] <= budget) {
    undone += costs_[left++];
  }
  frames_.clear();
  landmarks_.clear();
  for (std::size_t r = left; r < order_.size(); ++r) {
    const std::int32_t frame = order_[r] + first_row;
    if (schur.frames()[frame].size > 0 && !schur.frames()[frame].held) {
      frames_.push_back(frame);
      system->SetFrameStep(frame, frame_step.data() + schur.FrameOffset(frame));
    }
  }
  const auto visit = [&](std::int32_t landmark) {
    if (schur.landmarks()[landmark].in_S && !system->Visited(landmark)) {
      system->Visit(landmark);
      landmarks_.push_back(landmark);
    }
  };
  for (const std::int32_t frame : frames_) {
    std::for_each(schur.frames()[frame].landmarks.begin(), schur.frames()[frame].landmarks.end(), visit);
  }
  const double share = budget / std::max(1, schur.num_landmarks());
  const std::vector<std::int32_t>& eager = schur.EagerLandmarks(share);
  std::for_each(eager.begin(), eager.end(), visit);
}

}  // namespace inceres::internal
