#include "linearize/incidences.h"

#include <algorithm>
#include <functional>
#include <numeric>

#include "base/counting_sort.h"

namespace inceres::internal {
namespace {

constexpr std::size_t kFewEntries = std::size_t{1} << 14;  // a megabyte of LandmarkFactors

// Symbolic elimination (docs/algorithms.md, "Schur complement"): numbers all pairs (landmark,
// frame) with a common factor, gives each block Y_li its place, and tells each factor where its
// product goes. Built once for a structure.
//
// A target is 2 · place + flag, the flag telling whether the factor adds to the block or is the
// first one there and overwrites it: so Y never has to be zeroed. Which factor is first follows
// from the order of the lists, which the kernels walk as well.

// Landmark of each factor through one slot, or -1.
std::vector<std::int32_t> LandmarksThroughSlot(const Linearization& cache, const FactorGraph& graph,
                                               const Layout& layout, int slot, bool* any) {
  const int num_slots = cache.num_slots;
  std::vector<std::int32_t> landmark(cache.num_factors, -1);
  *any = false;
  const VariableId* id = cache.num_factors > 0 ? graph.Variables(cache.id, 0) + slot : nullptr;
  for (int i = 0; i < cache.num_factors; ++i, id += num_slots) {
    landmark[i] = layout.LandmarkOf(*id);
    *any |= landmark[i] >= 0;
  }
  return landmark;
}

}  // namespace

// First who touches whom, then how blocks are stored, then where: each step needs the one before.
LandmarkIncidences::LandmarkIncidences(const Evaluator& evaluator, std::int64_t quads_per_chunk,
                                       bool may_have_tail) {
  const Layout& layout = evaluator.layout();
  const int num_landmarks = layout.num_landmarks();
  sizes.resize(num_landmarks);
  for (int l = 0; l < num_landmarks; ++l) {
    sizes[l] = static_cast<char>(layout.TangentSize(layout.num_frames + l));
    largest_size = std::max<int>(largest_size, sizes[l]);
  }
  CollectFactors(evaluator);
  CollectIncidences(evaluator);
  ChooseStorage(layout, may_have_tail);
  CutIntoChunks(quads_per_chunk, evaluator.storage() == JacobianStorage::kInChunks);
  PlaceBlocks(layout);
  SetTargets();
  NameRecords(evaluator);
}

// Per family and slot, the factors of each landmark. A slot that holds a landmark in one factor
// may hold a frame in another.
void LandmarkIncidences::CollectFactors(const Evaluator& evaluator) {
  const Layout& layout = evaluator.layout();
  const auto num_landmarks = static_cast<std::size_t>(layout.num_landmarks());
  // A family that no landmark goes through has no targets at all.
  y_targets_.resize(evaluator.families().size());
  std::vector<FactorsThroughSlot> slots;
  for (const Linearization& cache : evaluator.families()) {
    if (num_landmarks == 0) {
      break;
    }
    auto& targets = y_targets_[cache.id];
    for (int slot = 0; slot < cache.num_slots; ++slot) {
      bool any = false;
      const std::vector<std::int32_t> landmark =
          LandmarksThroughSlot(cache, evaluator.graph(), layout, slot, &any);
      if (!any) {
        continue;
      }
      targets.resize(cache.num_factors * static_cast<std::size_t>(cache.num_slots), -1);
      // The factors of one landmark stay in the family's order.
      const auto for_each_factor = [&landmark](const auto& add) {
        for (std::size_t i = 0; i < landmark.size(); ++i) {
          if (landmark[i] >= 0) {
            add(landmark[i], static_cast<std::int32_t>(i));
          }
        }
      };
      // The list's memory stays where it is when the outer vector moves: entries point into it.
      std::vector<std::int32_t>& list =
          factor_lists_.emplace_back(FactorList{cache.id, {}}).factors;
      FactorsThroughSlot& through = slots.emplace_back();
      CountingSort(num_landmarks, for_each_factor, &through.begin, &list);
      LandmarkFactors& all = through.all;
      all.factors = list.data();
      all.residual_size = cache.residual_size;
      all.landmark_slot = slot;
      all.num_slots = cache.num_slots;
      all.jacobians = cache.slots.data();
      // Jᵀf of families in single precision is Evaluator::strip_gradient.
      all.residuals = cache.keeps_singles() ? nullptr : cache.residuals.data();
      all.y_targets = targets.data();
      all.tangent_offsets = cache.RecordOffsets();
    }
  }
  ListFactors(slots);
}

// By landmark, its families in their order.
void LandmarkIncidences::ListFactors(const std::vector<FactorsThroughSlot>& slots) {
  std::size_t num_entries = 0;
  for (const FactorsThroughSlot& through : slots) {
    for (std::size_t l = 0; l < sizes.size(); ++l) {
      num_entries += through.begin[l + 1] > through.begin[l] ? 1 : 0;
    }
  }
  factors.reserve(num_entries);
  factors_begin.reserve(sizes.size() + 1);
  factors_begin.assign(1, 0);
  for (std::size_t l = 0; l < sizes.size(); ++l) {
    for (const FactorsThroughSlot& through : slots) {
      if (through.begin[l + 1] > through.begin[l]) {
        LandmarkFactors& entry = factors.emplace_back(through.all);
        entry.factors += through.begin[l];
        entry.count = through.begin[l + 1] - through.begin[l];
      }
    }
    factors_begin.push_back(static_cast<int>(factors.size()));
  }
}

// Numbers the incidences and notes in y_targets_, for the time being, 2 · incidence + (not the
// first factor there).
void LandmarkIncidences::CollectIncidences(const Evaluator& evaluator) {
  const Layout& layout = evaluator.layout();
  const FactorGraph& graph = evaluator.graph();
  // One number a frame tells whether it is known to this landmark: no search through a separator.
  std::vector<int> last_seen(layout.num_frames, -1);  // incidence of the frame's last landmark
  const Linearization* owner = nullptr;               // of the factors at hand
  std::size_t num_factors = 0;                        // most with one frame each
  for (const LandmarkFactors& entry : factors) {
    num_factors += static_cast<std::size_t>(entry.count);
  }
  incidences.reserve(num_factors);
  frames.reserve(num_factors);
  landmarks.reserve(num_factors);
  begin.reserve(sizes.size() + 1);
  begin.push_back(0);
  for (std::size_t l = 0; l < sizes.size(); ++l) {
    for (int k = factors_begin[l]; k < factors_begin[l + 1]; ++k) {
      const LandmarkFactors& entry = factors[k];
      owner = &OwnerOf(entry, evaluator.families(), owner);
      std::int32_t* const targets = y_targets_[owner->id].data();
      const VariableId* const ids = graph.Variables(owner->id, 0);
      const int first_incidence = begin.back();
      // In the order in which the kernels go through the factors.
      for (int n = 0; n < entry.count; ++n) {
        const int factor = entry.factors[n];
        const VariableId* const id = ids + owner->Entry(factor);
        std::int32_t* const target = targets + owner->Entry(owner->Record(factor));
        for (int s = 0; s < entry.num_slots; ++s) {
          const int frame = layout.FrameOf(id[s]);
          if (frame < 0) {
            continue;
          }
          int& seen = last_seen[frame];
          // Incidences are numbered landmark by landmark: a number below this one's first is that
          // of an earlier landmark.
          const bool known = seen >= first_incidence;
          if (!known) {
            seen = static_cast<int>(incidences.size());
            const std::int32_t* const quads = layout.quad_offset.data() + frame;
            incidences.push_back({0, quads[0], quads[1] - quads[0]});
            frames.push_back(frame);
            landmarks.push_back(static_cast<std::int32_t>(l));
          }
          target[s] = 2 * seen + (known ? 1 : 0);
        }
      }
    }
    begin.push_back(static_cast<int>(incidences.size()));
  }
}

// One kind of storage for all of Y, so all frames must have the same size.
void LandmarkIncidences::ChooseStorage(const Layout& layout, bool may_have_tail) {
  const int size = frames.empty() ? 0 : layout.TangentSize(frames[0]);
  tail = may_have_tail && MayHaveTail(size) &&
         std::all_of(frames.begin(), frames.end(),
                     [&](std::int32_t frame) { return layout.TangentSize(frame) == size; });
  for (LandmarkFactors& entry : factors) {
    entry.y_tail = tail;
  }
}

// In quads, with the padding.
int LandmarkIncidences::QuadsOfBlock(int incidence) const {
  const int depth = sizes[landmarks[incidence]];
  const int row_quads = incidences[incidence].quads;
  // Sizes that may have a tail are one more than whole quads, so that the size follows from the
  // quads.
  return tail ? QuadsWithTail(depth, (row_quads - 1) * kQuad + 1) : depth * row_quads;
}

std::int64_t LandmarkIncidences::QuadsOfJacobians(int landmark) const {
  std::int64_t quads = 0;
  for (int k = factors_begin[landmark]; k < factors_begin[landmark + 1]; ++k) {
    quads += factors[k].count * (factors[k].jacobians[0].factor_stride / kQuad);
  }
  return quads;
}

// Cut by the memory that Y takes, or Jacobians, if they come in the same chunks. At least one
// chunk, even without landmarks.
void LandmarkIncidences::CutIntoChunks(std::int64_t quads_per_chunk, bool of_jacobians) {
  chunk_begin.assign(1, 0);
  std::int64_t chunk_quads = 0, chunk_J = 0;
  for (int l = 0; l < num_landmarks(); ++l) {
    std::int64_t quads = 0;
    for (int q = begin[l]; q < begin[l + 1]; ++q) {
      quads += QuadsOfBlock(q);
    }
    const std::int64_t J = of_jacobians ? QuadsOfJacobians(l) : 0;
    // A landmark that is larger than a chunk has one by itself.
    if ((chunk_quads > 0 && chunk_quads + quads > quads_per_chunk) ||
        (chunk_J > 0 && chunk_J + J > quads_per_chunk)) {
      chunk_begin.push_back(l);
      chunk_quads = chunk_J = 0;
    }
    chunk_quads += quads;
    chunk_J += J;
    y_quads = std::max(y_quads, chunk_quads);
  }
  chunk_begin.push_back(num_landmarks());
}

// The last chunk that begins at or before the landmark.
int LandmarkIncidences::ChunkOf(int landmark) const {
  return static_cast<int>(std::upper_bound(chunk_begin.begin(), chunk_begin.end(), landmark) -
                          chunk_begin.begin()) -
         1;
}

// Of an entry all but three numbers is the same as in others.
void LandmarkIncidences::ShortenFactors() {
  few_numbers_.reserve(factors.size());
  for (const FactorList& list : factor_lists_) {
    LandmarkFactors& of_slot = of_slots_.emplace_back();
    of_slot.factors = list.factors.data();
  }
  for (const LandmarkFactors& entry : factors) {
    int slot = 0;
    for (const std::less<> before;
         before(entry.factors, factor_lists_[slot].factors.data()) ||
         !before(entry.factors,
                 factor_lists_[slot].factors.data() + factor_lists_[slot].factors.size());) {
      ++slot;
    }
    LandmarkFactors& of_slot = of_slots_[slot];
    const std::int32_t* const first = of_slot.factors;
    of_slot = entry;
    of_slot.factors = first;
    few_numbers_.push_back({slot, static_cast<int>(entry.factors - first), entry.count});
  }
  std::vector<LandmarkFactors>().swap(factors);
}

// Y of one chunk is still there when it is substituted back; else Wᵀδ comes from the Jacobians.
void LandmarkIncidences::ForgetPlaces() {
  if (factors.size() > kFewEntries) {
    ShortenFactors();
  }
  std::vector<std::int32_t>().swap(frames);
  std::vector<int>().swap(frame_incidences);
  std::vector<std::int32_t>().swap(landmarks);
  if (num_chunks() > 1 || tail) {
    std::vector<Incidence>().swap(incidences);
  }
}

// But for what is there by frame.
std::int64_t LandmarkIncidences::Bytes() const {
  const std::size_t bytes = incidences.capacity() * sizeof(Incidence) +
                            factors.capacity() * sizeof(LandmarkFactors) +
                            few_numbers_.capacity() * sizeof(FewNumbers) + sizes.capacity();
  std::size_t numbers = begin.capacity() + frames.capacity() + frame_incidences.capacity() +
                        landmarks.capacity() + factors_begin.capacity();
  for (const FactorList& list : factor_lists_) {
    numbers += list.factors.capacity();
  }
  for (const auto& targets : y_targets_) {
    numbers += targets.capacity();
  }
  return static_cast<std::int64_t>(bytes + numbers * sizeof(std::int32_t));
}

// Blocks of a frame lie together within a chunk, and within these by landmark size: the terms of a
// block of S that are equally deep then follow each other (FramePlans::SchurSource).
void LandmarkIncidences::PlaceBlocks(const Layout& layout) {
  frame_begin.assign(layout.num_frames + 1, 0);
  for (const int frame : frames) {
    ++frame_begin[frame + 1];
  }
  std::partial_sum(frame_begin.begin(), frame_begin.end(), frame_begin.begin());
  frame_incidences.resize(incidences.size());
  const auto smallest = std::min_element(sizes.begin(), sizes.end());
  // Counting sort once more: `next` is where the frame's next block goes.
  std::vector<int> next(frame_begin.begin(), frame_begin.end() - 1);
  for (int chunk = 0; chunk < num_chunks(); ++chunk) {
    const int first = begin[chunk_begin[chunk]];
    const int last = begin[chunk_begin[chunk + 1]];
    for (int size = last > first ? *smallest : 1; last > first && size <= largest_size; ++size) {
      for (int q = first; q < last; ++q) {
        if (sizes[landmarks[q]] == size) {
          frame_incidences[next[frames[q]]++] = q;
        }
      }
    }
  }
  // All chunks begin at 0: they use the same memory one after the other.
  std::vector<std::int64_t> chunk_quads(num_chunks(), 0);
  int chunk = 0;
  for (const int q : frame_incidences) {
    // A frame's incidences ascend by chunk: mostly that of the one before, or one soon after it.
    const int landmark = landmarks[q];
    chunk = landmark < chunk_begin[chunk] ? 0 : chunk;
    while (landmark >= chunk_begin[chunk + 1]) {
      ++chunk;
    }
    std::int64_t& next_quad = chunk_quads[chunk];
    incidences[q].y = static_cast<std::int32_t>(next_quad);
    next_quad += QuadsOfBlock(q);
  }
}

// From the number of an incidence to its place, the flag kept.
void LandmarkIncidences::SetTargets() {
  for (auto& targets : y_targets_) {
    for (std::int32_t& target : targets) {
      if (target >= 0) {
        target = 2 * incidences[target >> 1].y + (target & 1);
      }
    }
  }
}

// Kernels know factors by their records.
void LandmarkIncidences::NameRecords(const Evaluator& evaluator) {
  for (FactorList& list : factor_lists_) {
    const Linearization& cache = evaluator.families()[list.family];
    if (!cache.records.empty()) {
      std::transform(list.factors.begin(), list.factors.end(), list.factors.begin(),
                     [&](std::int32_t factor) { return cache.Record(factor); });
    }
  }
}

}  // namespace inceres::internal
