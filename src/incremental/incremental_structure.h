#pragma once

#include <algorithm>
#include <cstddef>
#include <cstdint>
#include <vector>

#include "inceres/problem/factor_graph.h"
#include "linearize/incremental_family.h"

namespace inceres::internal {

struct FactorRef {
  std::int32_t family;
  std::int32_t factor;
};
inline bool operator==(const FactorRef& a, const FactorRef& b) {
  return a.family == b.family && a.factor == b.factor;
}

/// Appends, and counts the bytes that the list takes more.
template <typename T>
void AppendCounted(const T& value, std::vector<T>* list, std::size_t* bytes) {
  const std::size_t before = list->capacity();
  list->push_back(value);
  *bytes += sizeof(T) * (list->capacity() - before);
}

/// Who takes part in a living problem, and who touches whom: frames, landmarks, and the factors
/// that connect them. Frames are in order of arrival, the row of a removed one serves a later one
/// once there are many. A constant is a mask: it keeps its place.
class IncrementalStructure {
 public:
  struct Frame {
    VariableId id = -1;      // -1: a free row
    std::int32_t quad = -1;  // of its step
    int size = 0;
    bool held = false;
    std::vector<FactorRef> factors;       // those that touch no landmark
    std::vector<std::int32_t> landmarks;  // which have the others
  };
  struct Landmark {
    VariableId id = -1;  // -1: a free place
    std::int32_t quad = -1;
    int size = 0;
    bool held = false;
    std::vector<FactorRef> factors;
    std::vector<std::int32_t> frames;  // its separator
    std::vector<std::int32_t> places;  // where each of them lists this landmark
  };

  explicit IncrementalStructure(const std::vector<IncrementalFamily>* families)
      : families_(*families) {}

  /// Return the index; that of a frame is its row.
  std::int32_t AddFrame(VariableId id, std::int32_t quad, int size);
  std::int32_t AddLandmark(VariableId id, std::int32_t quad, int size);
  /// No factor may touch it any more.
  void RemoveFrame(std::int32_t row);
  void RemoveLandmark(std::int32_t index);
  void HoldFrame(std::int32_t row, bool held) { frames_[row].held = held; }
  void HoldLandmark(std::int32_t index, bool held) { landmarks_[index].held = held; }

  /// Registers a factor with its frames (rows, -1 where none) and landmark (or -1).
  void Connect(FactorRef ref, const std::int32_t* frames, std::int32_t landmark);
  void Disconnect(FactorRef ref);
  /// By row, as the lower triangle of S asks for.
  void SortFramesOf(std::int32_t landmark);

  const std::vector<Frame>& frames() const { return frames_; }
  const std::vector<Landmark>& landmarks() const { return landmarks_; }
  int num_frames() const { return num_frames_; }
  int num_landmarks() const { return num_landmarks_; }

  std::int32_t FrameOfFactor(FactorRef ref, int slot) const { return FramesOfFactor(ref)[slot]; }
  /// Of all its slots.
  const std::int32_t* FramesOfFactor(FactorRef ref) const {
    return frame_of_slot_[ref.family].data() + Entry(ref);
  }
  std::int32_t LandmarkOfFactor(FactorRef ref) const {
    return landmark_of_[ref.family][ref.factor];
  }
  /// The slot that it is in.
  std::int32_t LandmarkSlot(FactorRef ref) const { return landmark_slot_[ref.family][ref.factor]; }
  bool Touches(FactorRef ref, std::int32_t frame) const {
    const std::int32_t* begin = frame_of_slot_[ref.family].data() + Entry(ref);
    const std::int32_t* end = begin + families_[ref.family].num_slots();
    return std::find(begin, end, frame) != end;
  }
  /// Calls visit(frame) for the factor's frames.
  template <typename Visit>
  void ForEachFrameOf(FactorRef ref, Visit&& visit) const {
    for (int s = 0; s < families_[ref.family].num_slots(); ++s) {
      if (FrameOfFactor(ref, s) >= 0) {
        visit(FrameOfFactor(ref, s));
      }
    }
  }
  /// Calls visit(ref) for the factors that touch both.
  template <typename Visit>
  void ForEachFactorBetween(std::int32_t landmark, std::int32_t frame, Visit&& visit) const {
    for (const FactorRef& ref : landmarks_[landmark].factors) {
      if (Touches(ref, frame)) {
        visit(ref);
      }
    }
  }

  std::size_t Bytes() const {
    return sizeof(Frame) * frames_.capacity() + sizeof(Landmark) * landmarks_.capacity() +
           list_bytes_;
  }

 private:
  std::size_t Entry(FactorRef ref) const {
    return static_cast<std::size_t>(ref.factor) * families_[ref.family].num_slots();
  }
  void GrowTables(FactorRef ref);
  void ConnectToLandmark(FactorRef ref, const std::int32_t* frames, std::int32_t landmark);
  void Unlist(std::int32_t frame, std::int32_t place);
  void Separate(std::int32_t landmark, std::int32_t frame);

  const std::vector<IncrementalFamily>& families_;
  std::vector<Frame> frames_;
  std::vector<Landmark> landmarks_;
  std::vector<std::int32_t> free_rows_;
  std::vector<std::int32_t> free_landmarks_;
  int num_frames_ = 0;
  int num_landmarks_ = 0;
  std::size_t list_bytes_ = 0;                            // of the lists of frames and landmarks
  std::vector<std::vector<std::int32_t>> frame_of_slot_;  // per family: per factor and slot
  // the same: where the frame lists it; of factors without landmark
  std::vector<std::vector<std::int32_t>> place_in_frame_;
  std::vector<std::vector<std::int32_t>> landmark_slot_;  // per family and factor
  std::vector<std::vector<std::int32_t>> landmark_of_;    // per family and factor
};

}  // namespace inceres::internal
