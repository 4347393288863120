#include "incremental/incremental_schur.h"

#include <algorithm>
#include <cmath>
#include <limits>
#include <numeric>
#include <utility>

#include "linear/small_cholesky.h"

namespace inceres::internal {
namespace {

// A landmark whose block is this singular against the scale of its coordinates carries no information (docs/algorithms.md,
// "Incremental Schur complement"): it is undetermined.
constexpr double kNoInformation = 1e-12;

// How far a diagonal entry of C may fall below its peak before its row is summed anew. Rounding leaves about ε √(peak_i peak_j)
// in S_ij, which is to stay below 1e-10 √(C_ii C_jj).
constexpr double kDriftRatio = 1e4;

// All rows are looked at when the cost has fallen by this.
constexpr double kCostDrop = 1e2;

}  // namespace

// The frames of a factor with their Jacobians, ascending, into rows_ and rows_of_.
Contribution IncrementalSchur::RowsOfFactor(FactorRef ref) {
  const IncrementalFamily& family = families_[ref.family];
  rows_.clear();
  rows_of_.clear();
  for (int s = 0; s < family.num_slots(); ++s) {
    const std::int32_t row = FrameOfFactor(ref, s);
    if (row < 0) {
      continue;
    }
    const Frame& frame = frames_[row];
    rows_of_.push_back(row);
    rows_.push_back({family.Jacobian(ref.factor, s), frame.quad, PadToQuad(frame.size) / kQuad, frame.size});
    for (std::size_t k = rows_.size() - 1; k > 0 && rows_of_[k - 1] > row; --k) {
      std::swap(rows_of_[k - 1], rows_of_[k]);
      std::swap(rows_[k - 1], rows_[k]);
    }
  }
  return {rows_.data(), static_cast<int>(rows_.size()), family.residual_size()};
}

// New factors may have brought new frames since: the contribution is that of the incidences, the frames it went in with.
Contribution IncrementalSchur::RowsOfLandmark(const Landmark& landmark) {
  rows_.clear();
  for (std::size_t r = 0; r < landmark.incidences.size(); ++r) {
    const Incidence& incidence = landmark.incidences[r];
    rows_.push_back(
        {Y_.data() + std::ptrdiff_t{incidence.y} * kQuad, incidence.frame, incidence.quads, frames_[landmark.frames[r]].size});
  }
  return {rows_.data(), static_cast<int>(rows_.size()), landmark.size};
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
void IncrementalSchur::AddRows(const Contribution& contribution, const double* q, const double* q_out, double sign,
                               const std::int32_t* blocks) {
  kernels_.add_outer(contribution, sign, blocks, S_.values(0));
  kernels_.add_transposed(contribution, q, q_out, -sign, rhs_.data(), b_peak_.data());
  kernels_.add_squares(contribution, sign, C_diagonal_.data(), C_peak_.data());
  std::for_each(rows_of_.begin(), rows_of_.end(), [this](std::int32_t row) { Touch(row); });
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
  const auto size_of = [&](const BlockRow& row) { return std::ptrdiff_t{contribution.depth} * row.quads * kQuad; };
  for (const BlockRow& row : rows_) {
    std::copy_n(row.A, size_of(row), KeepRoom(size_of(row)));
  }
  std::copy_n(families_[ref.family].q(ref.factor), contribution.depth, KeepRoom(contribution.depth));
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
  blocks_.clear();
  for (int r = 0; r < contribution.count; ++r) {
    for (int c = 0; c <= r; ++c) {
      const bool left_out = rows_of_[r] != only && rows_of_[c] != only;
      blocks_.push_back(left_out ? -1 : BlockOf(rows_of_[r], rows_of_[c]));
    }
    Touch(rows_of_[r]);
  }
  kernels_.add_outer(contribution, 1.0, blocks_.data(), S_.values(0));
  const double* q = families_[ref.family].q(ref.factor);
  for (int r = 0; r < contribution.count; ++r) {
    if (rows_of_[r] == only) {
      const Contribution row{contribution.rows + r, 1, contribution.depth};
      kernels_.add_transposed(row, q, nullptr, -1.0, rhs_.data(), b_peak_.data());
      kernels_.add_squares(row, 1.0, C_diagonal_.data(), C_peak_.data());
    }
  }
}

void IncrementalSchur::AddContribution(const Landmark& landmark, double sign) {
  const Contribution contribution = RowsOfLandmark(landmark);
  kernels_.add_outer(contribution, sign, landmark.blocks.data(), S_.values(0));
  kernels_.add_transposed(contribution, landmark.z, nullptr, sign, rhs_.data(), b_peak_.data());
  for (int r = 0; r < contribution.count; ++r) {
    Touch(landmark.frames[r]);
  }
}

// The landmark's contribution in place of that of Y_out, laid out as Y, and z_out.
void IncrementalSchur::ReplaceContribution(const Landmark& landmark, const double* Y_out, const double* z_out) {
  Contribution contribution = RowsOfLandmark(landmark);
  const double* Y = Y_.data() + std::ptrdiff_t{landmark.incidences.front().y} * kQuad;
  for (BlockRow& row : rows_) {
    row.out = Y_out + (row.A - Y);
  }
  contribution.replaces = true;
  kernels_.add_outer(contribution, -1.0, landmark.blocks.data(), S_.values(0));
  kernels_.add_transposed(contribution, landmark.z, z_out, -1.0, rhs_.data(), b_peak_.data());
  for (const std::int32_t frame : landmark.frames) {
    Touch(frame);
  }
}

void IncrementalSchur::SubtractLandmarkFromRow(const Landmark& landmark, std::int32_t only) {
  const Contribution contribution = RowsOfLandmark(landmark);
  blocks_.assign(landmark.blocks.begin(), landmark.blocks.end());
  std::size_t at = 0;
  for (int r = 0; r < contribution.count; ++r) {
    for (int c = 0; c <= r; ++c, ++at) {
      blocks_[at] = landmark.frames[r] == only || landmark.frames[c] == only ? blocks_[at] : -1;
    }
    if (landmark.frames[r] == only) {
      kernels_.add_transposed({contribution.rows + r, 1, contribution.depth}, landmark.z, nullptr, -1.0, rhs_.data(),
                              b_peak_.data());
    }
    Touch(landmark.frames[r]);
  }
  kernels_.add_outer(contribution, -1.0, blocks_.data(), S_.values(0));
}

void IncrementalSchur::TakeOut(std::int32_t landmark) {
  Landmark& l = landmarks_[landmark];
  if (l.in_S && !rebuilding_) {
    AddContribution(l, 1.0);
  }
  num_pairs_ -= l.in_S ? NumPairs(landmark) : 0;
  l.in_S = false;
  RenewDecrement(landmark);
}

// P, η and U_inv anew; false of a landmark that is held or has no information.
bool IncrementalSchur::InvertDamped(std::int32_t landmark, double lambda) {
  Landmark& l = landmarks_[landmark];
  num_undetermined_ -= l.undetermined ? 1 : 0;
  l.undetermined = false;
  l.lambda = lambda;
  if (lambda > kMildDamping) {
    heavily_damped_.Add(landmark);
  } else {
    heavily_damped_.Remove(landmark);
  }
  if (l.held) {
    return false;
  }
  SumLandmark(&l);
  double damping[4];
  double largest = 0.0;
  for (int k = 0; k < l.size; ++k) {
    damping[k] = lambda * l.P[k * kQuad + k];
    largest = std::max(largest, l.P[k * kQuad + k]);
  }
  l.undetermined = !(largest > 0.0) || !InvertCholeskyFactor(l.size, l.P, damping, l.U_inv);
  for (int k = 0; k < l.size && !l.undetermined; ++k) {
    // 1/U_inv² is the pivot: what the other coordinates leave of the diagonal entry.
    const double pivot = 1.0 / (l.U_inv[k * kQuad + k] * l.U_inv[k * kQuad + k]);
    l.undetermined = pivot < kNoInformation * l.P[k * kQuad + k];
  }
  num_undetermined_ += l.undetermined ? 1 : 0;
  return !l.undetermined;
}

void IncrementalSchur::PutIn(std::int32_t landmark, double lambda) {
  Landmark& l = landmarks_[landmark];
  if (!InvertDamped(landmark, lambda)) {
    return TakeOut(landmark);
  }
  if (l.in_S && l.y_quads > 0) {
    double z_out[kQuad];
    std::copy_n(l.z, kQuad, z_out);
    const std::ptrdiff_t size = std::ptrdiff_t{l.y_quads} * kQuad;
    double* Y_out = KeepRoom(size);
    std::copy_n(Y_.data() + std::ptrdiff_t{l.incidences.front().y} * kQuad, size, Y_out);
    EliminateLandmark(&l);
    ReplaceContribution(l, Y_out, z_out);
    DropKept();
  } else {
    PlaceBlocks(landmark);
    EliminateLandmark(&l);
    AddContribution(l, -1.0);
    num_pairs_ += l.in_S ? 0 : NumPairs(landmark);
    l.in_S = true;
  }
  RenewDecrement(landmark);
}

void IncrementalSchur::PutIntoRows(std::int32_t landmark, double lambda, const IndexSet& rows) {
  Landmark& l = landmarks_[landmark];
  if (InvertDamped(landmark, lambda)) {
    PlaceBlocks(landmark);
    EliminateLandmark(&l);
    AddToRows(l, -1.0, rows);
    l.partly = true;
  }
}

void IncrementalSchur::TakeOutOfRows(std::int32_t landmark, const IndexSet& rows) {
  Landmark& l = landmarks_[landmark];
  if (std::exchange(l.partly, false)) {
    AddToRows(l, 1.0, rows);
  }
}

void IncrementalSchur::AddToRows(const Landmark& landmark, double sign, const IndexSet& rows) {
  const Contribution contribution = RowsOfLandmark(landmark);
  blocks_.assign(landmark.blocks.begin(), landmark.blocks.end());
  std::size_t at = 0;
  for (int r = 0; r < contribution.count; ++r) {
    const bool in = rows.Has(landmark.frames[r]);
    for (int c = 0; c <= r; ++c, ++at) {
      blocks_[at] = in && rows.Has(landmark.frames[c]) ? blocks_[at] : -1;
    }
    if (in) {
      kernels_.add_transposed({contribution.rows + r, 1, contribution.depth}, landmark.z, nullptr, sign, rhs_.data(),
                              b_peak_.data());
      Touch(landmark.frames[r]);
    }
  }
  kernels_.add_outer(contribution, sign, blocks_.data(), S_.values(0));
}

void IncrementalSchur::RefreshResidual(std::int32_t landmark) {
  Landmark& l = landmarks_[landmark];
  AddChange(l.quad, l.size);
  if (!l.in_S) {
    return;
  }
  double z[kQuad];
  MultiplyLower(l.size, l.U_inv, eta(landmark), z);
  double change[kQuad];
  for (int k = 0; k < l.size; ++k) {
    change[k] = z[k] - l.z[k];
    l.z[k] = z[k];
  }
  kernels_.subtract_incidences(l.size, l.incidences.data(), static_cast<int>(l.incidences.size()), Y_.data(), change,
                               rhs_.data());
  RenewDecrement(landmark);
}

void IncrementalSchur::AddChange(std::int32_t quad, int size) {
  double* change = rhs_change_.data() + std::ptrdiff_t{quad} * kQuad;
  double* rhs = Rhs(quad);
  for (int k = 0; k < size; ++k) {
    rhs[k] += change[k];
    change[k] = 0.0;
  }
}

void IncrementalSchur::TakeChange(int frame) {
  AddChange(frames_[frame].quad, frames_[frame].size);
  TouchB(frame);
}

bool IncrementalSchur::HasDrifted(std::int32_t row, double cost) {
  const Frame& frame = frames_[row];
  for (std::ptrdiff_t k = std::ptrdiff_t{frame.quad} * kQuad; k < std::ptrdiff_t{frame.quad} * kQuad + frame.size; ++k) {
    if (C_peak_[k] > kDriftRatio * C_diagonal_[k] || b_peak_[k] > kDriftRatio * std::sqrt(2.0 * cost * C_diagonal_[k])) {
      return true;
    }
  }
  return false;
}

// What accepted steps change goes to b directly.
void IncrementalSchur::SampleB(std::int32_t row) {
  const Frame& frame = frames_[row];
  for (std::ptrdiff_t k = std::ptrdiff_t{frame.quad} * kQuad; k < std::ptrdiff_t{frame.quad} * kQuad + frame.size; ++k) {
    b_peak_[k] = std::max(b_peak_[k], std::fabs(rhs_[k]));
  }
}

int IncrementalSchur::ResumDrifted(double cost) {
  scratch_.clear();
  const auto look_at = [this, cost](std::int32_t row) {
    if (frames_[row].id >= 0) {
      SampleB(row);
    }
    if (HasDrifted(row, cost)) {
      scratch_.push_back(row);
    }
  };
  if (kCostDrop * cost < drift_cost_) {
    for (std::int32_t row = 0; row < static_cast<std::int32_t>(frames_.size()); ++row) {
      look_at(row);
    }
    drift_cost_ = cost;
  } else {
    touched_.ForEach(look_at);
    drift_cost_ = std::max(drift_cost_, cost);
  }
  for (const std::int32_t row : scratch_) {
    ResumFrame(row);
  }
  touched_.Clear();
  return static_cast<int>(scratch_.size());
}

void IncrementalSchur::ZeroVectors(const Frame& frame) {
  for (AlignedVector<double>* padded : {&rhs_, &C_diagonal_, &C_peak_, &b_peak_}) {
    std::fill_n(padded->begin() + std::ptrdiff_t{frame.quad} * kQuad, PadToQuad(frame.size), 0.0);
  }
}

void IncrementalSchur::ResumFrame(std::int32_t frame) {
  const Frame& f = frames_[frame];
  S_.ZeroRow(frame);
  ZeroVectors(f);
  const auto add_factor = [this, frame](const FactorRef& ref) {
    if (families_[ref.family].linearized(ref.factor)) {
      AddFactorToRow(ref, frame);
    }
  };
  std::for_each(f.factors.begin(), f.factors.end(), add_factor);
  for (const std::int32_t landmark : f.landmarks) {
    ForEachFactorBetween(landmark, frame, add_factor);
    if (landmarks_[landmark].in_S) {
      SubtractLandmarkFromRow(landmarks_[landmark], frame);
    }
  }
  Touch(frame);
}

void IncrementalSchur::Rebuild() {
  rebuilding_ = false;
  S_.Zero();
  for (std::int32_t row = 0; row < static_cast<std::int32_t>(frames_.size()); ++row) {
    if (frames_[row].id >= 0) {
      ZeroVectors(frames_[row]);
      Touch(row);
    }
  }
  for (const IncrementalFamily& family : families_) {
    for (std::int32_t i = 0; i < family.num_places(); ++i) {
      if (family.linearized(i)) {
        AddFactor({family.id(), i}, 1.0);
      }
    }
  }
  for (const Landmark& landmark : landmarks_) {
    if (landmark.in_S) {
      AddContribution(landmark, -1.0);
    }
  }
}

// By block row, as the lower triangle of S asks for.
void IncrementalSchur::SortFrames(Landmark* landmark) {
  std::vector<std::int32_t>& frames = landmark->frames;
  for (std::size_t i = 1; i < frames.size(); ++i) {
    for (std::size_t k = i; k > 0 && frames[k - 1] > frames[k]; --k) {
      std::swap(frames[k - 1], frames[k]);
      std::swap(landmark->places[k - 1], landmark->places[k]);
    }
  }
}

void IncrementalSchur::PlaceBlocks(std::int32_t landmark) {
  Landmark& l = landmarks_[landmark];
  if (l.placed) {
    return;
  }
  ReleaseBlocks(&l);
  SortFrames(&l);
  l.placed = true;
  for (const std::int32_t frame : l.frames) {
    const auto quads = static_cast<std::int32_t>(PadToQuad(frames_[frame].size) / kQuad);
    Append(&l.incidences, {l.y_quads, frames_[frame].quad, quads});
    l.y_quads += quads * l.size;
  }
  const std::int32_t base = AllocateY(l.y_quads);
  for (Incidence& incidence : l.incidences) {
    incidence.y += base;
  }
  for (std::size_t r = 0; r < l.frames.size(); ++r) {
    for (std::size_t c = 0; c <= r; ++c) {
      Append(&l.blocks, BlockOf(l.frames[r], l.frames[c]));
    }
  }
  // The first factor that reaches a block sets it, later ones add to it: an odd target.
  std::vector<std::int32_t>& begun = scratch_;
  begun.assign(l.frames.size(), 0);
  for (const FactorRef& ref : l.factors) {
    std::int32_t* targets = families_[ref.family].y_targets() + Slot(ref, 0);
    for (int s = 0; s < families_[ref.family].num_slots(); ++s) {
      const std::int32_t frame = FrameOfFactor(ref, s);
      if (frame < 0) {
        continue;
      }
      const auto at = std::find(l.frames.begin(), l.frames.end(), frame) - l.frames.begin();
      targets[s] = 2 * l.incidences[at].y + begun[at];
      begun[at] = 1;
    }
  }
}

void IncrementalSchur::ReleaseBlocks(Landmark* landmark) {
  if (landmark->y_quads > 0) {
    free_y_.resize(std::max(free_y_.size(), static_cast<std::size_t>(landmark->y_quads) + 1));
    free_y_[landmark->y_quads].push_back(landmark->incidences.front().y);
  }
  landmark->incidences.clear();
  landmark->blocks.clear();
  landmark->y_quads = 0;
  landmark->placed = false;
}

LandmarkFactors IncrementalSchur::FactorsOf(const FactorRef& ref) const {
  IncrementalFamily& family = families_[ref.family];
  LandmarkFactors factors;
  factors.factors = &ref.factor;
  factors.count = 1;
  factors.residual_size = family.residual_size();
  factors.num_slots = family.num_slots();
  factors.jacobians = family.slots();
  factors.residuals = family.q_data();
  factors.y_targets = family.y_targets();
  factors.landmark_slot = landmark_slot_[ref.family][ref.factor];
  return factors;
}

void IncrementalSchur::SumLandmark(Landmark* landmark) {
  std::fill_n(landmark->P, 4 * kQuad, 0.0);
  double eta[kQuad] = {0.0, 0.0, 0.0, 0.0};
  for (const FactorRef& ref : landmark->factors) {
    kernels_.landmark_gram(landmark->size, FactorsOf(ref), landmark->P, eta);
  }
  std::copy_n(eta, kQuad, Rhs(landmark->quad));
  // A factor of two landmarks belongs to one and writes changes to both: those to the other, held one are nobody's.
  ZeroChange(landmark->quad, landmark->size);
}

void IncrementalSchur::EliminateLandmark(Landmark* landmark) {
  for (const FactorRef& ref : landmark->factors) {
    kernels_.eliminate(landmark->size, FactorsOf(ref), landmark->U_inv, Y_.data());
  }
  MultiplyLower(landmark->size, landmark->U_inv, Rhs(landmark->quad), landmark->z);
}

void IncrementalSchur::BackSubstitute(std::int32_t landmark, double* padded_step) const {
  const Landmark& l = landmarks_[landmark];
  double* step = padded_step + std::ptrdiff_t{l.quad} * kQuad;
  if (!l.in_S && !l.partly) {
    std::fill_n(step, l.size, 0.0);
    return;
  }
  double y[kQuad];
  std::copy_n(l.z, kQuad, y);
  kernels_.back_substitute(l.size, l.incidences.data(), static_cast<int>(l.incidences.size()), Y_.data(), padded_step, y);
  MultiplyLowerTransposed(l.size, l.U_inv, y, step);
}

void IncrementalSchur::RenewDecrement(std::int32_t landmark) {
  Landmark& l = landmarks_[landmark];
  double decrement = 0.0;
  for (int k = 0; k < l.size && l.in_S; ++k) {
    decrement += 0.5 * l.z[k] * l.z[k];
  }
  total_decrement_ += decrement - decrements_[landmark];
  decrement_error_ += std::numeric_limits<double>::epsilon() * (std::fabs(total_decrement_) + decrement + decrements_[landmark]);
  decrements_[landmark] = decrement;
  if (decrement > eager_threshold_) {
    eager_.Add(landmark);
  }
}

void IncrementalSchur::RhsNorms(double* max_norm, double* norm) const {
  double largest = 0.0;
  double squared = 0.0;
  const auto add = [&](const double* rhs, int size) {
    for (int k = 0; k < size; ++k) {
      largest = std::max(largest, std::fabs(rhs[k]));
      squared += rhs[k] * rhs[k];
    }
  };
  for (int i = 0; i < static_cast<int>(frames_.size()); ++i) {
    add(b(i), frames_[i].held ? 0 : frames_[i].size);
  }
  for (int l = 0; l < static_cast<int>(landmarks_.size()); ++l) {
    add(eta(l), landmarks_[l].in_S ? landmarks_[l].size : 0);
  }
  *max_norm = largest;
  *norm = std::sqrt(squared);
}

double IncrementalSchur::TotalDecrement(double accuracy) {
  if (decrement_error_ > accuracy) {
    decrement_error_ = 0.0;
    total_decrement_ = std::accumulate(decrements_.begin(), decrements_.end(), 0.0);
  }
  return std::max(0.0, total_decrement_);
}

const std::vector<std::int32_t>& IncrementalSchur::EagerLandmarks(double threshold) {
  if (threshold < eager_threshold_) {
    eager_threshold_ = 0.1 * threshold;  // room to fall before all landmarks must be looked at again
    for (std::int32_t i = 0; i < static_cast<std::int32_t>(landmarks_.size()); ++i) {
      if (decrements_[i] > eager_threshold_) {
        eager_.Add(i);
      }
    }
  } else if (threshold > 100.0 * eager_threshold_) {
    eager_threshold_ = 0.1 * threshold;
  }
  eager_list_.clear();
  scratch_.clear();
  eager_.ForEach([&](std::int32_t i) { (decrements_[i] > threshold ? eager_list_ : scratch_).push_back(i); });
  for (const std::int32_t i : scratch_) {
    if (decrements_[i] <= eager_threshold_) {
      eager_.Remove(i);
    }
  }
  return eager_list_;
}

std::int64_t IncrementalSchur::NumPairs(std::int32_t landmark) const {
  const auto n = static_cast<std::int64_t>(landmarks_[landmark].incidences.size());
  return n * (n + 1) / 2;
}

std::int32_t IncrementalSchur::AllocateY(std::int32_t quads) {
  if (quads < static_cast<std::int32_t>(free_y_.size()) && !free_y_[quads].empty()) {
    const std::int32_t offset = free_y_[quads].back();
    free_y_[quads].pop_back();
    return offset;
  }
  const auto offset = static_cast<std::int32_t>(Y_.size() / kQuad);
  Y_.resize(Y_.size() + static_cast<std::size_t>(quads) * kQuad);
  return offset;
}

}  // namespace inceres::internal
