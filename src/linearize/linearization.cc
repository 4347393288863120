#include "linearize/linearization.h"

#include <algorithm>
#include <numeric>
#include <utility>

#include "base/address.h"
#include "linearize/variable_look_up.h"

namespace inceres::internal {

// Memory of one family's linearization and the calls that fill it. Arrays grow by capacity and
// keep what they have, since incremental mode adds factors to a family whose other Jacobians stay
// in use; slots, views and tables move together whenever the Jacobians get another place.
//
// Pins (first-estimate Jacobians) split a linearization in two: one call with Jacobians at the
// pinned values, and for factors with a pin another one for the residual where the variables are.
//
// How J lies in memory is decided once (jacobian_places.h) and said by two numbers a slot, from
// factor to factor and from row to row: kernels read every kind by them. Families write by the
// views, which are the same addresses, or by those of a strip.

namespace {

// `used` of the old values stay.
void Enlarge(std::size_t size, std::size_t used, ZeroedArray* array) {
  ZeroedArray larger(size);
  std::copy_n(array->data(), used, larger.data());
  *array = std::move(larger);
}

// Records lie apart where they are in another order than the factors: so many ahead are asked for.
constexpr int kRecordsAhead = 12;

// The whole record, line by line, and for writing. In single precision nothing is asked for.
void FetchToWrite(const Linearization& cache, int factor) {
  constexpr std::ptrdiff_t kLine = 64 / sizeof(double);
  if (cache.records.empty() || cache.keeps_singles()) {
    return;
  }
  const std::ptrdiff_t size = cache.slots[0].factor_stride;
  const double* const record = cache.jacobian_values.data() + cache.Record(factor) * size;
  for (std::ptrdiff_t at = 0; at < size; at += kLine) {
    __builtin_prefetch(record + at, /*rw=*/1);
  }
}

void Narrow(const double* values, std::ptrdiff_t count, float* out) {
  std::transform(values, values + count, out,
                 [](double entry) { return static_cast<float>(entry); });
}

}  // namespace

// Sizes only; memory comes with the factors. Data pointers stay null until Grow.
Linearization::Linearization(const FactorGraph& owner, FamilyId family_id)
    : graph(&owner),
      family(&owner.family(family_id)),
      id(family_id),
      residual_size(family->residual_size()),
      num_slots(family->num_slots()),
      slots(num_slots),
      views(num_slots) {
  // Blocks are padded to quads in each row; the padding is zero from the start and stays so.
  for (int s = 0; s < num_slots; ++s) {
    const int columns = family->slot(s).tangent_size;
    slots[s] = {nullptr, std::ptrdiff_t{residual_size} * PadToQuad(columns), PadToQuad(columns),
                columns};
  }
}

void Linearization::MakeTables(int num_places) {
  parameters.resize(static_cast<std::size_t>(num_places) * num_slots);
  tangent_maps.resize(parameters.size());
  GrowTables(num_places);
}

void Linearization::GrowTables(int num_places) {
  num_factors = num_places;
  const std::size_t num_entries = static_cast<std::size_t>(num_places) * num_slots;
  parameters.resize(num_entries, nullptr);
  tangent_maps.resize(num_entries, nullptr);
  pins.resize(pins.empty() ? 0 : num_entries);
  jacobian_parameters_.resize(pins.size());
  const std::size_t size = static_cast<std::size_t>(std::max(num_places, capacity)) * residual_size;
  // At least doubled: factors come a few at a time.
  if (size > residuals.size()) {
    Enlarge(std::max(size, 2 * residuals.size()), residuals.size(), &residuals);
  }
}

// Kept values move to the new place; new ones are zero. With the same capacity only the tables
// become longer, for columns of Jacobians have room already. All addresses of Jacobians change
// where it grows, so slots and views are set together.
void Linearization::Grow(int num_places, int new_capacity) {
  const int before = num_factors;
  if (new_capacity > capacity) {
    capacity = new_capacity;
    // All slots in one array, each with room for `capacity` factors: with more room all of them
    // move.
    ZeroedArray J(static_cast<std::size_t>(FactorSize(*this)) * capacity);
    double* next = J.data();
    for (int s = 0; s < num_slots; ++s) {
      SlotJacobians& slot = slots[s];
      std::copy_n(slot.data, before * slot.factor_stride, next);
      slot.data = next;
      next += capacity * slot.factor_stride;
      views[s] = {slot.data, slot.factor_stride, slot.row_stride};
    }
    jacobian_values = std::move(J);
    Enlarge(static_cast<std::size_t>(capacity) * residual_size,
            static_cast<std::size_t>(before) * residual_size, &candidate_residuals);
  }
  GrowTables(num_places);
  // -1: no block until it is connected.
  tangent_offsets.resize(parameters.size(), -1);
}

// A factor's blocks follow each other: of a BAL problem 24 entries, three lines of the cache, where
// slots apart take 32. Whole quads, since offsets of blocks are counted in these.
void Linearization::PlaceByFactor(int num_places, bool in_singles,
                                  std::vector<std::int32_t> order) {
  const std::ptrdiff_t factor_stride = PackRows(this);
  // A last row is read as a whole quad.
  const auto room = [&](int count) {
    return static_cast<std::size_t>(factor_stride * count + kQuad);
  };
  records = std::move(order);
  jacobian_values = ZeroedArray(in_singles ? room(num_places) / 2 : room(num_places));
  if (in_singles) {
    auto* next = reinterpret_cast<float*>(jacobian_values.data());  // of nothing but zeros as yet
    for (SlotJacobians& slot : slots) {
      slot.single = next;
      next += residual_size * slot.columns;
    }
  }
  if (in_singles || !records.empty()) {
    strip_values = ZeroedArray(room(kStripSize) +
                               (records.empty() ? 0 : std::size_t{kStripSize} * residual_size));
    EndStrip();
  } else {
    PlaceSlots(0, jacobian_values.data());
  }
}

// Blocks of one record: slot after slot, each residual_size rows without padding. What is between
// the last one and the record's end fills a quad. Families write, and losses correct, at data +
// factor · stride, so data is where those of factor 0 would be. That address is a number only: none
// of it is used.
void Linearization::PlaceSlots(int record, double* first) {
  for (int s = 0; s < num_slots; ++s) {
    SlotJacobians& slot = slots[s];
    slot.data = AddressBefore(record * slot.factor_stride, first);
    views[s] = {slot.data, slot.factor_stride, slot.row_stride};
    first += residual_size * slot.columns;
  }
}

// All slots get one stride from factor to factor, since their blocks share a record.
std::ptrdiff_t PackRows(Linearization* factors) {
  int size = 0;
  for (SlotJacobians& slot : factors->slots) {
    slot.row_stride = slot.columns;
    size += factors->residual_size * slot.columns;
  }
  for (SlotJacobians& slot : factors->slots) {
    slot.factor_stride = PadToQuad(size);
  }
  return PadToQuad(size);
}

// The kernel's C has the rows of b and the columns of a.
BlockProducts ProductsOf(const Linearization& factors, int row_slot, int column_slot) {
  const SlotJacobians& row = factors.slots[row_slot];
  const SlotJacobians& column = factors.slots[column_slot];
  BlockProducts products;
  products.a = column.data;
  products.b = row.data;
  products.depth = factors.residual_size;
  // The same slot for row and column: every term is a Jacobian with itself.
  products.symmetric = row_slot == column_slot;
  products.a_stride = column.UnpaddedStride();
  products.b_stride = row.UnpaddedStride();
  return products;
}

// Jᵀf: `a` is J of the slot, whose places terms name, and v the residuals, which they name as well.
VectorProducts GradientOf(const Linearization& factors, int slot) {
  VectorProducts products;
  products.a = factors.slots[slot].data;
  products.v = factors.residuals.data();
  products.depth = factors.residual_size;
  products.a_stride = factors.slots[slot].UnpaddedStride();
  return products;
}

// With padding where rows have any: it is read with the rest.
std::ptrdiff_t FactorSize(const Linearization& factors) {
  return std::accumulate(factors.slots.begin(), factors.slots.end(), std::ptrdiff_t{0},
                         [&](std::ptrdiff_t sum, const SlotJacobians& slot) {
                           return sum + std::ptrdiff_t{factors.residual_size} * slot.row_stride;
                         });
}

EvaluationFailure Linearization::EvaluateCandidate(int begin, int end, double* f) {
  FactorBatch batch = CandidateBatch(begin, end);
  batch.residuals = f;
  batch.prepared = prepared_;
  return EvaluateBatch(*this, batch);
}

// Residuals are written there, too, where records have an order of their own (WrittenResiduals).
void Linearization::BeginStrip(int first) {
  strip_begin_ = first;
  PlaceSlots(first, strip_values.data());
}

// Who reads Jacobians in double by mistake where they are in single precision, or writes to a strip
// that is over, meets nothing, rather than those of other factors.
void Linearization::EndStrip() {
  if (keeps_singles()) {
    for (SlotJacobians& slot : slots) {
      slot.data = nullptr;
    }
  } else {
    PlaceSlots(0, jacobian_values.data());
  }
  for (JacobianView& view : views) {
    view.data = nullptr;
  }
}

// In the strip behind its Jacobians, where the order of records is another one. They end where the
// strip's memory does, so that the residual of factor strip_begin_ + kStripSize would be at its
// end, and that of factor 0 so many before.
double* Linearization::WrittenResiduals() const {
  if (records.empty() || !has_strips()) {
    return residuals.data();
  }
  double* const strip_end = strip_values.data() + strip_values.size();
  return AddressBefore(std::ptrdiff_t{strip_begin_ + kStripSize} * residual_size, strip_end);
}

// Of all slots, for a factor's blocks lie together. Neighboring factors of a strip go to records
// that may be far apart, each a line or more that is not in the cache: hence the requests ahead,
// which end with the range, for what is behind it is another task's.
void Linearization::KeepStrip(int begin, int end) {
  const SlotJacobians& first = slots[0];
  const double* const f = WrittenResiduals();
  for (int i = begin; i < end; ++i) {
    const std::ptrdiff_t record = Record(i);
    const double* const J = first.data + i * first.factor_stride;
    FetchToWrite(*this, std::min(i + kRecordsAhead, end - 1));
    if (keeps_singles()) {
      Narrow(J, first.factor_stride, first.single + record * first.factor_stride);
    } else {
      std::copy_n(J, first.factor_stride, jacobian_values.data() + record * first.factor_stride);
    }
    if (!records.empty()) {
      std::copy_n(f + std::ptrdiff_t{i} * residual_size, residual_size,
                  residuals.data() + record * residual_size);
    }
  }
}

// Pointers stay good as long as the store or the states that they lead into.
void Linearization::Connect(std::size_t entry, const double* x, const double* pinned,
                            const TangentMap& map) {
  parameters[entry] = x;
  tangent_maps[entry] = &map;
  Pin(entry, pinned);
}

// The column of pins appears with the first one.
void Linearization::Pin(std::size_t entry, const double* pinned) {
  if (pinned != nullptr && pins.empty()) {
    pins.resize(parameters.size(), nullptr);
    jacobian_parameters_.resize(pins.size());
  }
  // Without any pin an entry that has none needs no column.
  if (!pins.empty()) {
    pins[entry] = pinned;
  }
}

// One pinned variable is enough: the residual there was taken at the pinned value. Cost: the slots.
// Asked only in families that have a pin.
bool Linearization::IsPinned(int factor) const {
  const auto first = pins.begin() + Entry(factor);
  return std::any_of(first, first + num_slots, [](const double* pin) { return pin != nullptr; });
}

// Some families cannot.
std::int64_t Linearization::BytesToKeep() const {
  return KeptEvaluations::CanKeep(*family) ? KeptEvaluations::Bytes(*family, num_factors) : 0;
}

void Linearization::MakeRoomToKeep() {
  if (kept_ == nullptr && KeptEvaluations::CanKeep(*family)) {
    kept_ = std::make_unique<KeptEvaluations>(*family, num_factors);
  }
}

// What was kept before is of another point.
void Linearization::KeepEvaluations(bool keep) {
  keeps_ = keep && kept_ != nullptr;
  if (keeps_) {
    kept_->Forget();
  }
}

void KeepEvaluations(bool keep, std::vector<Linearization>* families) {
  for (Linearization& family : *families) {
    family.KeepEvaluations(keep);
  }
}

// Without Jacobians tangent maps are not needed.
FactorBatch Linearization::CandidateBatch(int begin, int end) {
  FactorBatch batch;
  batch.begin = begin;
  batch.end = end;
  batch.parameters = CandidateParameters(0);
  batch.residuals = candidate_residuals.data();
  batch.kept = keeps_ ? kept_.get() : nullptr;
  return batch;
}

// All places of the family; begin and end say which of them are evaluated.
FactorBatch Linearization::LinearizationBatch(int begin, int end) {
  FactorBatch batch{begin,       end, parameters.data(), tangent_maps.data(), WrittenResiduals(),
                    views.data()};
  batch.kept = keeps_ ? kept_.get() : nullptr;
  batch.zero_blocks = zero_blocks.are_zero.get();
  return batch;
}

EvaluationFailure Linearization::Linearize(int begin, int end, const LinearizationPlaces& places) {
  FactorBatch batch = LinearizationBatch(begin, end);
  batch.residuals = places.residuals;
  batch.jacobians = places.views;
  batch.prepared = prepared_;
  // Families without a pin take one call.
  return pins.empty() ? EvaluateBatch(*this, batch) : LinearizePinned(batch);
}

// With pins two evaluations at two points follow: neither is announced.
// A family may prepare once for all factors of a pass; what it is told must be what is then asked.
EvaluationFailure Linearization::Prepare(bool jacobians, const std::vector<std::int32_t>& factors) {
  prepared_ = false;
  if (!family->Prepares() || factors.empty() || (jacobians && !pins.empty())) {
    return {};
  }
  const int begin = factors.front(), end = factors.back() + 1;
  const EvaluationFailure failure =
      family->Prepare(jacobians ? LinearizationBatch(begin, end) : CandidateBatch(begin, end),
                      factors.data(), static_cast<int>(factors.size()));
  prepared_ = !failure.failed();
  return failure;
}

// Jacobians at the pinned values, then residuals where the variables are. Residuals at the pinned
// values are written as well, and those of factors without a pin are right. Two evaluations of a
// factor with a pin, and one of all others, which are evaluated in one call with these.
// VariableLookUp serves no family with pins, so the tables are there.
EvaluationFailure Linearization::LinearizePinned(FactorBatch batch) {
  for (std::ptrdiff_t entry = Entry(batch.begin); entry < Entry(batch.end); ++entry) {
    jacobian_parameters_[entry] = pins[entry] != nullptr ? pins[entry] : parameters[entry];
  }
  batch.parameters = jacobian_parameters_.data();
  EvaluationFailure failure = family->Evaluate(batch);
  // Residuals only, factor by factor where a pin has misplaced them: at the values that are taken
  // over from Parameters, which also tells LinearizedParameters where it would fail.
  batch.tangent_maps = nullptr;
  batch.jacobians = nullptr;
  for (int i = batch.begin, end = batch.end; i < end && !failure.failed(); ++i) {
    if (IsPinned(i)) {
      batch.begin = i;
      batch.end = i + 1;
      std::copy_n(Parameters(i), num_slots, jacobian_parameters_.begin() + Entry(i));
      failure = family->Evaluate(batch);
    }
  }
  return failure;
}

// As the kernels see a range of records. Of whole rows a range is that of one block, which is all
// rows of the family.
FactorRows Linearization::Rows(int begin, int end) const {
  FactorRows rows;
  rows.begin = begin;
  rows.end = end;
  rows.residual_size = rows_per_block();
  rows.num_slots = static_cast<int>(slots.size());
  rows.jacobians = slots.data();
  rows.residuals = residuals.data();
  rows.tangent_offsets = RecordOffsets();
  return rows;
}

}  // namespace inceres::internal
