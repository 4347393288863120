#include "linearize/jacobian_places.h"

#include <algorithm>
#include <cstdint>

#include "base/counting_sort.h"

namespace inceres::internal {

// Layouts of a family's Jacobians (JacobianStorage). By slot: the blocks of one slot one after the
// other, rows padded to quads, each block with the tangent offset of its variable. By factor: in an
// order of records, which is that of landmarks where factors were added in another one. Whole rows:
// a small dense J, one row a residual over all columns, where a family writes its blocks straight
// into place.

namespace {

// What whole rows serve.
constexpr int kMaxWholeColumns = 16;
constexpr std::int64_t kMaxWholeRows = 1024;

// Jacobians by slot whose zeros would cost a pass over memory that is used again; those of a larger
// array come with its pages. And most of it is written by every evaluation anyway.
bool ComesUnwritten(std::size_t size) {
  constexpr std::size_t kMostUnwritten = std::size_t{1} << 17;  // a megabyte
  return size <= kMostUnwritten;
}

// What is far beyond the largest caches is read at the speed of memory, padding and all. Kernels
// for rows without it take a few instructions more: on a path of 1,000 cameras, whose Jacobians
// take 51 MB, 2 % of those of a solve.
constexpr std::int64_t kMostPadded = std::int64_t{1} << 27;  // 128 MiB

// One to three entries at the end of each row. Without a loop inside: it is called for each block
// of a problem whose Jacobians come unwritten.
void ClearPadding(int padding, int row_stride, double* begin, double* end) {
  for (double* next_row = begin + row_stride; next_row <= end; next_row += row_stride) {
    next_row[-1] = 0.0;
    if (padding > 1) {
      next_row[-2] = 0.0;
    }
    if (padding > 2) {
      next_row[-3] = 0.0;
    }
  }
}

// The first variable of the factor that is one, or -1.
template <typename Is>
// A free place has −1 in each slot, and so no such variable.
VariableId FirstOf(const FactorGraph& graph, FamilyId id, int factor, const Is& is) {
  const VariableId* const ids = graph.Variables(id, factor);
  const VariableId* const end = ids + graph.family(id).num_slots();
  const VariableId* const first =
      std::find_if(ids, end, [&](VariableId variable) { return variable >= 0 && is(variable); });
  return first == end ? -1 : *first;
}

// Or -1.
int LandmarkOfFactor(const FactorGraph& graph, const Layout& layout, FamilyId id, int factor) {
  return layout.LandmarkAmong(graph.Variables(id, factor), graph.family(id).num_slots());
}

// The factors of one landmark stay in the family's order, and with them the sums over them. Factors
// without a landmark come last, in a group of their own. What is returned is the inverse of the
// sorted order: per factor its record.
std::vector<std::int32_t> SortByLandmark(const FactorGraph& graph, const Layout& layout,
                                         FamilyId id) {
  const int num_landmarks = layout.num_landmarks();
  std::vector<std::int32_t> begin, order;
  const auto for_each_factor = [&](const auto& add) {
    for (std::int32_t i = 0; i < graph.NumFactors(id); ++i) {
      const int landmark = LandmarkOfFactor(graph, layout, id, i);
      add(landmark < 0 ? num_landmarks : landmark, i);
    }
  };
  CountingSort(static_cast<std::size_t>(num_landmarks) + 1, for_each_factor, &begin, &order);
  std::vector<std::int32_t> records(order.size());
  for (std::size_t k = 0; k < order.size(); ++k) {
    records[order[k]] = static_cast<std::int32_t>(k);
  }
  return records;
}

// Blocks of the family's slots are views into the rows, at the columns of the variables of factor
// 0, which are those of all factors; who factors J reads it as it was written. Zeros are needed
// from the start: columns of variables that the family does not touch are written by nobody.
void PlaceWholeRows(const Layout& layout, Linearization* cache) {
  cache->storage = JacobianStorage::kWholeRows;
  const int row_stride = PadToQuad(layout.size());
  const std::ptrdiff_t factor_stride = std::ptrdiff_t{cache->residual_size} * row_stride;
  cache->jacobian_values =
      ZeroedArray(static_cast<std::size_t>(cache->num_factors * factor_stride));
  double* const J = cache->jacobian_values.data();
  // One slot that is the whole row: passes over J need not know of blocks.
  cache->slots = {{J, factor_stride, row_stride, layout.size()}};
  cache->tangent_offsets = {0};
  for (int s = 0; cache->num_factors > 0 && s < cache->num_slots; ++s) {
    // A constant has no columns, and nobody writes to its view.
    const int position = layout.position[cache->graph->Variables(cache->id, 0)[s]];
    cache->views[s] = {J + (position < 0 ? 0 : layout.packed_offset[position]), factor_stride,
                       row_stride};
  }
}

// Slot after slot, as a product of two slots over all factors reads them: neighbors in memory are
// blocks of the same slot.
void PlaceBySlot(int num_places, Linearization* cache) {
  const auto size = static_cast<std::size_t>(FactorSize(*cache) * num_places);
  cache->jacobian_values = ComesUnwritten(size) ? ZeroedArray::Unwritten(size) : ZeroedArray(size);
  cache->capacity = num_places;
  double* next = cache->jacobian_values.data();
  for (std::size_t s = 0; s < cache->slots.size(); ++s) {
    SlotJacobians& slot = cache->slots[s];
    slot.data = next;
    next += slot.factor_stride * num_places;
    cache->views[s] = {slot.data, slot.factor_stride, slot.row_stride};
  }
}

// Linearization::records in the order of landmarks, each factor with the first that it touches and
// those without any last: passes over J go from landmark to landmark. Empty where there are none.
std::vector<std::int32_t> RecordsByLandmark(const FactorGraph& graph, const Layout& layout,
                                            FamilyId id) {
  return layout.num_landmarks() == 0 || !HasRecordsByLandmark(graph, id)
             ? std::vector<std::int32_t>()
             : SortByLandmark(graph, layout, id);
}

// Landmarks ascend, in families of any size; empty where they do so anyway, with few factors that
// touch none between them, for these go with the next landmark's chunk. A landmark's records must
// lie together and behind those of the landmarks before it, or a chunk would not be a stretch of
// records.
std::vector<std::int32_t> RecordsInChunks(const FactorGraph& graph, const Layout& layout,
                                          FamilyId id) {
  constexpr int kFew = 1024;
  int last = -1, num_others = 0;
  for (int i = 0; i < graph.NumFactors(id); ++i) {
    const int landmark = LandmarkOfFactor(graph, layout, id, i);
    if (landmark >= 0 && (landmark < last || num_others > kFew)) {
      return SortByLandmark(graph, layout, id);
    }
    num_others = landmark < 0 ? num_others + 1 : 0;
    last = std::max(last, landmark);
  }
  return {};
}

}  // namespace

// Small enough, nothing to eliminate, no free places, and all factors of a family alike. Then a
// step is a small dense factorization, for which blocks would only be gathered again. Cost: a look
// at the sizes, and a comparison of ids where these are small enough.
JacobianStorage StorageFor(const FactorGraph& graph, const Layout& layout) {
  std::int64_t num_rows = 0;
  bool whole = layout.num_landmarks() == 0 && layout.size() <= kMaxWholeColumns;
  for (FamilyId id = 0; whole && id < graph.num_families(); ++id) {
    const std::int64_t num_factors = graph.NumFactors(id);
    num_rows += num_factors * graph.family(id).residual_size();
    whole = num_rows <= kMaxWholeRows && graph.NumFreePlaces(id) == 0;
    // All factors touch the same variables if each touches those of the one before: the list of
    // ids compared with itself, shifted by one factor.
    if (whole && num_factors > 1) {
      const VariableId* ids = graph.Variables(id, 0);
      whole = std::equal(ids, ids + (num_factors - 1) * graph.family(id).num_slots(),
                         graph.Variables(id, 1));
    }
  }
  return whole ? JacobianStorage::kWholeRows : JacobianStorage::kBySlot;
}

// By all families together, since it is one memory: of those whose sizes are multiples of four
// padding adds nothing, and without any the answer is no.
bool IsPaddingDear(const FactorGraph& graph) {
  std::int64_t padded = 0, entries = 0;
  for (FamilyId id = 0; id < graph.num_families(); ++id) {
    const FactorFamily& family = graph.family(id);
    for (int s = 0; s < family.num_slots(); ++s) {
      const std::int64_t rows = std::int64_t{graph.NumFactors(id)} * family.residual_size();
      padded += rows * PadToQuad(family.slot(s).tangent_size);
      entries += rows * family.slot(s).tangent_size;
    }
  }
  return padded > entries && padded * std::int64_t{sizeof(double)} > kMostPadded;
}

// A landmark is over once another one has come: a factor of it behind that is not next to its
// others. Landmarks here are those that move by what the graph says, without a layout.
bool HasRecordsByLandmark(const FactorGraph& graph, FamilyId id) {
  if (!Linearization::MayHaveStrips(graph.NumFactors(id))) {
    return false;
  }
  std::vector<char> is_over(graph.num_variables(), 0);
  VariableId last = -1;
  for (int i = 0; i < graph.NumFactors(id); ++i) {
    const VariableId landmark = FirstOf(graph, id, i, [&](VariableId variable) {
      return graph.role(variable) == Role::kLandmark && !graph.IsConstant(variable);
    });
    if (landmark < 0 || landmark == last) {
      continue;
    }
    if (is_over[landmark] != 0) {
      return true;
    }
    if (last >= 0) {
      is_over[last] = 1;
    }
    last = landmark;
  }
  return false;
}

// By entry, so that tasks may share a family. Offsets are kept twice where records have an order of
// their own: by factor for who evaluates and corrects, by record for who passes over J.
void PlaceInTangent(const Layout& layout, std::ptrdiff_t begin, std::ptrdiff_t end,
                    Linearization* cache) {
  const VariableId* ids = begin < end ? cache->graph->Variables(cache->id, 0) : nullptr;
  for (std::ptrdiff_t k = begin; k < end; ++k) {
    const int position = ids[k] < 0 ? -1 : layout.position[ids[k]];  // a free place has none
    cache->tangent_offsets[k] = position < 0 ? -1 : layout.quad_offset[position];
    if (!cache->records.empty()) {
      const auto factor = static_cast<int>(k / cache->num_slots);
      cache->record_offsets[cache->Entry(cache->Record(factor)) + k % cache->num_slots] =
          cache->tangent_offsets[k];
    }
  }
}

// Single precision is refused to families that are small, or that prepare evaluations, and these
// keep doubles.
void PlaceJacobians(const Layout& layout, JacobianStorage storage, Linearization* cache) {
  const FactorGraph& graph = *cache->graph;
  const int num_places = graph.NumFactors(cache->id);
  cache->candidate_residuals =
      ZeroedArray(static_cast<std::size_t>(num_places) * cache->residual_size);
  cache->MakeTables(num_places);
  switch (storage) {
    case JacobianStorage::kWholeRows:
      return PlaceWholeRows(layout, cache);
    case JacobianStorage::kBySlot:
      PlaceBySlot(num_places, cache);
      break;
    case JacobianStorage::kInChunks:  // all but the Jacobians themselves
      PackRows(cache);
      cache->records = RecordsInChunks(graph, layout, cache->id);
      break;
    case JacobianStorage::kByFactor:
    case JacobianStorage::kByFactorInSingle:
      cache->PlaceByFactor(num_places,
                           storage == JacobianStorage::kByFactorInSingle &&
                               Linearization::MayKeepSingles(*cache->family, num_places),
                           RecordsByLandmark(graph, layout, cache->id));
      break;
    case JacobianStorage::kWithoutPadding:
      cache->PlaceByFactor(num_places, /*in_singles=*/false, {});
      break;
  }
  cache->tangent_offsets.resize(cache->parameters.size());
  cache->record_offsets.resize(cache->records.empty() ? 0 : cache->parameters.size());
}

// A block without a place in the tangent vector is written by no evaluation, and neither is
// padding: both stay zero. Other entries are written each time. Cost: once, a pass over what is at
// most a megabyte a family.
void ClearUnwritten(Linearization* cache) {
  if (!ComesUnwritten(cache->jacobian_values.size())) {
    return;
  }
  for (int s = 0; s < cache->num_slots; ++s) {
    const SlotJacobians& slot = cache->slots[s];
    const int padding = slot.row_stride - slot.columns;
    const std::int32_t* offset = cache->tangent_offsets.data() + s;
    double* block = slot.data;
    for (int i = 0; i < cache->num_factors;
         ++i, block += slot.factor_stride, offset += cache->num_slots) {
      if (*offset < 0) {
        std::fill_n(block, slot.factor_stride, 0.0);
      } else if (padding > 0) {
        ClearPadding(padding, slot.row_stride, block, block + slot.factor_stride);
      }
    }
  }
}

// Families of whole rows have no offsets that could be taken away.
void KeepAllOffsets(bool keep, std::vector<Linearization>* families) {
  for (Linearization& cache : *families) {
    cache.zero_blocks = ZeroBlocks();
    if (keep) {
      cache.zero_blocks.all_offsets = cache.tangent_offsets;
      cache.zero_blocks.are_zero = std::make_unique<bool[]>(cache.tangent_offsets.size());
    }
  }
}

// What a family says is for this once.
void PlaceNonzeroBlocks(int begin, int end, Linearization* cache) {
  const auto count = static_cast<int>(cache->Entry(end) - cache->Entry(begin));
  const std::int32_t* const all = cache->zero_blocks.all_offsets.data() + cache->Entry(begin);
  std::int32_t* const offsets = cache->tangent_offsets.data() + cache->Entry(begin);
  bool* const is_zero = cache->zero_blocks.are_zero.get() + cache->Entry(begin);
  for (int k = 0; k < count; ++k) {
    offsets[k] = is_zero[k] ? -1 : all[k];
  }
  std::fill_n(is_zero, count, false);
}

// The whole block with its padding, which is zero. After the correction for the loss, where a
// weight of zero makes blocks vanish, too. A block of zeros adds nothing to any sum; without an
// offset products skip it. NaN is not equal to zero, and stays in.
void LeaveOutZeroBlocks(int begin, int end, Linearization* cache) {
  std::int32_t* offset = cache->tangent_offsets.data() + cache->Entry(begin);
  for (int i = begin; i < end; ++i) {
    for (const SlotJacobians& slot : cache->slots) {
      const double* const J = slot.data + i * slot.factor_stride;
      if (*offset >= 0 &&
          std::all_of(J, J + slot.factor_stride, [](double entry) { return entry == 0.0; })) {
        *offset = -1;
      }
      ++offset;
    }
  }
}

}  // namespace inceres::internal
