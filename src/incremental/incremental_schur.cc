#include "incremental/incremental_schur.h"

#include <algorithm>
#include <cmath>
#include <utility>

namespace inceres::internal {
namespace {

// All rows are looked at when the cost has fallen by this.
constexpr double kCostDrop = 1e2;

// Parts of S, for AddPart: the blocks between some rows, and those of one row with all others.
auto Within(const IndexSet& rows) {
  return [&rows](std::int32_t r) {
    return [&rows, in = rows.Has(r)](std::int32_t c) { return in && rows.Has(c); };
  };
}

auto AcrossRow(std::int32_t row) {
  return [row](std::int32_t r) {
    return [row, in = r == row](std::int32_t c) { return in || c == row; };
  };
}

}  // namespace

void IncrementalSchur::UpdateOffsets(std::int32_t first) {
  offsets_.resize(frames().size() + 1);
  for (std::size_t i = first; i < frames().size(); ++i) {
    offsets_[i + 1] = offsets_[i] + frames()[i].size;
    changes_.TouchOffset(static_cast<std::int32_t>(i));
  }
}

int IncrementalSchur::AddFrame(VariableId id, std::int32_t quad, int size) {
  const std::int32_t row = structure_.AddFrame(id, quad, size);
  if (row < S_.num_rows()) {
    S_.ReviveRow(row, size);
  } else {
    S_.AddRow(size);
    changes_.Grow(frames().size());
  }
  UpdateOffsets(row);
  vectors_.MakeRoom(quad, size);
  changes_.Touch(row);
  return row;
}

void IncrementalSchur::RemoveFrame(std::int32_t row) {
  S_.RemoveRow(row);
  structure_.RemoveFrame(row);
  UpdateOffsets(row);
  changes_.Touch(row);
}

void IncrementalSchur::HoldFrame(std::int32_t row, bool held) {
  structure_.HoldFrame(row, held);
  changes_.Touch(row);
}

int IncrementalSchur::AddLandmark(VariableId id, std::int32_t quad, int size) {
  const std::int32_t index = structure_.AddLandmark(id, quad, size);
  blocks_.Grow();
  gains_.Grow(landmarks().size());
  vectors_.MakeRoom(quad, size);
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
  const IncrementalFamily& family = families_[ref.family];
  const std::size_t num_pairs =
      static_cast<std::size_t>(family.num_slots()) * (family.num_slots() + 1) / 2;
  factor_blocks_.resize(families_.size());
  std::vector<std::int32_t>& blocks = factor_blocks_[ref.family];
  if (blocks.size() < family.num_places() * num_pairs) {
    blocks.resize(family.num_places() * num_pairs, -1);
  }
  blocks[ref.factor * num_pairs] = -1;
}

void IncrementalSchur::Disconnect(FactorRef ref) {
  structure_.Disconnect(ref);
  if (structure_.LandmarkOfFactor(ref) >= 0) {
    blocks_.Displace(structure_.LandmarkOfFactor(ref));
  }
}

// The frames of a factor with their Jacobians, ascending, into rows_ and rows_of_.
Contribution IncrementalSchur::RowsOfFactor(FactorRef ref) {
  const IncrementalFamily& family = families_[ref.family];
  rows_.clear();
  rows_of_.clear();
  for (int s = 0; s < family.num_slots(); ++s) {
    const std::int32_t row = structure_.FrameOfFactor(ref, s);
    if (row < 0) {
      continue;
    }
    const Frame& frame = frames()[row];
    rows_of_.push_back(row);
    rows_.push_back(
        {family.Jacobian(ref.factor, s), frame.quad, PadToQuad(frame.size) / kQuad, frame.size});
    for (std::size_t k = rows_.size() - 1; k > 0 && rows_of_[k - 1] > row; --k) {
      std::swap(rows_of_[k - 1], rows_of_[k]);
      std::swap(rows_[k - 1], rows_[k]);
    }
  }
  return {rows_.data(), static_cast<int>(rows_.size()), family.residual_size()};
}

// Where the factor's products go. A block of S stays where it is while its frames do.
const std::int32_t* IncrementalSchur::BlocksOfFactor(FactorRef ref) {
  const int num_slots = families_[ref.family].num_slots();
  const int num_pairs = num_slots * (num_slots + 1) / 2;
  std::int32_t* blocks = factor_blocks_[ref.family].data() + std::ptrdiff_t{ref.factor} * num_pairs;
  if (blocks[0] < 0) {
    for (std::size_t r = 0, at = 0; r < rows_of_.size(); ++r) {
      for (std::size_t c = 0; c <= r; ++c, ++at) {
        blocks[at] = BlockOf(rows_of_[r], rows_of_[c]);
      }
    }
  }
  return blocks;
}

// The frame part of a factor's share, in place of the one with q_out if there is one.
void IncrementalSchur::AddRows(const Contribution& contribution, const double* q,
                               const double* q_out, double sign, const std::int32_t* blocks) {
  kernels_.add_outer(contribution, sign, blocks, S_.values(0));
  kernels_.add_transposed(contribution, q, q_out, -sign, vectors_.rhs(), vectors_.b_peak());
  kernels_.add_squares(contribution, sign, vectors_.diagonal(), vectors_.diagonal_peak());
  std::for_each(rows_of_.begin(), rows_of_.end(),
                [this](std::int32_t row) { changes_.Touch(row); });
}

void IncrementalSchur::AddFactor(FactorRef ref, double sign) {
  const Contribution contribution = RowsOfFactor(ref);
  if (contribution.count > 0) {
    const std::int32_t* blocks = BlocksOfFactor(ref);  // S may grow
    AddRows(contribution, families_[ref.family].q(ref.factor), nullptr, sign, blocks);
  }
}

double* IncrementalSchur::KeepRoom(std::ptrdiff_t count) {
  if (num_kept_ + count > static_cast<std::ptrdiff_t>(kept_.size())) {
    kept_.resize(static_cast<std::size_t>(2 * (num_kept_ + count)));
  }
  double* room = kept_.data() + num_kept_;
  num_kept_ += PadToQuad(static_cast<int>(count));
  return room;
}

std::ptrdiff_t IncrementalSchur::KeepFactor(FactorRef ref) {
  const std::ptrdiff_t kept = num_kept_;
  const Contribution contribution = RowsOfFactor(ref);
  const auto size_of = [&](const BlockRow& row) {
    return std::ptrdiff_t{contribution.depth} * row.quads * kQuad;
  };
  for (const BlockRow& row : rows_) {
    std::copy_n(row.A, size_of(row), KeepRoom(size_of(row)));
  }
  std::copy_n(families_[ref.family].q(ref.factor), contribution.depth,
              KeepRoom(contribution.depth));
  return kept;
}

void IncrementalSchur::ReplaceFactor(FactorRef ref, std::ptrdiff_t kept) {
  Contribution contribution = RowsOfFactor(ref);
  if (contribution.count == 0) {
    return;
  }
  const double* out = kept_.data() + kept;
  for (BlockRow& row : rows_) {
    row.out = out;
    out += std::ptrdiff_t{contribution.depth} * row.quads * kQuad;
  }
  contribution.replaces = true;
  AddRows(contribution, families_[ref.family].q(ref.factor), out, 1.0, BlocksOfFactor(ref));
}

void IncrementalSchur::AddFactorToRow(FactorRef ref, std::int32_t only) {
  const Contribution contribution = RowsOfFactor(ref);
  targets_.clear();
  for (int r = 0; r < contribution.count; ++r) {
    for (int c = 0; c <= r; ++c) {
      const bool left_out = rows_of_[r] != only && rows_of_[c] != only;
      targets_.push_back(left_out ? -1 : BlockOf(rows_of_[r], rows_of_[c]));
    }
    changes_.Touch(rows_of_[r]);
  }
  kernels_.add_outer(contribution, 1.0, targets_.data(), S_.values(0));
  const double* q = families_[ref.family].q(ref.factor);
  for (int r = 0; r < contribution.count; ++r) {
    if (rows_of_[r] == only) {
      const Contribution row{contribution.rows + r, 1, contribution.depth};
      kernels_.add_transposed(row, q, nullptr, -1.0, vectors_.rhs(), vectors_.b_peak());
      kernels_.add_squares(row, 1.0, vectors_.diagonal(), vectors_.diagonal_peak());
    }
  }
}

void IncrementalSchur::AddContribution(std::int32_t landmark, double sign) {
  const Contribution contribution = blocks_.Rows(landmark, &rows_);
  kernels_.add_outer(contribution, sign, blocks_.Targets(landmark).data(), S_.values(0));
  kernels_.add_transposed(contribution, blocks_.z(landmark), nullptr, sign, vectors_.rhs(),
                          vectors_.b_peak());
  for (int r = 0; r < contribution.count; ++r) {
    changes_.Touch(landmarks()[landmark].frames[r]);
  }
}

// The landmark's contribution in place of that of Y_out, laid out as Y, and z_out.
void IncrementalSchur::ReplaceContribution(std::int32_t landmark, const double* Y_out,
                                           const double* z_out) {
  Contribution contribution = blocks_.Rows(landmark, &rows_);
  const double* Y = blocks_.Y(landmark);
  for (BlockRow& row : rows_) {
    row.out = Y_out + (row.A - Y);
  }
  contribution.replaces = true;
  kernels_.add_outer(contribution, -1.0, blocks_.Targets(landmark).data(), S_.values(0));
  kernels_.add_transposed(contribution, blocks_.z(landmark), z_out, -1.0, vectors_.rhs(),
                          vectors_.b_peak());
  for (const std::int32_t frame : landmarks()[landmark].frames) {
    changes_.Touch(frame);
  }
}

template <typename Part>
void IncrementalSchur::AddPart(std::int32_t landmark, double sign, const Part& part) {
  const Contribution contribution = blocks_.Rows(landmark, &rows_);
  const std::vector<std::int32_t>& frames = landmarks()[landmark].frames;
  targets_ = blocks_.Targets(landmark);
  std::size_t at = 0;
  for (int r = 0; r < contribution.count; ++r) {
    const auto is_in = part(frames[r]);
    for (int c = 0; c <= r; ++c, ++at) {
      targets_[at] = is_in(frames[c]) ? targets_[at] : -1;
    }
    if (is_in(frames[r])) {
      kernels_.add_transposed({contribution.rows + r, 1, contribution.depth}, blocks_.z(landmark),
                              nullptr, sign, vectors_.rhs(), vectors_.b_peak());
      changes_.Touch(frames[r]);
    }
  }
  kernels_.add_outer(contribution, sign, targets_.data(), S_.values(0));
}

void IncrementalSchur::TakeOut(std::int32_t landmark) {
  if (IsInS(landmark)) {
    if (!rebuilding_) {
      AddContribution(landmark, 1.0);
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
    vectors_.DropChange(l.quad, l.size);
    blocks_.Sum(landmark, vectors_.rhs(l.quad));
    if (bounds_ != nullptr) {
      bounds_->Hold(l.id, l.quad, vectors_.rhs(l.quad));
    }
  }
  return blocks_.Invert(landmark, lambda, HeldAtBounds(l.quad));
}

void IncrementalSchur::LeaveOutside(std::int32_t landmark) {
  blocks_.SetState(landmark, landmarks()[landmark].held ? LandmarkState::kOutside
                                                        : LandmarkState::kUndetermined);
}

void IncrementalSchur::Eliminate(std::int32_t landmark) {
  blocks_.Place(landmark,
                [this](std::int32_t row, std::int32_t column) { return BlockOf(row, column); });
  blocks_.Eliminate(landmark, eta(landmark));
}

void IncrementalSchur::PutIn(std::int32_t landmark, double lambda) {
  if (!Invert(landmark, lambda)) {
    TakeOut(landmark);
    return LeaveOutside(landmark);
  }
  if (IsInS(landmark) && blocks_.SizeOfY(landmark) > 0) {
    double z_out[kQuad];
    std::copy_n(blocks_.z(landmark), kQuad, z_out);
    double* Y_out = KeepRoom(blocks_.SizeOfY(landmark));
    std::copy_n(blocks_.Y(landmark), blocks_.SizeOfY(landmark), Y_out);
    blocks_.Eliminate(landmark, eta(landmark));
    ReplaceContribution(landmark, Y_out, z_out);
    DropKept();
  } else {
    Eliminate(landmark);
    AddContribution(landmark, -1.0);
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
  AddPart(landmark, -1.0, Within(rows));
  blocks_.SetState(landmark, LandmarkState::kInRows);
}

void IncrementalSchur::TakeOutOfRows(std::int32_t landmark, const IndexSet& rows) {
  if (blocks_.state(landmark) == LandmarkState::kInRows) {
    AddPart(landmark, 1.0, Within(rows));
    blocks_.SetState(landmark, LandmarkState::kOutside);
  }
}

void IncrementalSchur::RefreshResidual(std::int32_t landmark) {
  vectors_.TakeChange(landmarks()[landmark].quad, landmarks()[landmark].size);
  if (IsInS(landmark)) {
    blocks_.RenewZ(landmark, eta(landmark), vectors_.rhs());
    RenewGain(landmark);
  }
}

void IncrementalSchur::TakeChange(int frame) {
  vectors_.TakeChange(frames()[frame].quad, frames()[frame].size);
  changes_.TouchB(frame);
}

int IncrementalSchur::ResumDrifted(double cost) {
  scratch_.clear();
  const auto look_at = [this, cost](std::int32_t row) {
    if (vectors_.HasDrifted(frames()[row].quad, frames()[row].size, cost)) {
      scratch_.push_back(row);
    }
  };
  if (kCostDrop * cost < drift_cost_) {
    for (std::int32_t row = 0; row < static_cast<std::int32_t>(frames().size()); ++row) {
      look_at(row);
    }
    drift_cost_ = cost;
  } else {
    changes_.unchecked().ForEach(look_at);
    drift_cost_ = std::max(drift_cost_, cost);
  }
  for (const std::int32_t row : scratch_) {
    ResumFrame(row);
  }
  changes_.ClearUnchecked();
  return static_cast<int>(scratch_.size());
}

void IncrementalSchur::ResumFrame(std::int32_t frame) {
  const Frame& f = frames()[frame];
  S_.ZeroRow(frame);
  vectors_.Zero(f.quad, f.size);
  const auto add_factor = [this, frame](const FactorRef& ref) {
    if (families_[ref.family].linearized(ref.factor)) {
      AddFactorToRow(ref, frame);
    }
  };
  std::for_each(f.factors.begin(), f.factors.end(), add_factor);
  for (const std::int32_t landmark : f.landmarks) {
    structure_.ForEachFactorBetween(landmark, frame, add_factor);
    if (IsInS(landmark)) {
      AddPart(landmark, -1.0, AcrossRow(frame));
      std::for_each(landmarks()[landmark].frames.begin(), landmarks()[landmark].frames.end(),
                    [this](std::int32_t row) { changes_.Touch(row); });
    }
  }
  changes_.Touch(frame);
}

void IncrementalSchur::Rebuild() {
  rebuilding_ = false;
  S_.Zero();
  for (std::int32_t row = 0; row < static_cast<std::int32_t>(frames().size()); ++row) {
    if (frames()[row].id >= 0) {
      vectors_.Zero(frames()[row].quad, frames()[row].size);
      changes_.Touch(row);
    }
  }
  for (const IncrementalFamily& family : families_) {
    for (std::int32_t i = 0; i < family.num_places(); ++i) {
      if (family.linearized(i)) {
        AddFactor({family.id(), i}, 1.0);
      }
    }
  }
  for (std::int32_t l = 0; l < static_cast<std::int32_t>(landmarks().size()); ++l) {
    if (IsInS(l)) {
      AddContribution(l, -1.0);
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
  std::size_t bytes =
      vectors_.Bytes() + sizeof(double) * kept_.capacity() + structure_.Bytes() + blocks_.Bytes();
  for (const std::vector<std::int32_t>& blocks : factor_blocks_) {
    bytes += blocks.capacity() * sizeof(std::int32_t);
  }
  return static_cast<std::int64_t>(bytes) + S_.Bytes();
}

}  // namespace inceres::internal
