#include "incremental/incremental_schur.h"

#include <algorithm>
#include <cmath>
#include <utility>

namespace inceres::internal {
namespace {

// All rows are looked at when the cost has fallen by this.
constexpr double kCostDrop = 1e2;

}  // namespace

void IncrementalSchur::UpdateOffsets(std::int32_t first) {
  offsets_.resize(frames().size() + 1);
  for (std::size_t i = first; i < frames().size(); ++i) {
    offsets_[i + 1] = offsets_[i] + frames()[i].size;
    sums_.changes().TouchOffset(static_cast<std::int32_t>(i));
  }
}

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

void IncrementalSchur::HoldFrame(std::int32_t row, bool held) {
  structure_.HoldFrame(row, held);
  sums_.changes().Touch(row);
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
    blocks_.Displace(landmark);
  }
  factors_.Connect(ref);
}

void IncrementalSchur::Disconnect(FactorRef ref) {
  structure_.Disconnect(ref);
  if (structure_.LandmarkOfFactor(ref) >= 0) {
    blocks_.Displace(structure_.LandmarkOfFactor(ref));
  }
}

void IncrementalSchur::TakeOut(std::int32_t landmark) {
  if (IsInS(landmark)) {
    if (!rebuilding_) {
      contributions_.Add(landmark, 1.0);
    }
    num_pairs_ -= blocks_.NumPairs(landmark);
    blocks_.SetState(landmark, LandmarkState::kOutside);
  }
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
    if (bounds_ != nullptr) {
      bounds_->Hold(l.id, l.quad, sums_.vectors().rhs(l.quad));
    }
  }
  return blocks_.Invert(landmark, lambda, HeldAtBounds(l.quad));
}

void IncrementalSchur::LeaveOutside(std::int32_t landmark) {
  blocks_.SetState(landmark, landmarks()[landmark].held ? LandmarkState::kOutside
                                                        : LandmarkState::kUndetermined);
}

void IncrementalSchur::Eliminate(std::int32_t landmark) {
  blocks_.Place(landmark, [this](std::int32_t row, std::int32_t column) {
    return sums_.BlockOf(row, column);
  });
  blocks_.Eliminate(landmark, eta(landmark));
}

void IncrementalSchur::PutIn(std::int32_t landmark, double lambda) {
  if (!Invert(landmark, lambda)) {
    TakeOut(landmark);
    return LeaveOutside(landmark);
  }
  if (IsInS(landmark) && blocks_.SizeOfY(landmark) > 0) {
    contributions_.EliminateAnew(landmark, eta(landmark));
  } else {
    Eliminate(landmark);
    contributions_.Add(landmark, -1.0);
    num_pairs_ += IsInS(landmark) ? 0 : blocks_.NumPairs(landmark);
    blocks_.SetState(landmark, LandmarkState::kInS);
  }
  RenewGain(landmark);
}

void IncrementalSchur::PutIntoRows(std::int32_t landmark, double lambda, const IndexSet& rows) {
  if (!Invert(landmark, lambda)) {
    return LeaveOutside(landmark);
  }
  Eliminate(landmark);
  contributions_.AddWithin(landmark, -1.0, rows);
  blocks_.SetState(landmark, LandmarkState::kInRows);
}

void IncrementalSchur::TakeOutOfRows(std::int32_t landmark, const IndexSet& rows) {
  if (blocks_.state(landmark) == LandmarkState::kInRows) {
    contributions_.AddWithin(landmark, 1.0, rows);
    blocks_.SetState(landmark, LandmarkState::kOutside);
  }
}

void IncrementalSchur::RefreshResidual(std::int32_t landmark) {
  sums_.vectors().TakeChange(landmarks()[landmark].quad, landmarks()[landmark].size);
  if (IsInS(landmark)) {
    blocks_.RenewZ(landmark, eta(landmark), sums_.vectors().rhs());
    RenewGain(landmark);
  }
}

void IncrementalSchur::TakeChange(int frame) {
  sums_.vectors().TakeChange(frames()[frame].quad, frames()[frame].size);
  sums_.changes().TouchB(frame);
}

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
    drift_cost_ = cost;
  } else {
    sums_.changes().unchecked().ForEach(look_at);
    drift_cost_ = std::max(drift_cost_, cost);
  }
  for (const std::int32_t row : scratch_) {
    ResumFrame(row);
  }
  sums_.changes().ClearUnchecked();
  return static_cast<int>(scratch_.size());
}

void IncrementalSchur::ResumFrame(std::int32_t frame) {
  const Frame& f = frames()[frame];
  sums_.ZeroRow(frame, f.quad, f.size);
  const auto add_factor = [this, frame](const FactorRef& ref) {
    if (families_[ref.family].linearized(ref.factor)) {
      factors_.AddToRow(ref, frame);
    }
  };
  std::for_each(f.factors.begin(), f.factors.end(), add_factor);
  for (const std::int32_t landmark : f.landmarks) {
    structure_.ForEachFactorBetween(landmark, frame, add_factor);
    if (IsInS(landmark)) {
      contributions_.AddAcross(landmark, -1.0, frame);
    }
  }
  sums_.changes().Touch(frame);
}

void IncrementalSchur::Rebuild() {
  rebuilding_ = false;
  sums_.S().Zero();
  for (std::int32_t row = 0; row < static_cast<std::int32_t>(frames().size()); ++row) {
    if (frames()[row].id >= 0) {
      sums_.vectors().Zero(frames()[row].quad, frames()[row].size);
      sums_.changes().Touch(row);
    }
  }
  for (const IncrementalFamily& family : families_) {
    for (std::int32_t i = 0; i < family.num_places(); ++i) {
      if (family.linearized(i)) {
        factors_.Add({family.id(), i}, 1.0);
      }
    }
  }
  for (std::int32_t l = 0; l < static_cast<std::int32_t>(landmarks().size()); ++l) {
    if (IsInS(l)) {
      contributions_.Add(l, -1.0);
    }
  }
}

void IncrementalSchur::RenewGain(std::int32_t landmark) {
  const double* z = blocks_.z(landmark);
  const int size = IsInS(landmark) ? landmarks()[landmark].size : 0;
  double gain = 0.0;
  for (int k = 0; k < size; ++k) {
    gain += 0.5 * z[k] * z[k];
  }
  gains_.Set(landmark, gain);
}

void IncrementalSchur::RhsNorms(double* max_norm, double* norm) const {
  double largest = 0.0;
  double squared = 0.0;
  const auto add = [&](const double* rhs, std::int32_t quad, int size) {
    const char* held = HeldAtBounds(quad);
    for (int k = 0; k < size; ++k) {
      if (held != nullptr && held[k] != 0) {
        continue;
      }
      largest = std::max(largest, std::fabs(rhs[k]));
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
  const std::size_t bytes =
      structure_.Bytes() + blocks_.Bytes() + factors_.Bytes() + contributions_.Bytes();
  return static_cast<std::int64_t>(bytes) + sums_.Bytes();
}

}  // namespace inceres::internal
