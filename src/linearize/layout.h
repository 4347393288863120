#pragma once

#include <cstdint>
#include <vector>

#include "inceres/problem/factor_graph.h"

namespace inceres::internal {

/// Where every variable that moves stands in the linear system. Two tangent vectors exist: the
/// *packed* one the strategies and the reduced solver see (frames in order, then landmarks), and
/// the *padded* one the kernels read (the same order, each variable padded to quads). Variables
/// that are constant or that no factor touches have no place in either.
struct Layout {
  /// With eliminate_landmarks false every moving variable is a frame.
  Layout(const FactorGraph& graph, bool eliminate_landmarks);

  std::vector<VariableId>
      variables;                   // moving ones, frames first: the order of both tangent vectors
  std::vector<int> packed_offset;  // per entry of `variables`, one more: the total
  std::vector<std::int32_t> quad_offset;  // per entry of `variables`, one more: the total
  std::vector<int> position;              // per VariableId: index into `variables`, or -1
  int num_frames = 0;

  int NumVariables() const { return static_cast<int>(variables.size()); }
  int num_landmarks() const { return NumVariables() - num_frames; }
  int size() const { return packed_offset.back(); }
  int frame_size() const { return packed_offset[num_frames]; }
  /// First scalar of each frame, and their total.
  std::vector<int> FrameOffsets() const {
    return {packed_offset.begin(), packed_offset.begin() + num_frames + 1};
  }
  int TangentSize(int index) const { return packed_offset[index + 1] - packed_offset[index]; }
  /// Index of the variable among frames / landmarks, or -1; -1 too for the id -1, which stands at
  /// the free places of an edited graph.
  int Position(VariableId id) const { return id < 0 ? -1 : position[id]; }
  int FrameOf(VariableId id) const {
    // Frames come first; no position is −1, below num_frames, and stays −1.
    const int index = Position(id);
    return index < num_frames ? index : -1;
  }
  int LandmarkOf(VariableId id) const {
    const int index = Position(id);
    return index >= num_frames ? index - num_frames : -1;
  }
  /// LandmarkOf the first of a factor's variables that is one, or -1: of those that move there is
  /// at most one where landmarks are eliminated.
  int LandmarkAmong(const VariableId* ids, int count) const {
    int landmark = -1;
    for (int k = 0; k < count && landmark < 0; ++k) {
      landmark = LandmarkOf(ids[k]);
    }
    return landmark;
  }

  /// padded := packed, padding left zero. `padded` has 4 · quad_offset.back() entries.
  void Pad(const double* packed, double* padded) const { Pad(packed, 0, NumVariables(), padded); }
  /// The same of the variables from begin to end.
  void Pad(const double* packed, int begin, int end, double* padded) const;
};

}  // namespace inceres::internal
