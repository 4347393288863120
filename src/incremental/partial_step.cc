#include "incremental/partial_step.h"

#include <algorithm>

namespace inceres::internal {
namespace {

// S'_AA x_A = b_A for a growing set A (docs/algorithms.md, "Lazy steps"). A is appended to in
// rounds, so its envelope factor and y = L⁻¹b only gain rows, and the gain is a running sum ½
// ‖y‖²; x and the rest are found anew in each round, for every x_k changes when A grows. A frame
// outside A is worth a look only if the rest b − S'x pulls at it, and only neighbors of A have
// another rest than b.

// y −= B x for a block with padded rows.
void SubtractProduct(int rows, int columns, const double* B, const double* x, double* y) {
  for (int r = 0; r < rows; ++r, B += PadToQuad(columns)) {
    double sum = 0.0;
    for (int c = 0; c < columns; ++c) {
      sum += B[c] * x[c];
    }
    y[r] -= sum;
  }
}

// y −= Bᵀ x.
// The block of a row below A is read from the other side.
void SubtractTransposedProduct(int rows, int columns, const double* B, const double* x, double* y) {
  for (int r = 0; r < rows; ++r, B += PadToQuad(columns)) {
    for (int c = 0; c < columns; ++c) {
      y[c] -= B[c] * x[r];
    }
  }
}

}  // namespace

// A whole S that fits into the largest A gains nothing from a search.
bool PartialStep::IsWorthwhile(const IncrementalSchur& schur) const {
  return schur.size() > limits_.max_scalars;
}

// S'_AA x_A = b_A gains ½ b_Aᵀ x_A = ½ ‖y_A‖² with y_A = L⁻¹ b_A: each row that A grows by adds its
// share.
// `gain` may be reached in the very first round, or be nothing at all: A is then empty.
bool PartialStep::Find(const IncrementalSchur& schur, const ReducedVectors& reduced, double gain) {
  Begin(schur, reduced);
  double gained = 0.0;
  while (gained < gain) {
    const int num_before = num_frames();
    // Not in the first round: x is empty, the rest is b.
    if (num_before > 0) {
      TakeOutOfRest(schur, reduced);
    }
    Grow(schur, reduced);
    // No frame with a pull is left, or A costs more than what standing still saves.
    if (num_frames() == num_before || static_cast<int>(b_.size()) > limits_.max_scalars ||
        !cholesky_.Factorize(schur.S(), order_, damping_.data(), num_before)) {
      return false;
    }
    cholesky_.ForwardSubstitute(b_.data(), num_before, y_.data());
    // Rows before num_before have the same y as in the round before, and are counted already.
    for (std::size_t k = cholesky_.offsets()[num_before]; k < y_.size(); ++k) {
      gained += 0.5 * y_[k] * y_[k];
    }
    BackSubstitute();
  }
  return true;
}

// Counted before anything is allocated or appended.
bool PartialStep::HasRoomFor(const IncrementalSchur& schur, const IndexSet& frames) const {
  int scalars = 0;
  frames.ForEach([&](std::int32_t i) { scalars += schur.frames()[i].size; });
  return scalars <= limits_.max_scalars;
}

// A as given, in one go: for new frames (new_frame_steps.cc).
bool PartialStep::Solve(const IncrementalSchur& schur, const ReducedVectors& reduced,
                        const IndexSet& frames) {
  MakeRoom(schur);
  order_.Clear();
  b_.clear();
  damping_.clear();
  // Ascending: an IndexSet is walked by index, so that the same A gives the same bits.
  frames.ForEach([&](std::int32_t i) { Append(schur, reduced, i); });
  y_.resize(b_.size());
  x_.resize(b_.size());
  if (!cholesky_.Factorize(schur.S(), order_, damping_.data(), 0)) {
    return false;
  }
  cholesky_.ForwardSubstitute(b_.data(), 0, y_.data());
  BackSubstitute();
  return true;
}

// b and damping are copied into A's own order, in which the factor and all its vectors are packed.
void PartialStep::Append(const IncrementalSchur& schur, const ReducedVectors& reduced,
                         std::int32_t frame) {
  const int begin = schur.FrameOffset(frame);
  const int end = schur.FrameOffset(frame + 1);
  order_.Append(frame, schur.S().num_rows());
  b_.insert(b_.end(), reduced.b().begin() + begin, reduced.b().begin() + end);
  damping_.insert(damping_.end(), reduced.damping().begin() + begin,
                  reduced.damping().begin() + end);
}

// For the largest A there may be: how A grows is not the same from step to step, and a steady
// window is not to allocate.
void PartialStep::MakeRoom(const IncrementalSchur& schur) {
  if (schur.size() == size_with_room_) {
    return;
  }
  size_with_room_ = schur.size();
  int smallest = schur.size();
  int largest = 0;
  for (const IncrementalSchur::Frame& frame : schur.frames()) {
    smallest = frame.size > 0 ? std::min(smallest, frame.size) : smallest;
    largest = std::max(largest, frame.size);
  }
  // The envelope of a row reaches back over at most all of A.
  const int scalars = std::min(schur.size(), limits_.max_scalars);
  const int row_entries = largest * PadToQuad(scalars + kQuad);
  // As many rows as the smallest frames would make of the largest A; later calls find the room
  // there.
  cholesky_.Reserve(scalars / std::max(1, smallest), row_entries, largest);
  for (std::vector<double>* packed : {&b_, &damping_, &y_, &remainder_, &x_}) {
    packed->reserve(schur.size());  // A is found too large when it is there
  }
}

// The frames with a pull to speak of, with the rest b as if no frame had moved.
void PartialStep::Begin(const IncrementalSchur& schur, const ReducedVectors& reduced) {
  MakeRoom(schur);
  order_.Clear();
  b_.clear();
  damping_.clear();
  const std::vector<double>& pulls = reduced.pulls();
  pulled_.Grow(pulls.size());
  pulled_.Clear();
  rest_.resize(schur.size());
  pulls_.resize(pulls.size());
  // Most pulls of a settled window are nearly zero. Frames below this share of the strongest enter
  // only when a neighbor's step pulls at them.
  const double least =
      pulls.empty() ? 0.0 : limits_.no_pull * *std::max_element(pulls.begin(), pulls.end());
  for (std::size_t i = 0; i < pulls.size(); ++i) {
    if (pulls[i] > least) {
      BeginRest(schur, reduced, static_cast<std::int32_t>(i));
    }
  }
}

// Adding a frame twice does no harm: it is a set.
void PartialStep::BeginRest(const IncrementalSchur& schur, const ReducedVectors& reduced,
                            std::int32_t frame) {
  std::copy(reduced.b().begin() + schur.FrameOffset(frame),
            reduced.b().begin() + schur.FrameOffset(frame + 1),
            rest_.begin() + schur.FrameOffset(frame));
  pulled_.Add(frame);
}

void PartialStep::Grow(const IncrementalSchur& schur, const ReducedVectors& reduced) {
  // Twice over the set: the threshold is a share of the strongest pull of this round.
  double strongest = 0.0;
  pulled_.ForEach([&](std::int32_t i) {
    // A frame of A pulls no more; zero keeps it out of the next pass.
    pulls_[i] =
        order_.place(i) >= 0 ? 0.0 : reduced.Pull(schur, i, rest_.data() + schur.FrameOffset(i));
    strongest = std::max(strongest, pulls_[i]);
  });
  pulled_.ForEach([&](std::int32_t i) {
    if (pulls_[i] > 0.0 && pulls_[i] >= limits_.pull_share * strongest) {
      Append(schur, reduced, i);
    }
  });
  // y and x grow with A; the next calls fill them.
  y_.resize(b_.size());
  x_.resize(b_.size());
}

// Upwards, each row taking its part out of those above: remainder_ starts as y and is used up.
void PartialStep::BackSubstitute() {
  remainder_.assign(y_.begin(), y_.end());
  for (int k = num_frames() - 1; k >= 0; --k) {
    cholesky_.BackSubstituteRow(k, remainder_.data(), x_.data());
  }
}

// rest := b − S x at the neighbors of A.
// Anew from b for every neighbor, and not from the last rest: x_A has changed in all of A.
void PartialStep::TakeOutOfRest(const IncrementalSchur& schur, const ReducedVectors& reduced) {
  const SymmetricBlockRows& S = schur.S();
  for (const int i : order_.rows()) {
    S.ForEachCoupled(i, [&](int other) { BeginRest(schur, reduced, other); });
  }
  // The lower triangle has a block of two rows once: as an entry of i's own row, or of the row
  // below it.
  for (int k = 0; k < num_frames(); ++k) {
    const int i = frame(k);
    for (const SymmetricBlockRows::Entry& entry : S.row(i)) {
      // Rows in A are solved exactly; their rest is zero.
      if (order_.place(entry.column) < 0) {
        SubtractTransposedProduct(S.size_of(i), S.size_of(entry.column), S.values(entry.offset),
                                  step(k), rest_.data() + schur.FrameOffset(entry.column));
      }
    }
    for (const int below : S.below(i)) {
      if (order_.place(below) < 0) {
        SubtractProduct(S.size_of(below), S.size_of(i), S.values(S.Find(below, i)), step(k),
                        rest_.data() + schur.FrameOffset(below));
      }
    }
  }
}

std::size_t PartialStep::Bytes() const {
  std::size_t doubles = 0;
  for (const std::vector<double>* numbers :
       {&rest_, &pulls_, &b_, &damping_, &y_, &remainder_, &x_}) {
    doubles += numbers->capacity();
  }
  return cholesky_.Bytes() + sizeof(double) * doubles;
}

}  // namespace inceres::internal
