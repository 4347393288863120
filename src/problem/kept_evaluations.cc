#include "problem/kept_evaluations.h"

#include <algorithm>
#include <cstring>

#include "simd/kernels.h"

namespace inceres::internal {

// Evaluations with Jacobians that are kept by their values (AmbientFamily::EvaluateOrFetch). A
// record is what a call was given and what it wrote, unprojected: manifolds of other variables may
// have moved on since, and what is wanted of it differs from reader to reader.

namespace {

// Numbers of a record.
std::int64_t RecordSize(const FactorFamily& family) {
  std::int64_t num_values = 0;
  for (int s = 0; s < family.num_slots(); ++s) {
    num_values += family.slot(s).ambient_size;
  }
  return num_values + family.residual_size() * (1 + num_values);
}

template <typename Slots, typename Asked>
std::uint32_t BitsOf(const Slots& slots, const TangentMap* const* maps, const Asked& asked) {
  std::uint32_t bits = 0;
  for (std::size_t s = 0; s < slots.size(); ++s) {
    bits |= static_cast<std::uint32_t>(asked(*maps[s])) << s;
  }
  return bits;
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

bool KeptEvaluations::Fetch(int i, const double* const* parameters, const TangentMap* const* maps,
                            double* residuals) {
  const std::uint32_t kept = kept_[static_cast<std::size_t>(i)];
  const std::uint32_t wanted =
      BitsOf(slots_, maps, [](const TangentMap& map) { return map.wanted(); });
  if (kept == 0 || (wanted & ~kept) != 0) {
    return false;
  }
  const double* values = Record(i);
  for (std::size_t s = 0; s < slots_.size(); ++s) {
    const int size = slots_[s].ambient_size;
    // By their bits: of zeros, too, the sign may matter.
    if (std::memcmp(values, parameters[s], sizeof(double) * static_cast<std::size_t>(size)) != 0) {
      return false;
    }
    values += size;
  }
  std::copy_n(values, residual_size_, residuals);
  return true;
}

void KeptEvaluations::Begin(int i, const TangentMap* const* maps, double** blocks) {
  kept_[static_cast<std::size_t>(i)] = 0;
  double* J = Jacobians(i);
  for (std::size_t s = 0; s < slots_.size(); J += slots_[s].size, ++s) {
    const bool asked = maps[s]->kind != TangentMap::Kind::kConstant;
    blocks[s] = asked ? J : nullptr;
    if (asked) {
      MarkUnwritten(J, slots_[s].size);
    }
  }
}

void KeptEvaluations::Keep(int i, const double* const* parameters, const TangentMap* const* maps,
                           const double* residuals) {
  kept_[static_cast<std::size_t>(i)] = BitsOf(
      slots_, maps, [](const TangentMap& map) { return map.kind != TangentMap::Kind::kConstant; });
  double* to = Record(i);
  for (std::size_t s = 0; s < slots_.size(); ++s) {
    to = std::copy_n(parameters[s], slots_[s].ambient_size, to);
  }
  std::copy_n(residuals, residual_size_, to);
}

int KeptEvaluations::Take(int i, const TangentMap* const* maps, const JacobianView* views,
                          const double** J) {
  double* values = Jacobians(i);
  for (std::size_t s = 0; s < slots_.size(); ++s) {
    if (maps[s]->wanted()) {
      AmbientSlot slot = slots_[s];
      slot.values = values;
      slot.J_tangent = views[s].data + i * views[s].factor_stride;
      slot.row_stride = views[s].row_stride;
      if (TakeOver(slot, maps + s, 1, 1) >= 0) {
        *J = values;
        return static_cast<int>(s);
      }
    }
    values += slots_[s].size;
  }
  return -1;
}

bool FetchKept(const FactorBatch& batch, int i, double** blocks) {
  KeptEvaluations& kept = *batch.kept;
  const std::ptrdiff_t entry = std::ptrdiff_t{i} * kept.num_slots();
  double* const residuals = batch.residuals + std::ptrdiff_t{i} * kept.residual_size();
  const TangentMap* const* const maps = batch.tangent_maps + entry;
  if (kept.Fetch(i, batch.parameters + entry, maps, residuals)) {
    return true;
  }
  MarkUnwritten(residuals, kept.residual_size());
  kept.Begin(i, maps, blocks);
  return false;
}

void Keep(const FactorBatch& batch, int i) {
  KeptEvaluations& kept = *batch.kept;
  const std::ptrdiff_t entry = std::ptrdiff_t{i} * kept.num_slots();
  kept.Keep(i, batch.parameters + entry, batch.tangent_maps + entry,
            batch.residuals + std::ptrdiff_t{i} * kept.residual_size());
}

int TakeKept(const FactorBatch& batch, int i, const double** J) {
  return batch.kept->Take(i, batch.tangent_maps + std::ptrdiff_t{i} * batch.kept->num_slots(),
                          batch.jacobians, J);
}

}  // namespace inceres::internal
