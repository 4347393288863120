#include "incremental/incremental_schur.h"

#include <algorithm>
#include <cmath>

#include "base/larger_of.h"

namespace inceres::internal {

// S and b by difference (docs/algorithms.md, "Incremental Schur complement"). The rule that keeps
// the sums right is that a contribution goes out as the very numbers it went in with: a landmark's
// Y and z are kept for that, and a factor's rows while its Jacobians are exchanged. What goes in
// and out again leaves rounding of the size of the largest value that was ever there, so rows whose
// values have fallen far below their peaks are summed anew.
//
// A landmark is either wholly in S (kInS), in some rows of it (kInRows), or outside. Its η and its
// gain ½ ‖z‖² are kept beside S. Sums run in the order of the factors in their lists, on the
// calling thread: the same edits give the same bits.

namespace {

// All rows are looked at when the cost has fallen by this. b is at most √(2 F C_kk), F being the
// cost: when that falls, entries that nobody has touched since may be rounding.
constexpr double kCostDrop = 1e2;

}  // namespace

// Packed vectors have no holes: rows behind one that came or went are read anew.
void IncrementalSchur::UpdateOffsets(std::int32_t first) {
  offsets_.resize(frames().size() + 1);
  for (std::size_t i = first; i < frames().size(); ++i) {
    offsets_[i + 1] = offsets_[i] + frames()[i].size;
    sums_.changes().TouchOffset(static_cast<std::int32_t>(i));
  }
}

// The row of a removed frame may serve again; a new one goes to the end, where a resumed factor has
// least to do.
int IncrementalSchur::AddFrame(VariableId id, std::int32_t quad, int size) {
  const std::int32_t row = structure_.AddFrame(id, quad, size);
  if (row < sums_.S().num_rows()) {
    sums_.S().ReviveRow(row, size);
  } else {
    sums_.S().AddRow(size);
    sums_.changes().Grow(frames().size());
  }
  UpdateOffsets(row);
  sums_.vectors().MakeRoom(quad, size);
  sums_.changes().Touch(row);
  return row;
}

void IncrementalSchur::RemoveFrame(std::int32_t row) {
  sums_.S().RemoveRow(row);
  structure_.RemoveFrame(row);
  UpdateOffsets(row);
  sums_.changes().Touch(row);
}

// Nothing of S changes, but the solver has another system to factor.
void IncrementalSchur::HoldFrame(std::int32_t row, bool held) {
  structure_.HoldFrame(row, held);
  sums_.changes().Touch(row);
}

void IncrementalSchur::SetFrameGroup(std::int32_t row, int group) {
  if (S().group_of(row) != group) {
    sums_.S().SetGroup(row, group);
    sums_.changes().Touch(row);
  }
}

int IncrementalSchur::AddLandmark(VariableId id, std::int32_t quad, int size) {
  const std::int32_t index = structure_.AddLandmark(id, quad, size);
  blocks_.Grow();
  gains_.Grow(landmarks().size());
  sums_.vectors().MakeRoom(quad, size);
  return index;
}

void IncrementalSchur::RemoveLandmark(std::int32_t index) {
  TakeOut(index);
  blocks_.Remove(index);
  structure_.RemoveLandmark(index);
}

void IncrementalSchur::HoldLandmark(std::int32_t index, bool held) {
  TakeOut(index);
  structure_.HoldLandmark(index, held);
}

void IncrementalSchur::Connect(FactorRef ref, const std::int32_t* frames, std::int32_t landmark) {
  structure_.Connect(ref, frames, landmark);
  if (landmark >= 0) {
    // Its separator may have another frame: the blocks of Y will be placed anew.
    blocks_.Displace(landmark);
  }
  sums_.ConnectFactor(ref);
}

void IncrementalSchur::Disconnect(FactorRef ref) {
  sums_.DisconnectFactor(ref);
  structure_.Disconnect(ref);
  if (structure_.LandmarkOfFactor(ref) >= 0) {
    blocks_.Displace(structure_.LandmarkOfFactor(ref));
  }
}

// With the Y and z it has. While S is rebuilt nothing is subtracted: the sums are zeroed later.
void IncrementalSchur::TakeOut(std::int32_t landmark) {
  if (IsInS(landmark)) {
    if (!rebuilding_) {
      sums_.AddLandmark(landmark, 1.0);
    }
    num_pairs_ -= blocks_.NumPairs(landmark);
    blocks_.SetState(landmark, LandmarkState::kOutside);
  }
  // Zero, for it is outside now.
  RenewGain(landmark);
}

// P, η and U_inv anew; false of a landmark that is held or has no information.
bool IncrementalSchur::Invert(std::int32_t landmark, double lambda) {
  const Landmark& l = landmarks()[landmark];
  if (!l.held) {
    // A factor of two landmarks belongs to one and writes changes to both: those to the other, held
    // one are nobody's.
    sums_.vectors().DropChange(l.quad, l.size);
    blocks_.Sum(landmark, sums_.vectors().rhs(l.quad));
    // With η just summed. A coordinate that is held leaves U_inv, so this comes before it is
    // inverted.
    bounds_.Hold(l.id, l.quad, sums_.vectors().rhs(l.quad));
  }
  return blocks_.Invert(landmark, lambda, HeldAtBounds(l.quad));
}

// An undetermined landmark waits there for another factor or linearization; it is counted, and a
// held one is not.
void IncrementalSchur::LeaveOutside(std::int32_t landmark) {
  blocks_.SetState(landmark, landmarks()[landmark].held ? LandmarkState::kOutside
                                                        : LandmarkState::kUndetermined);
}

void IncrementalSchur::Eliminate(std::int32_t landmark) {
  // Blocks of S are found, or added, when the landmark's separator has changed, and not otherwise.
  blocks_.Place(landmark, [this](std::int32_t row, std::int32_t column) {
    return sums_.BlockOf(row, column);
  });
  blocks_.Eliminate(landmark, eta(landmark));
}

// The one verb by which a landmark comes, changes or turns out to have no information.
void IncrementalSchur::PutIn(std::int32_t landmark, double lambda) {
  if (!Invert(landmark, lambda)) {
    // P and U_inv are new by now, but Y and z are still those that are in S.
    TakeOut(landmark);
    return LeaveOutside(landmark);
  }
  // It is there already, with blocks to exchange: one pass over S instead of two. Without frames
  // there is nothing to exchange, and adding adds nothing.
  if (IsInS(landmark) && blocks_.SizeOfY(landmark) > 0) {
    sums_.EliminateAnew(landmark, eta(landmark));
  } else {
    Eliminate(landmark);
    sums_.AddLandmark(landmark, -1.0);
    num_pairs_ += IsInS(landmark) ? 0 : blocks_.NumPairs(landmark);
    blocks_.SetState(landmark, LandmarkState::kInS);
  }
  RenewGain(landmark);
}

// For the steps of new frames: the rows of all others are held there, and S is spared what the full
// step replaces anyway. The gain is not renewed, for the landmark is not part of S.
void IncrementalSchur::PutIntoRows(std::int32_t landmark, double lambda, const IndexSet& rows) {
  if (!Invert(landmark, lambda)) {
    return LeaveOutside(landmark);
  }
  Eliminate(landmark);
  sums_.AddLandmarkWithin(landmark, -1.0, rows);
  blocks_.SetState(landmark, LandmarkState::kInRows);
}

// Those that were held or undetermined have never been put in.
void IncrementalSchur::TakeOutOfRows(std::int32_t landmark, const IndexSet& rows) {
  if (blocks_.state(landmark) == LandmarkState::kInRows) {
    sums_.AddLandmarkWithin(landmark, 1.0, rows);
    blocks_.SetState(landmark, LandmarkState::kOutside);
  }
}

void IncrementalSchur::RefreshResidual(std::int32_t landmark) {
  // Also of a landmark outside S: its η stays right.
  sums_.vectors().TakeChange(landmarks()[landmark].quad, landmarks()[landmark].size);
  if (IsInS(landmark)) {
    // P is unchanged, and with it Y and S: only z and b follow.
    blocks_.RenewZ(landmark, eta(landmark), sums_.vectors().rhs());
    RenewGain(landmark);
  }
}

void IncrementalSchur::TakeChange(int frame) {
  sums_.vectors().TakeChange(frames()[frame].quad, frames()[frame].size);
  // S is not touched: the factor stays, and the solver substitutes anew.
  sums_.changes().TouchB(frame);
}

// In the usual case only rows that were touched are looked at.
int IncrementalSchur::ResumDrifted(double cost) {
  scratch_.clear();
  const auto look_at = [this, cost](std::int32_t row) {
    if (sums_.vectors().HasDrifted(frames()[row].quad, frames()[row].size, cost)) {
      scratch_.push_back(row);
    }
  };
  if (kCostDrop * cost < drift_cost_) {
    for (std::int32_t row = 0; row < static_cast<std::int32_t>(frames().size()); ++row) {
      look_at(row);
    }
    // From here on the next fall is measured.
    drift_cost_ = cost;
  } else {
    sums_.changes().unchecked().ForEach(look_at);
    // The largest cost since all rows were looked at.
    drift_cost_ = std::max(drift_cost_, cost);
  }
  // Listed first: summing a row touches others, and the list is not to change under the walk.
  for (const std::int32_t row : scratch_) {
    ResumFrame(row);
  }
  // Rows that were just summed anew need no look.
  sums_.changes().ClearUnchecked();
  return static_cast<int>(scratch_.size());
}

// One row and its column, of factors with frames only and of landmarks that see the frame. Factors
// of a landmark are listed with the landmark.
void IncrementalSchur::ResumFrame(std::int32_t frame) {
  const Frame& f = frames()[frame];
  sums_.ZeroRow(frame, f.quad, f.size);
  const auto add_factor = [this, frame](const FactorRef& ref) {
    if (families_[ref.family].weighed().linearized(ref.factor)) {
      sums_.AddFactorToRow(ref, frame);
    }
  };
  std::for_each(f.factors.begin(), f.factors.end(), add_factor);
  for (const std::int32_t landmark : f.landmarks) {
    structure_.ForEachFactorBetween(landmark, frame, add_factor);
    if (IsInS(landmark)) {
      sums_.AddLandmarkAcross(landmark, -1.0, frame);
    }
  }
  sums_.changes().Touch(frame);
}

// Families, then landmarks, each in the order of their places. Landmarks go in with the Y and z
// that they have; those that were taken out come by PutIn.
void IncrementalSchur::Rebuild() {
  rebuilding_ = false;
  sums_.S().Zero();
  for (std::int32_t row = 0; row < static_cast<std::int32_t>(frames().size()); ++row) {
    // Free rows have no place in the padded vectors.
    if (frames()[row].id >= 0) {
      sums_.vectors().Zero(frames()[row].quad, frames()[row].size);
      sums_.changes().Touch(row);
    }
  }
  for (const IncrementalFamily& family : families_) {
    for (std::int32_t i = 0; i < family.num_places(); ++i) {
      if (family.weighed().linearized(i)) {
        sums_.SumFactor({family.id(), i}, 1.0);  // all rows are touched above
      }
    }
  }
  for (std::int32_t l = 0; l < static_cast<std::int32_t>(landmarks().size()); ++l) {
    if (IsInS(l)) {
      sums_.AddLandmark(l, -1.0);
    }
  }
  // Sums that are new have not drifted; the next look begins with the cost of then.
  sums_.changes().ClearUnchecked();
  drift_cost_ = 0.0;
}

// ½ ‖z‖² = ½ ηᵀ (P + λD)⁻¹ η.
void IncrementalSchur::RenewGain(std::int32_t landmark) {
  const double* z = blocks_.z(landmark);
  const int size = IsInS(landmark) ? landmarks()[landmark].size : 0;
  double gain = 0.0;
  for (int k = 0; k < size; ++k) {
    gain += 0.5 * z[k] * z[k];
  }
  gains_.Set(landmark, gain);
}

// What cannot move has no gradient: held variables, coordinates at bounds, landmarks outside S.
void IncrementalSchur::RhsNorms(double* max_norm, double* norm) const {
  double largest = 0.0;
  double squared = 0.0;
  const auto add = [&](const double* rhs, std::int32_t quad, int size) {
    const char* held = HeldAtBounds(quad);
    for (int k = 0; k < size; ++k) {
      if (held != nullptr && held[k] != 0) {
        continue;
      }
      largest = LargerOf(largest, std::fabs(rhs[k]));
      squared += rhs[k] * rhs[k];
    }
  };
  for (int i = 0; i < static_cast<int>(frames().size()); ++i) {
    add(b(i), frames()[i].quad, frames()[i].held ? 0 : frames()[i].size);
  }
  for (int l = 0; l < static_cast<int>(landmarks().size()); ++l) {
    add(eta(l), landmarks()[l].quad, IsInS(l) ? landmarks()[l].size : 0);
  }
  *max_norm = largest;
  *norm = std::sqrt(squared);
}

std::int64_t IncrementalSchur::Bytes() const {
  return static_cast<std::int64_t>(structure_.Bytes() + blocks_.Bytes()) + sums_.Bytes();
}

}  // namespace inceres::internal
