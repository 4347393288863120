#include "problem/kept_evaluations.h"

#include <algorithm>
#include <cstring>

#include "simd/kernels.h"

namespace inceres::internal {

// Evaluations with Jacobians that are kept by their values (AmbientFamily::EvaluateOrFetch). A
// record is what a call was given and what it wrote, unprojected: manifolds of other variables may
// have moved on since, and what is wanted of it differs from reader to reader. Blocks are of a few
// entries, for which calls of the library's memory functions take longer than what they do.
//
// A factor has one record, of its last call, since who comes back comes back to that. In it the
// values of all slots come first, then the residuals, then the ambient Jacobians, slot by slot; a
// bit for each slot says whether its Jacobian was asked for, and no bit that there is no call to
// speak of. The cost function writes its Jacobians straight into the record, so that keeping costs
// a copy of values and residuals.

namespace {

// Numbers of a record.
std::int64_t RecordSize(const FactorFamily& family) {
  std::int64_t num_values = 0;
  for (int s = 0; s < family.num_slots(); ++s) {
    num_values += family.slot(s).ambient_size;
  }
  return num_values + family.residual_size() * (1 + num_values);
}

// Of a variable that is not constant, also where its Jacobian is not wanted this time (kUnwanted):
// it may be the next time, and the call is the same.
bool IsAsked(const TangentMap& map) {
  return map.kind != TangentMap::Kind::kConstant;
}

std::uint64_t BitsOf(double value) {
  std::uint64_t bits = 0;
  std::memcpy(&bits, &value, sizeof(bits));
  return bits;
}

// Returns the place behind them.
double* Copy(const double* from, int count, double* to) {
  for (; count >= kQuad; count -= kQuad, from += kQuad, to += kQuad) {
    std::memcpy(to, from, kQuad * sizeof(double));
  }
  if (count > 0) {
    to[0] = from[0];
    if (count > 1) {
      to[1] = from[1];
      if (count > 2) {
        to[2] = from[2];
      }
    }
  }
  return to + count;
}

// The processor sees by itself that a longer record goes on.
constexpr std::ptrdiff_t kMostPrefetched = 64;

// To be written, for most are.
void Prefetch(const double* record, std::ptrdiff_t count) {
  constexpr std::ptrdiff_t kLine = 64 / sizeof(double);
  for (std::ptrdiff_t k = 0; k < count; k += kLine) {
    __builtin_prefetch(record + k, /*rw=*/1);
  }
}

}  // namespace

std::int64_t KeptEvaluations::Bytes(const FactorFamily& family, int num_factors) {
  return num_factors * (static_cast<std::int64_t>(sizeof(double)) * RecordSize(family) +
                        static_cast<std::int64_t>(sizeof(std::uint32_t)));
}

KeptEvaluations::KeptEvaluations(const FactorFamily& family, int num_factors)
    : residual_size_(family.residual_size()),
      stride_(RecordSize(family)),
      kept_(static_cast<std::size_t>(num_factors), 0),
      records_(ZeroedArray::Unwritten(static_cast<std::size_t>(stride_ * num_factors))) {
  for (int s = 0; s < family.num_slots(); ++s) {
    const FactorFamily::Slot& slot = family.slot(s);
    AmbientSlot& sizes = slots_.emplace_back();
    sizes.num_rows = residual_size_;
    sizes.ambient_size = slot.ambient_size;
    sizes.size = residual_size_ * slot.ambient_size;
    sizes.take = FindTake(residual_size_, slot.ambient_size, slot.tangent_size);
    num_values_ += slot.ambient_size;
  }
}

void KeptEvaluations::Forget() {
  std::fill(kept_.begin(), kept_.end(), 0);
}

// By their bits: of zeros, too, the sign may matter. The last slots first, for what moves by itself
// is mostly there, as landmarks are. A NaN is equal to itself here, and what was computed of it
// once is so again.
bool KeptEvaluations::IsAt(const double* const* parameters, const double* values) const {
  values += num_values_;
  for (std::size_t s = slots_.size(); s-- > 0;) {
    values -= slots_[s].ambient_size;
    for (int k = 0; k < slots_[s].ambient_size; ++k) {
      if (BitsOf(values[k]) != BitsOf(parameters[s][k])) {
        return false;
      }
    }
  }
  return true;
}

// Found if everything that is wanted now was asked for then, at these values. Else the record is
// void from here on, until Take: a call that fails must not leave values with another's Jacobians.
// Entries are marked as unwritten, as for a call whose results are not kept, so that what the
// function forgets is found.
bool KeptEvaluations::Fetch(const FactorBatch& batch, int i, double** blocks) {
  const TangentMap* const* const maps = batch.tangent_maps + Entry(i);
  double* const residuals = batch.residuals + std::ptrdiff_t{i} * residual_size_;
  double* const record = Record(i);
  if (batch.next >= 0) {
    Prefetch(Record(batch.next), std::min(stride_, kMostPrefetched));
  }
  double* J = record + num_values_ + residual_size_;
  std::uint32_t wanted = 0;
  for (std::size_t s = 0; s < slots_.size(); J += slots_[s].size, ++s) {
    blocks[s] = IsAsked(*maps[s]) ? J : nullptr;
    wanted |= static_cast<std::uint32_t>(maps[s]->wanted()) << s;
  }
  std::uint32_t& kept = kept_[static_cast<std::size_t>(i)];
  if (kept != 0 && (wanted & ~kept) == 0 && IsAt(batch.parameters + Entry(i), record)) {
    Copy(record + num_values_, residual_size_, residuals);
    return true;
  }
  kept = 0;
  MarkUnwritten(residuals, residual_size_);
  for (std::size_t s = 0; s < slots_.size(); ++s) {
    if (blocks[s] != nullptr) {
      MarkUnwritten(blocks[s], slots_[s].size);
    }
  }
  return false;
}

// Returns the slots whose Jacobians are there.
std::uint32_t KeptEvaluations::Keep(const double* const* parameters, const TangentMap* const* maps,
                                    const double* residuals, double* record) const {
  std::uint32_t kept = 0;
  for (std::size_t s = 0; s < slots_.size(); ++s) {
    kept |= static_cast<std::uint32_t>(IsAsked(*maps[s])) << s;
    record = Copy(parameters[s], slots_[s].ambient_size, record);
  }
  Copy(residuals, residual_size_, record);
  return kept;
}

// Jacobians are projected with the maps of now, whether they were fetched or not: the record has
// them as the cost function gave them. The first attempt is a copy that checks on its way; what it
// does not vouch for goes through TakeAlike, which tells the entry. A bad entry is found only where
// its Jacobian is wanted.
int KeptEvaluations::Take(const FactorBatch& batch, int i, bool is_new, const double** J) {
  const TangentMap* const* const maps = batch.tangent_maps + Entry(i);
  double* const record = Record(i);
  if (is_new) {
    kept_[static_cast<std::size_t>(i)] =
        Keep(batch.parameters + Entry(i), maps,
             batch.residuals + std::ptrdiff_t{i} * residual_size_, record);
  }
  double* values = record + num_values_ + residual_size_;
  for (std::size_t s = 0; s < slots_.size(); values += slots_[s].size, ++s) {
    if (!maps[s]->wanted()) {
      continue;
    }
    const JacobianView& view = batch.jacobians[s];
    double* const J_tangent = view.data + i * view.factor_stride;
    if (maps[s]->copies() && slots_[s].take != nullptr &&
        slots_[s].take(1, values, residual_size_, J_tangent, 0, view.row_stride)) {
      continue;  // as most are
    }
    AmbientSlot slot = slots_[s];
    slot.values = values;
    slot.J_tangent = J_tangent;
    slot.row_stride = view.row_stride;
    if (TakeAlike(slot, maps + s, 1, 1) >= 0) {
      *J = values;
      return static_cast<int>(s);
    }
  }
  return -1;
}

bool FetchKept(const FactorBatch& batch, int i, double** blocks) {
  return batch.kept->Fetch(batch, i, blocks);
}

int TakeKept(const FactorBatch& batch, int i, bool is_new, const double** J) {
  return batch.kept->Take(batch, i, is_new, J);
}

}  // namespace inceres::internal
