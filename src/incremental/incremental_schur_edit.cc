// How IncrementalSchur grows and shrinks: frames, landmarks and the factors that connect them.

#include <algorithm>

#include "incremental/incremental_schur.h"

namespace inceres::internal {
namespace {

// A free row is used again only when there are as many as this beside as many as half the live ones: a new frame in an old row
// makes the factor resume there, while rows at the end cost nothing.
constexpr std::size_t kFreeRows = 4;

}  // namespace

void IncrementalSchur::MakeRoom(std::int32_t quad, int size) {
  const std::size_t end = static_cast<std::size_t>(quad) * kQuad + PadToQuad(size);
  if (end > rhs_.size()) {
    for (AlignedVector<double>* padded : {&rhs_, &rhs_change_, &C_diagonal_, &C_peak_, &b_peak_}) {
      padded->resize(end, 0.0);
    }
  }
  for (AlignedVector<double>* padded : {&rhs_, &rhs_change_, &C_diagonal_, &C_peak_, &b_peak_}) {
    std::fill_n(padded->begin() + std::ptrdiff_t{quad} * kQuad, PadToQuad(size), 0.0);
  }
}

void IncrementalSchur::UpdateOffsets(std::int32_t first) {
  offsets_.resize(frames_.size() + 1);
  for (std::size_t i = first; i < frames_.size(); ++i) {
    offsets_[i + 1] = offsets_[i] + frames_[i].size;
    unread_rows_.Add(static_cast<std::int32_t>(i));
  }
}

int IncrementalSchur::AddFrame(VariableId id, std::int32_t quad, int size) {
  auto row = static_cast<std::int32_t>(frames_.size());
  if (free_rows_.size() >= kFreeRows + static_cast<std::size_t>(num_frames_) / 2) {
    const auto last = std::max_element(free_rows_.begin(), free_rows_.end());
    row = *last;
    free_rows_.erase(last);
    S_.ReviveRow(row, size);
  } else {
    frames_.emplace_back();
    S_.AddRow(size);
    for (IndexSet* set : {&touched_, &changed_rows_, &unfactored_rows_, &unsolved_rows_, &unread_rows_}) {
      set->Grow(frames_.size());
    }
  }
  Frame& frame = frames_[row];
  frame.id = id;
  frame.quad = quad;
  frame.size = size;
  frame.held = false;
  ++num_frames_;
  UpdateOffsets(row);
  MakeRoom(quad, size);
  Touch(row);
  return row;
}

void IncrementalSchur::RemoveFrame(std::int32_t row) {
  Frame& frame = frames_[row];
  S_.RemoveRow(row);
  frame.id = -1;
  frame.size = 0;
  frame.held = false;
  --num_frames_;
  UpdateOffsets(row);
  free_rows_.push_back(row);
  Touch(row);
}

void IncrementalSchur::HoldFrame(std::int32_t row, bool held) {
  frames_[row].held = held;
  Touch(row);
}

void IncrementalSchur::HoldLandmark(std::int32_t index, bool held) {
  TakeOut(index);
  landmarks_[index].held = held;
}

int IncrementalSchur::AddLandmark(VariableId id, std::int32_t quad, int size) {
  auto index = static_cast<std::int32_t>(landmarks_.size());
  if (free_landmarks_.empty()) {
    landmarks_.emplace_back();
    decrements_.push_back(0.0);
    eager_.Grow(landmarks_.size());
    heavily_damped_.Grow(landmarks_.size());
  } else {
    index = free_landmarks_.back();
    free_landmarks_.pop_back();
  }
  Landmark& landmark = landmarks_[index];
  landmark.id = id;
  landmark.quad = quad;
  landmark.size = size;
  landmark.held = false;
  ++num_landmarks_;
  MakeRoom(quad, size);
  return index;
}

void IncrementalSchur::RemoveLandmark(std::int32_t index) {
  TakeOut(index);
  Landmark& landmark = landmarks_[index];
  ReleaseBlocks(&landmark);
  num_undetermined_ -= landmark.undetermined ? 1 : 0;
  landmark.undetermined = false;
  landmark.id = -1;
  heavily_damped_.Remove(index);
  --num_landmarks_;
  free_landmarks_.push_back(index);
}

void IncrementalSchur::Connect(FactorRef ref, const std::int32_t* frames, std::int32_t landmark) {
  for (auto* table : {&frame_of_slot_, &place_in_frame_, &landmark_of_, &landmark_slot_, &factor_blocks_}) {
    table->resize(families_.size());
  }
  const IncrementalFamily& family = families_[ref.family];
  const int num_slots = family.num_slots();
  const auto num_places = static_cast<std::size_t>(family.num_places());
  if (landmark_of_[ref.family].size() < num_places) {
    frame_of_slot_[ref.family].resize(num_places * num_slots, -1);
    place_in_frame_[ref.family].resize(num_places * num_slots, -1);
    landmark_of_[ref.family].resize(num_places, -1);
    landmark_slot_[ref.family].resize(num_places, -1);
  }
  landmark_of_[ref.family][ref.factor] = landmark;
  const std::size_t num_pairs = static_cast<std::size_t>(num_slots) * (num_slots + 1) / 2;
  if (factor_blocks_[ref.family].size() < num_places * num_pairs) {
    factor_blocks_[ref.family].resize(num_places * num_pairs, -1);
  }
  factor_blocks_[ref.family][ref.factor * num_pairs] = -1;
  for (int s = 0; s < num_slots; ++s) {
    frame_of_slot_[ref.family][Slot(ref, s)] = frames[s];
    if (frames[s] >= 0 && landmark < 0) {
      place_in_frame_[ref.family][Slot(ref, s)] = static_cast<std::int32_t>(frames_[frames[s]].factors.size());
      Append(&frames_[frames[s]].factors, ref);
    }
  }
  if (landmark < 0) {
    return;
  }
  Landmark& l = landmarks_[landmark];
  Append(&l.factors, ref);
  l.placed = false;
  for (int s = 0; s < num_slots; ++s) {
    if (family.variables(ref.factor)[s] == l.id) {
      landmark_slot_[ref.family][ref.factor] = s;
    }
    if (frames[s] >= 0 && std::find(l.frames.begin(), l.frames.end(), frames[s]) == l.frames.end()) {
      Append(&l.frames, frames[s]);
      Append(&l.places, static_cast<std::int32_t>(frames_[frames[s]].landmarks.size()));
      Append(&frames_[frames[s]].landmarks, landmark);
    }
  }
}

// The last of the frame's factors takes the place.
void IncrementalSchur::Unlist(std::int32_t frame, std::int32_t place) {
  std::vector<FactorRef>& factors = frames_[frame].factors;
  const FactorRef last = factors.back();
  factors[place] = last;
  factors.pop_back();
  for (int s = 0; s < families_[last.family].num_slots(); ++s) {
    if (FrameOfFactor(last, s) == frame) {
      place_in_frame_[last.family][Slot(last, s)] = place;
    }
  }
}

// The frame is no longer one the landmark is seen from; the last of its landmarks takes the place.
void IncrementalSchur::Separate(std::int32_t landmark, std::int32_t frame) {
  const auto index_of = [this, frame](std::int32_t l) {
    const std::vector<std::int32_t>& frames = landmarks_[l].frames;
    return std::find(frames.begin(), frames.end(), frame) - frames.begin();
  };
  Landmark& l = landmarks_[landmark];
  const auto at = index_of(landmark);
  const std::int32_t place = l.places[at];
  std::vector<std::int32_t>& listed = frames_[frame].landmarks;
  listed[place] = listed.back();
  landmarks_[listed[place]].places[index_of(listed[place])] = place;
  listed.pop_back();
  l.frames.erase(l.frames.begin() + at);
  l.places.erase(l.places.begin() + at);
}

void IncrementalSchur::Disconnect(FactorRef ref) {
  const int num_slots = families_[ref.family].num_slots();
  const std::int32_t landmark = LandmarkOfFactor(ref);
  for (int s = 0; s < num_slots && landmark < 0; ++s) {
    if (FrameOfFactor(ref, s) >= 0) {
      Unlist(FrameOfFactor(ref, s), place_in_frame_[ref.family][Slot(ref, s)]);
    }
  }
  if (landmark < 0) {
    return;
  }
  Landmark& l = landmarks_[landmark];
  l.factors.erase(std::find(l.factors.begin(), l.factors.end(), ref));
  l.placed = false;
  for (int s = 0; s < num_slots; ++s) {
    const std::int32_t frame = FrameOfFactor(ref, s);
    if (frame >= 0 && std::none_of(l.factors.begin(), l.factors.end(), [&](const FactorRef& f) { return Touches(f, frame); })) {
      Separate(landmark, frame);
    }
  }
}

std::int64_t IncrementalSchur::Bytes() const {
  std::size_t bytes = sizeof(double) * (5 * rhs_.capacity() + Y_.capacity() + kept_.capacity()) +
                      sizeof(Frame) * frames_.capacity() + (sizeof(Landmark) + sizeof(double)) * landmarks_.capacity() +
                      list_bytes_;
  for (const std::vector<std::int32_t>& blocks : factor_blocks_) {
    bytes += blocks.capacity() * sizeof(std::int32_t);
  }
  return static_cast<std::int64_t>(bytes) + S_.Bytes();
}

}  // namespace inceres::internal
