#include "incremental/incremental_structure.h"

#include <utility>

namespace inceres::internal {
namespace {

// Who touches whom (docs/algorithms.md, "Incremental Schur complement"). Rows of S are in order of
// arrival, as the resumed factor wants them: what is new is last. Factors with a landmark are
// listed by the landmark alone, and the frame lists the landmark; factors without one are listed
// by each of their frames. Both directions of a pair are kept with the place in the other's list,
// so that removal takes the last entry's place instead of a search through a frame's many
// landmarks. Removed rows and landmarks leave their places, which later ones take.

// A free row is used again only when there are as many as this beside as many as half the live
// ones: a new frame in an old row makes the factor of S resume there, while rows at the end cost
// nothing.
constexpr std::size_t kFreeRows = 4;

}  // namespace

// Returns a new last row, or a free one when there are many: a window that slides would otherwise
// make S grow without end.
std::int32_t IncrementalStructure::AddFrame(VariableId id, std::int32_t quad, int size) {
  auto row = static_cast<std::int32_t>(frames_.size());
  // The last one: the factor of S resumes at the row, and rows further up stay as they are.
  if (free_rows_.size() >= kFreeRows + static_cast<std::size_t>(num_frames_) / 2) {
    const auto last = std::max_element(free_rows_.begin(), free_rows_.end());
    row = *last;
    free_rows_.erase(last);
  } else {
    frames_.emplace_back();
  }
  Frame& frame = frames_[row];
  frame.id = id;
  frame.quad = quad;
  frame.size = size;
  frame.held = false;
  ++num_frames_;
  return row;
}

// A removed row keeps its place with size 0; rows behind it keep their numbers.
void IncrementalStructure::RemoveFrame(std::int32_t row) {
  Frame& frame = frames_[row];
  frame.id = -1;
  frame.size = 0;
  frame.held = false;
  --num_frames_;
  free_rows_.push_back(row);
}

// Landmarks have no order that would matter: any free place does, the last one freed first.
std::int32_t IncrementalStructure::AddLandmark(VariableId id, std::int32_t quad, int size) {
  auto index = static_cast<std::int32_t>(landmarks_.size());
  if (free_landmarks_.empty()) {
    landmarks_.emplace_back();
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
  return index;
}

void IncrementalStructure::RemoveLandmark(std::int32_t index) {
  landmarks_[index].id = -1;
  --num_landmarks_;
  free_landmarks_.push_back(index);
}

// Families and their places may have grown since; the tables never shrink. landmark_of_ stands for
// all four, which grow together.
void IncrementalStructure::GrowTables(FactorRef ref) {
  for (auto* table : {&frame_of_slot_, &place_in_frame_, &landmark_of_, &landmark_slot_}) {
    table->resize(families_.size());
  }
  const IncrementalFamily& family = families_[ref.family];
  const auto num_places = static_cast<std::size_t>(family.num_places());
  if (landmark_of_[ref.family].size() < num_places) {
    frame_of_slot_[ref.family].resize(num_places * family.num_slots(), -1);
    place_in_frame_[ref.family].resize(num_places * family.num_slots(), -1);
    landmark_of_[ref.family].resize(num_places, -1);
    landmark_slot_[ref.family].resize(num_places, -1);
  }
}

// What takes part is told by the caller: -1 for variables that are outside the system.
void IncrementalStructure::Connect(FactorRef ref, const std::int32_t* frames,
                                   std::int32_t landmark) {
  GrowTables(ref);
  // Also -1, which a place that was used before must forget.
  landmark_of_[ref.family][ref.factor] = landmark;
  for (int s = 0; s < families_[ref.family].num_slots(); ++s) {
    frame_of_slot_[ref.family][Entry(ref) + s] = frames[s];
    if (frames[s] >= 0 && landmark < 0) {
      place_in_frame_[ref.family][Entry(ref) + s] =
          static_cast<std::int32_t>(frames_[frames[s]].factors.size());
      AppendCounted(ref, &frames_[frames[s]].factors, &list_bytes_);
    }
  }
  if (landmark >= 0) {
    ConnectToLandmark(ref, frames, landmark);
  }
}

// The landmark lists the factor; each of its frames joins the separator, with the place at which
// it lists the landmark in turn.
void IncrementalStructure::ConnectToLandmark(FactorRef ref, const std::int32_t* frames,
                                             std::int32_t landmark) {
  Landmark& l = landmarks_[landmark];
  AppendCounted(ref, &l.factors, &list_bytes_);
  const IncrementalFamily& family = families_[ref.family];
  for (int s = 0; s < family.num_slots(); ++s) {
    // Which slot has the landmark is looked up here once, by its id.
    if (family.variables(ref.factor)[s] == l.id) {
      landmark_slot_[ref.family][ref.factor] = s;
    }
    // A frame joins the separator with its first factor; others add nothing. Separators are short
    // enough for a linear search.
    if (frames[s] >= 0 &&
        std::find(l.frames.begin(), l.frames.end(), frames[s]) == l.frames.end()) {
      AppendCounted(frames[s], &l.frames, &list_bytes_);
      AppendCounted(static_cast<std::int32_t>(frames_[frames[s]].landmarks.size()), &l.places,
                    &list_bytes_);
      AppendCounted(landmark, &frames_[frames[s]].landmarks, &list_bytes_);
    }
  }
}

// The last of the frame's factors takes the place.
void IncrementalStructure::Unlist(std::int32_t frame, std::int32_t place) {
  std::vector<FactorRef>& factors = frames_[frame].factors;
  const FactorRef last = factors.back();
  factors[place] = last;
  factors.pop_back();
  // The moved factor's own place, in each slot that has this frame.
  for (int s = 0; s < families_[last.family].num_slots(); ++s) {
    if (FrameOfFactor(last, s) == frame) {
      place_in_frame_[last.family][Entry(last) + s] = place;
    }
  }
}

// The frame is no longer one the landmark is seen from; the last of its landmarks takes the place.
void IncrementalStructure::Separate(std::int32_t landmark, std::int32_t frame) {
  const auto index_of = [this, frame](std::int32_t l) {
    const std::vector<std::int32_t>& frames = landmarks_[l].frames;
    return std::find(frames.begin(), frames.end(), frame) - frames.begin();
  };
  Landmark& l = landmarks_[landmark];
  const auto at = index_of(landmark);
  // The last entry takes the free place in the frame's list, and its landmark is told where it now
  // is.
  const std::int32_t place = l.places[at];
  std::vector<std::int32_t>& listed = frames_[frame].landmarks;
  listed[place] = listed.back();
  // This landmark may itself be the one that moved; its entry is erased below.
  landmarks_[listed[place]].places[index_of(listed[place])] = place;
  listed.pop_back();
  // Erased, not swapped: the separator stays in its order.
  l.frames.erase(l.frames.begin() + at);
  l.places.erase(l.places.begin() + at);
}

// The lists lose the factor; the tables keep what they had at its place, which nobody asks for
// until it is used again.
void IncrementalStructure::Disconnect(FactorRef ref) {
  const int num_slots = families_[ref.family].num_slots();
  const std::int32_t landmark = LandmarkOfFactor(ref);
  if (landmark < 0) {
    for (int s = 0; s < num_slots; ++s) {
      if (FrameOfFactor(ref, s) >= 0) {
        Unlist(FrameOfFactor(ref, s), place_in_frame_[ref.family][Entry(ref) + s]);
      }
    }
    return;
  }
  Landmark& l = landmarks_[landmark];
  l.factors.erase(std::find(l.factors.begin(), l.factors.end(), ref));
  for (int s = 0; s < num_slots; ++s) {
    const std::int32_t frame = FrameOfFactor(ref, s);
    // The separator loses the frame with the last factor between them.
    if (frame >= 0 && std::none_of(l.factors.begin(), l.factors.end(),
                                   [&](const FactorRef& f) { return Touches(f, frame); })) {
      Separate(landmark, frame);
    }
  }
}

// Insertion sort: mostly sorted already, and `places` has to go along.
void IncrementalStructure::SortFramesOf(std::int32_t landmark) {
  Landmark& l = landmarks_[landmark];
  for (std::size_t i = 1; i < l.frames.size(); ++i) {
    for (std::size_t k = i; k > 0 && l.frames[k - 1] > l.frames[k]; --k) {
      std::swap(l.frames[k - 1], l.frames[k]);
      std::swap(l.places[k - 1], l.places[k]);
    }
  }
}

}  // namespace inceres::internal
