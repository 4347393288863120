#include "incremental/landmark_blocks.h"

#include <algorithm>
#include <cstddef>
#include <limits>
#include <new>

#include "linear/small_cholesky.h"

namespace inceres::internal {

// The landmarks' blocks (docs/algorithms.md, "Schur complement"). With L Lᵀ = P + λ D,
//
//     U_inv = L⁻¹,   Y = W U_invᵀ,   z = U_inv η,   δ_l = U_invᵀ (z − Yᵀ δ_c).
//
// P is summed anew whenever a factor has another linearization, never updated, so it is always as
// exact as its factors, and stays positive semidefinite. W is not kept: Y_lf = Σ J_fᵀ (J_l U_invᵀ)
// comes from the cached Jacobians.
//
// P, U_inv and z have fixed places of four by four and four. Y lies in one array of quads, one run
// a landmark with its frames in the order of rows of S; runs that were given back are used again
// for the same number of quads. Y and z are those of the contribution that is in S until Eliminate
// or RenewZ replaces them.

namespace {

// A landmark whose block is this singular against the scale of its coordinates carries no
// information (docs/algorithms.md, "Incremental Schur complement"): it is undetermined.
constexpr double kNoInformation = 1e-12;

// Times the damping: a pivot below this is mostly damping.
constexpr double kHeld = 10.0;

// As InvertCholeskyFactor, without what is held: rows and columns of zeros.
// A held coordinate has a pivot of 1 in P's place, so that the others' Cholesky factor is that of
// their own block; its diagonal entry of U_inv is then zeroed, and with it all of its row and
// column, for the entries beside it are zero already.
bool InvertWhatMoves(int size, const double* P, const double* damping, const char* held,
                     double* U_inv) {
  if (held == nullptr) {
    return InvertCholeskyFactor(size, P, damping, U_inv);
  }
  double moving[4 * kQuad] = {};
  for (int i = 0; i < size; ++i) {
    for (int k = 0; k < size; ++k) {
      const bool out = held[i] != 0 || held[k] != 0;
      // Off the diagonal a held row or column is zero.
      moving[i * kQuad + k] = !out ? P[i * kQuad + k] : i == k ? 1.0 : 0.0;
    }
  }
  const bool inverted = InvertCholeskyFactor(size, moving, damping, U_inv);
  for (int k = 0; k < size; ++k) {
    U_inv[k * kQuad + k] *= held[k] != 0 ? 0.0 : 1.0;
  }
  return inverted;
}

}  // namespace

void LandmarkBlocks::Grow() {
  const std::size_t n = structure_.landmarks().size();
  state_.resize(n, LandmarkState::kOutside);
  placed_.resize(n, 0);
  lambda_.resize(n, 0.0);
  P_.resize(n * kBlock);
  U_inv_.resize(n * kBlock);
  z_.resize(n * kQuad);
  incidences_.resize(n);
  targets_.resize(n);
  y_quads_.resize(n, 0);
  heavily_damped_.Grow(n);
  weak_.Grow(n);
}

void LandmarkBlocks::Remove(std::int32_t l) {
  Release(l);
  SetState(l, LandmarkState::kOutside);
  heavily_damped_.Remove(l);
  weak_.Remove(l);
}

// The counter follows every change of state.
void LandmarkBlocks::SetState(std::int32_t l, LandmarkState state) {
  num_undetermined_ -= state_[l] == LandmarkState::kUndetermined ? 1 : 0;
  num_undetermined_ += state == LandmarkState::kUndetermined ? 1 : 0;
  state_[l] = state;
}

// One factor as the batch kernels take lists of them. Residuals are q, so that J_lᵀq is the exact
// robust gradient.
LandmarkFactors LandmarkBlocks::FactorsOf(const FactorRef& ref) const {
  IncrementalFamily& family = families_[ref.family];
  LandmarkFactors factors;
  factors.factors = &ref.factor;
  factors.count = 1;
  factors.residual_size = family.residual_size();
  factors.num_slots = family.num_slots();
  factors.jacobians = family.slots();
  factors.residuals = family.weighed().q();
  factors.y_targets = family.y_targets();
  factors.landmark_slot = structure_.LandmarkSlot(ref);
  return factors;
}

// In the order of the landmark's list, from cached Jacobians.
void LandmarkBlocks::Sum(std::int32_t l, double* eta) {
  const IncrementalStructure::Landmark& landmark = structure_.landmarks()[l];
  double* P = P_.data() + l * kBlock;
  std::fill_n(P, kBlock, 0.0);
  std::fill_n(eta, kQuad, 0.0);
  for (const FactorRef& ref : landmark.factors) {
    kernels_.landmark_gram(landmark.size, FactorsOf(ref), P, eta);
  }
}

// False of a landmark that is held, or that P does not determine; Y and z are not touched.
bool LandmarkBlocks::Invert(std::int32_t l, double lambda, const char* held) {
  lambda_[l] = lambda;
  if (lambda > kMildDamping) {
    heavily_damped_.Add(l);
  } else {
    heavily_damped_.Remove(l);
  }
  const IncrementalStructure::Landmark& landmark = structure_.landmarks()[l];
  if (landmark.held) {
    return false;
  }
  const double* P = P_.data() + l * kBlock;
  double damping[kQuad];
  double largest = 0.0;
  for (int k = 0; k < landmark.size; ++k) {
    damping[k] = lambda * D(l, k);
    largest = std::max(largest, P[k * kQuad + k]);
  }
  // Entered again below, if it still is.
  weak_.Remove(l);
  // In this order: a P of zeros has no factor, and a factor may exist thanks to rounding alone.
  const bool inverted = largest > 0.0 &&
                        InvertWhatMoves(landmark.size, P, damping, held, UInv(l)) &&
                        !HasPivotBelow(l, kNoInformation, 0.0);
  if (inverted && HasPivotBelow(l, kWeakPivot, kHeld)) {
    weak_.Add(l);
  }
  return inverted;
}

// Of a pivot that is small against λD nearly all is damping, and with less of it the landmark would
// go further.
bool LandmarkBlocks::IsHeld(std::int32_t l) const {
  return HasPivotBelow(l, 0.0, kHeld);
}

// 1/U_inv² is the pivot: what the other coordinates leave of the diagonal entry. It is looked at
// relative to that, which has the units of the coordinate, so that the test does not depend on
// them, and to the damping.
bool LandmarkBlocks::HasPivotBelow(std::int32_t l, double share, double times_damping) const {
  for (int k = 0; k < structure_.landmarks()[l].size; ++k) {
    // Zero of a coordinate that is held at a bound.
    const double inverse_root = UInv(l)[k * kQuad + k];
    const double limit =
        std::max(share * P(l)[k * kQuad + k], times_damping * lambda_[l] * D(l, k));
    if (inverse_root > 0.0 && 1.0 / (inverse_root * inverse_root) < limit) {
      return true;
    }
  }
  return false;
}

double LandmarkBlocks::HiddenGain(std::int32_t l, double lambda, const double* eta,
                                  const char* held) const {
  const int size = structure_.landmarks()[l].size;
  double damping[kQuad] = {};
  for (int k = 0; k < size; ++k) {
    damping[k] = lambda * D(l, k);
  }
  double inverse[kBlock];
  double freely[kQuad];
  double now[kQuad];
  if (!InvertWhatMoves(size, P(l), damping, held, inverse)) {
    return 0.0;
  }
  // ½ ‖U_inv η‖² is ½ ηᵀ (P + λD)⁻¹ η.
  MultiplyLower(size, inverse, eta, freely);
  MultiplyLower(size, UInv(l), eta, now);
  double hidden = 0.0;
  for (int k = 0; k < size; ++k) {
    hidden += 0.5 * (freely[k] * freely[k] - now[k] * now[k]);
  }
  return hidden;
}

// The run of Y goes to the list of its length, the places in S are forgotten.
void LandmarkBlocks::Release(std::int32_t l) {
  if (y_quads_[l] > 0) {
    free_y_.resize(std::max(free_y_.size(), static_cast<std::size_t>(y_quads_[l]) + 1));
    free_y_[y_quads_[l]].push_back(incidences_[l].front().y);
  }
  incidences_[l].clear();
  targets_[l].clear();
  y_quads_[l] = 0;
  placed_[l] = 0;
}

std::int32_t LandmarkBlocks::AllocateY(std::int32_t quads) {
  if (quads < static_cast<std::int32_t>(free_y_.size()) && !free_y_[quads].empty()) {
    const std::int32_t offset = free_y_[quads].back();
    free_y_[quads].pop_back();
    return offset;
  }
  // Targets are twice the offset (PointFactors): Y beyond 32 GiB is as good as no memory.
  constexpr std::size_t kMostQuads = std::numeric_limits<std::int32_t>::max() / 2;
  if (Y_.size() / kQuad + static_cast<std::size_t>(quads) > kMostQuads) {
    throw std::bad_alloc();
  }
  // Y may move by this: nobody holds pointers into it from one call to the next.
  const auto offset = static_cast<std::int32_t>(Y_.size() / kQuad);
  Y_.resize(Y_.size() + static_cast<std::size_t>(quads) * kQuad);
  return offset;
}

// Incidences count from the landmark's own run first, since its length is known at the end only.
void LandmarkBlocks::PlaceY(std::int32_t l) {
  const IncrementalStructure::Landmark& landmark = structure_.landmarks()[l];
  for (const std::int32_t row : landmark.frames) {
    const IncrementalStructure::Frame& frame = structure_.frames()[row];
    const auto quads = static_cast<std::int32_t>(PadToQuad(frame.size) / kQuad);
    AppendCounted(Incidence{y_quads_[l], frame.quad, quads}, &incidences_[l], &list_bytes_);
    y_quads_[l] += quads * landmark.size;
  }
  const std::int32_t base = AllocateY(y_quads_[l]);
  for (Incidence& incidence : incidences_[l]) {
    incidence.y += base;
  }
}

// The first factor that reaches a block of Y sets it, later ones add to it: an odd target.
// 2 y + 1 adds, 2 y sets: so Y needs no zeroing before Eliminate.
void LandmarkBlocks::PointFactors(std::int32_t l) {
  const IncrementalStructure::Landmark& landmark = structure_.landmarks()[l];
  begun_.assign(landmark.frames.size(), 0);
  // In the very order in which Eliminate walks them, which is what makes the first one the first.
  for (const FactorRef& ref : landmark.factors) {
    IncrementalFamily& family = families_[ref.family];
    std::int32_t* targets =
        family.y_targets() + static_cast<std::ptrdiff_t>(ref.factor) * family.num_slots();
    for (int s = 0; s < family.num_slots(); ++s) {
      const std::int32_t frame = structure_.FrameOfFactor(ref, s);
      // No frame: the landmark itself, or a constant that never took part.
      if (frame < 0) {
        continue;
      }
      // A separator is short, and sorted by row.
      const auto at = std::find(landmark.frames.begin(), landmark.frames.end(), frame) -
                      landmark.frames.begin();
      targets[s] = 2 * incidences_[l][at].y + begun_[at];
      begun_[at] = 1;
    }
  }
}

// Writes over the Y and z that may be in S: whoever replaces a contribution copies them before.
void LandmarkBlocks::Eliminate(std::int32_t l, const double* eta) {
  const IncrementalStructure::Landmark& landmark = structure_.landmarks()[l];
  for (const FactorRef& ref : landmark.factors) {
    kernels_.eliminate(landmark.size, FactorsOf(ref), UInv(l), Y_.data());
  }
  MultiplyLower(landmark.size, UInv(l), eta, z_.data() + l * kQuad);
}

// P and the Jacobians stay, so Y stays: b −= Y (z − z_old).
void LandmarkBlocks::RenewZ(std::int32_t l, const double* eta, double* rhs) {
  const int size = structure_.landmarks()[l].size;
  const std::vector<Incidence>& incidences = incidences_[l];
  double* z = z_.data() + std::ptrdiff_t{l} * kQuad;
  double renewed[kQuad];
  MultiplyLower(size, UInv(l), eta, renewed);
  double change[kQuad];
  for (int k = 0; k < size; ++k) {
    change[k] = renewed[k] - z[k];
    z[k] = renewed[k];
  }
  kernels_.subtract_incidences(size, incidences.data(), static_cast<int>(incidences.size()),
                               Y_.data(), change, rhs);
}

void LandmarkBlocks::FetchPlaces(std::int32_t l) const {
  const IncrementalStructure::Landmark& landmark = structure_.landmarks()[l];
  __builtin_prefetch(&landmark.id);
  __builtin_prefetch(&landmark.places);
  __builtin_prefetch(&incidences_[l]);
  __builtin_prefetch(z(l));
  __builtin_prefetch(UInv(l));
  __builtin_prefetch(UInv(l) + 8);
}

void LandmarkBlocks::FetchLists(std::int32_t l) const {
  const IncrementalStructure::Landmark& landmark = structure_.landmarks()[l];
  __builtin_prefetch(landmark.factors.data());
  __builtin_prefetch(landmark.frames.data());
  __builtin_prefetch(incidences_[l].data());
}

void LandmarkBlocks::FetchBlocks(std::int32_t l) const {
  if (!incidences_[l].empty()) {
    const double* y = Y(l);
    for (std::ptrdiff_t k = 0; k < SizeOfY(l); k += 8) {
      __builtin_prefetch(y + k);
    }
  }
}

// Frames that do not move have zeros in padded_step and contribute nothing.
void LandmarkBlocks::BackSubstitute(std::int32_t l, double* padded_step) const {
  const IncrementalStructure::Landmark& landmark = structure_.landmarks()[l];
  const int size = landmark.size;
  double* step = padded_step + std::ptrdiff_t{landmark.quad} * kQuad;
  if (state_[l] < LandmarkState::kInRows) {  // it has no Y and z that count
    std::fill_n(step, size, 0.0);
    return;
  }
  const std::vector<Incidence>& incidences = incidences_[l];
  double y[kQuad];
  // A copy: z stays that of the contribution in S.
  std::copy_n(z(l), kQuad, y);
  kernels_.back_substitute(size, incidences.data(), static_cast<int>(incidences.size()), Y_.data(),
                           padded_step, y);
  MultiplyLowerTransposed(size, UInv(l), y, step);
}

// New factors may have brought new frames since: the contribution is that of the incidences, the
// frames it went in with.
Contribution LandmarkBlocks::Rows(std::int32_t l, std::vector<BlockRow>* rows) const {
  const IncrementalStructure::Landmark& landmark = structure_.landmarks()[l];
  const std::vector<Incidence>& incidences = incidences_[l];
  const std::size_t count = incidences.size();
  rows->resize(count);
  for (std::size_t r = 0; r < count; ++r) {
    (*rows)[r] = {Y_.data() + std::ptrdiff_t{incidences[r].y} * kQuad, incidences[r].frame,
                  incidences[r].quads, structure_.frames()[landmark.frames[r]].size};
  }
  return {rows->data(), static_cast<int>(count), landmark.size};
}

// The lower triangle of its blocks of S.
std::int64_t LandmarkBlocks::NumPairs(std::int32_t l) const {
  const auto n = static_cast<std::int64_t>(incidences_[l].size());
  return n * (n + 1) / 2;
}

std::size_t LandmarkBlocks::Bytes() const {
  return sizeof(double) * (Y_.capacity() + P_.capacity() + U_inv_.capacity() + z_.capacity() +
                           lambda_.capacity()) +
         (sizeof(std::vector<Incidence>) + sizeof(std::vector<std::int32_t>)) *
             incidences_.capacity() +
         list_bytes_;
}

}  // namespace inceres::internal
