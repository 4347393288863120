#include "linearize/incidences.h"

#include <algorithm>
#include <numeric>
#include <utility>

#include "base/counting_sort.h"

namespace inceres::internal {
namespace {

static_assert(sizeof(LandmarkFactors) <= 64);  // there are as many as landmarks, or more
constexpr std::size_t kFewEntries = std::size_t{1} << 14;  // a megabyte of them
constexpr int kIncidenceGrain = 1024;                      // landmarks, of a few factors each

// Symbolic elimination (docs/algorithms.md, "Schur complement"): numbers all pairs (landmark,
// frame) with a common factor, gives each block Y_li its place, and tells each factor where its
// product goes. Built once for a structure.
//
// A target is 2 · place + flag, the flag telling whether the factor adds to the block or is the
// first one there and overwrites it: so Y never has to be zeroed. Which factor is first follows
// from the order of the lists, which the kernels walk as well.
//
// Tasks take ranges of landmarks or of chunks, and each writes what belongs to these. How many
// there are depends on the threads; numbers and places follow from the problem alone, for a
// landmark's incidences are numbered by themselves and moved to where the sizes before them say.
//
// Cost: a few passes over the slots of all factors, most of them by several threads, and one over
// the incidences for each list that is sorted by frame.

struct Factor {
  const VariableId* id;   // of each slot
  std::int32_t* targets;  // likewise
  int num_slots;
};

// visit(factor) in the order in which the kernels go through a landmark's factors. `targets`: per
// family.
template <typename Visit>
void ForEachFactorOf(const LandmarkIncidences& incidences, int landmark, const Evaluator& evaluator,
                     std::vector<std::vector<std::int32_t>>* targets, const Visit& visit) {
  for (int k = incidences.factors_begin[landmark]; k < incidences.factors_begin[landmark + 1];
       ++k) {
    const LandmarkFactors& entry = incidences.factors[k];
    const Linearization& cache = evaluator.families()[incidences.FamilyOf(entry)];
    std::int32_t* const of_family = (*targets)[cache.id].data();
    const VariableId* const ids = evaluator.graph().Variables(cache.id, 0);
    for (int n = 0; n < entry.count; ++n) {
      const int factor = entry.factors[n];
      visit({ids + cache.Entry(factor), of_family + cache.Entry(cache.Record(factor)),
             entry.num_slots});
    }
  }
}

// Finds the frames of one landmark after the other. One number a frame tells whether it is known to
// this landmark: no search through a separator. Numbers are never reset between landmarks: they go
// up over all that one finder looks at, in 64 bits, so that a frame's last number tells by itself
// whether it is of this landmark. A finder takes 8 bytes a frame, and each task has one.
class FrameFinder {
 public:
  FrameFinder(const LandmarkIncidences& incidences, const Evaluator& evaluator)
      : incidences_(incidences),
        evaluator_(evaluator),
        last_place_(evaluator.layout().num_frames, -1) {}

  // Appends them and returns how many they are. Targets become 2 · the number of the frame among
  // them + (not the first factor there).
  int Find(int landmark, std::vector<std::vector<std::int32_t>>* targets,
           std::vector<std::int32_t>* frames) {
    // Places go up: one below this is that of an earlier landmark.
    const std::int64_t first = next_place_;
    ForEachFactorOf(incidences_, landmark, evaluator_, targets, [&](const Factor& factor) {
      for (int s = 0; s < factor.num_slots; ++s) {
        const int frame = evaluator_.layout().FrameOf(factor.id[s]);
        if (frame < 0) {
          continue;
        }
        std::int64_t& place = last_place_[frame];
        const bool known = place >= first;
        if (!known) {
          place = next_place_++;
          frames->push_back(frame);
        }
        factor.targets[s] = static_cast<std::int32_t>(2 * (place - first)) + (known ? 1 : 0);
      }
    });
    return static_cast<int>(next_place_ - first);
  }

 private:
  const LandmarkIncidences& incidences_;
  const Evaluator& evaluator_;
  std::vector<std::int64_t> last_place_;  // per frame
  std::int64_t next_place_ = 0;
};

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
  CutIntoChunks(evaluator, quads_per_chunk);
  PlaceBlocks(evaluator);
  SetTargets(evaluator);
  NameRecords(evaluator);
}

// Per family and slot, the factors of each landmark. A slot that holds a landmark in one factor may
// hold a frame in another. What entries of a slot have in common is put together here, pointers to
// Jacobians and residuals included; ListFactors adds the stretch of the list that is a landmark's.
// Targets are −1 where a slot has no frame: constants, and the landmark itself.
void LandmarkIncidences::CollectFactors(const Evaluator& evaluator) {
  const Layout& layout = evaluator.layout();
  // A family that no landmark goes through has no targets at all.
  y_targets_.resize(evaluator.families().size());
  std::vector<FactorsThroughSlot> slots;
  for (const Linearization& cache : evaluator.families()) {
    if (layout.num_landmarks() == 0 || cache.num_factors == 0) {
      continue;
    }
    auto& targets = y_targets_[cache.id];
    const VariableId* const ids = evaluator.graph().Variables(cache.id, 0);
    for (int slot = 0; slot < cache.num_slots; ++slot) {
      FactorsThroughSlot through;
      UnwrittenVector<std::int32_t> list;
      // The factors of one landmark stay in the family's order.
      CountingSort(
          evaluator.executor(), layout.num_landmarks(), cache.num_factors,
          [&](int i) { return layout.LandmarkOf(ids[cache.Entry(i) + slot]); }, &through.begin,
          &list);
      if (list.empty()) {
        continue;
      }
      targets.resize(cache.num_factors * static_cast<std::size_t>(cache.num_slots), -1);
      // The list's memory stays where it is when the outer vector moves: entries point into it.
      factor_lists_.push_back({cache.id, std::move(list)});
      LandmarkFactors& all = through.all;
      all.factors = factor_lists_.back().factors.data();
      all.residual_size = cache.residual_size;
      all.landmark_slot = slot;
      all.num_slots = cache.num_slots;
      all.jacobians = cache.slots.data();
      // Jᵀf of families in single precision is Evaluator::strip_gradient.
      all.residuals = cache.keeps_singles() ? nullptr : cache.residuals.data();
      all.y_targets = targets.data();
      all.tangent_offsets = cache.RecordOffsets();
      all.list = static_cast<std::int32_t>(factor_lists_.size()) - 1;
      slots.push_back(std::move(through));
    }
  }
  ListFactors(slots);
}

// By landmark, its families in their order. Families that a landmark has no factor of leave no
// entry, so entries are counted before, and the array has the size that it keeps.
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

// Finds the incidences of each landmark and notes in y_targets_, for the time being, 2 · its number
// among those of the landmark + (not the first factor there). Two rounds: the first finds the
// frames of each landmark, part by part, and how many they are; sums of these are where each
// landmark begins, and the second copies them there. Parts are ranges of landmarks, four a thread,
// for landmarks with many factors may be neighbors. The list of a part is freed as soon as it is
// copied: of a large problem both at once would be felt.
void LandmarkIncidences::CollectIncidences(const Evaluator& evaluator) {
  constexpr int kPartsPerThread = 4;
  const Layout& layout = evaluator.layout();
  const Executor& executor = evaluator.executor();
  const int count = layout.num_landmarks();
  const int num_parts =
      std::clamp(count / kIncidenceGrain, 1, kPartsPerThread * executor.num_threads());
  const auto begin_of = [&](int part) {
    return static_cast<int>(static_cast<std::int64_t>(part) * count / num_parts);
  };
  std::vector<std::vector<std::int32_t>> found(num_parts);  // the frames of a part's landmarks
  begin.assign(static_cast<std::size_t>(count) + 1, 0);
  executor.For(num_parts, 1, [&](int first, int last) {
    FrameFinder finder(*this, evaluator);
    for (int part = first; part < last; ++part) {
      for (int l = begin_of(part); l < begin_of(part + 1); ++l) {
        begin[l + 1] = finder.Find(l, &y_targets_, &found[part]);
      }
    }
  });
  std::partial_sum(begin.begin(), begin.end(), begin.begin());
  incidences.resize(begin.back());
  frames.resize(begin.back());
  landmarks.resize(begin.back());
  executor.For(num_parts, 1, [&](int first, int last) {
    for (int part = first; part < last; ++part) {
      std::copy(found[part].begin(), found[part].end(), frames.begin() + begin[begin_of(part)]);
      std::vector<std::int32_t>().swap(found[part]);
      for (int l = begin_of(part); l < begin_of(part + 1); ++l) {
        for (int q = begin[l]; q < begin[l + 1]; ++q) {
          const std::int32_t* const quads = layout.quad_offset.data() + frames[q];
          incidences[q] = {0, quads[0], quads[1] - quads[0]};
          landmarks[q] = l;
        }
      }
    }
  });
}

// One kind of storage for all of Y, so all frames must have the same size. The last column apart
// saves two quads of nine for BAL's cameras, and as much of what is read to form S. Kernels are
// told once for all blocks, hence the same size.
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

// By factor, as chunks keep them: the stride is that of a whole record.
std::int64_t LandmarkIncidences::QuadsOfJacobians(int landmark) const {
  std::int64_t quads = 0;
  for (int k = factors_begin[landmark]; k < factors_begin[landmark + 1]; ++k) {
    quads += factors[k].count * (factors[k].jacobians[0].factor_stride / kQuad);
  }
  return quads;
}

// Cut by the memory that Y takes, or Jacobians, if they come in the same chunks. At least one
// chunk, even without landmarks. What each landmark takes is found in parallel, and cutting, which
// needs the sums, is one pass over these. A chunk ends before the landmark that would not fit, so
// the largest chunk, which decides how much memory Y gets, may be that of a single landmark.
void LandmarkIncidences::CutIntoChunks(const Evaluator& evaluator, std::int64_t quads_per_chunk) {
  struct Quads {
    std::int64_t Y;
    std::int64_t J;
  };
  const bool of_jacobians = evaluator.storage() == JacobianStorage::kInChunks;
  std::vector<Quads> quads_of(num_landmarks());
  evaluator.executor().For(num_landmarks(), kIncidenceGrain, [&](int first, int last) {
    for (int l = first; l < last; ++l) {
      quads_of[l].J = of_jacobians ? QuadsOfJacobians(l) : 0;
      for (int q = begin[l]; q < begin[l + 1]; ++q) {
        quads_of[l].Y += QuadsOfBlock(q);
      }
    }
  });
  chunk_begin.assign(1, 0);
  Quads chunk = {0, 0};
  for (int l = 0; l < num_landmarks(); ++l) {
    const Quads& quads = quads_of[l];
    // A landmark that is larger than a chunk has one by itself.
    if ((chunk.Y > 0 && chunk.Y + quads.Y > quads_per_chunk) ||
        (chunk.J > 0 && chunk.J + quads.J > quads_per_chunk)) {
      chunk_begin.push_back(l);
      chunk = {0, 0};
    }
    chunk.Y += quads.Y;
    chunk.J += quads.J;
    y_quads = std::max(y_quads, chunk.Y);
  }
  chunk_begin.push_back(num_landmarks());
}

// The last chunk that begins at or before the landmark.
int LandmarkIncidences::ChunkOf(int landmark) const {
  return static_cast<int>(std::upper_bound(chunk_begin.begin(), chunk_begin.end(), landmark) -
                          chunk_begin.begin()) -
         1;
}

// Of an entry all but three numbers is the same as in others of its list. An entry is then of 12
// bytes instead of 64, and FactorsAt puts them together again for a few instructions.
void LandmarkIncidences::ShortenFactors() {
  few_numbers_.reserve(factors.size());
  of_lists_.resize(factor_lists_.size());
  for (const LandmarkFactors& entry : factors) {
    const std::int32_t* const first = factor_lists_[entry.list].factors.data();
    of_lists_[entry.list] = entry;
    of_lists_[entry.list].factors = first;
    few_numbers_.push_back({entry.list, static_cast<int>(entry.factors - first), entry.count});
  }
  std::vector<LandmarkFactors>().swap(factors);
}

// Y of one chunk is still there when it is substituted back; else Wᵀδ comes from the Jacobians. By
// frame and by incidence nothing is asked after planning. Memory is given back by swapping, as
// clearing would keep it; of few entries there is nothing to gain.
void LandmarkIncidences::ForgetPlaces() {
  if (factors.size() > kFewEntries) {
    ShortenFactors();
  }
  UnwrittenVector<std::int32_t>().swap(frames);
  UnwrittenVector<int>().swap(frame_incidences);
  UnwrittenVector<std::int32_t>().swap(landmarks);
  if (num_chunks() > 1 || tail) {
    UnwrittenVector<Incidence>().swap(incidences);
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
// block of S that are equally deep then follow each other (FramePlans::SchurSource). Chunks are
// sorted by tasks, each in its own stretch of by_size, and a counting sort by frame keeps that
// order: so a frame's list is by chunk, size and landmark. Mostly all landmarks have one size, and
// nothing is sorted.
void LandmarkIncidences::PlaceBlocks(const Evaluator& evaluator) {
  const int num_frames = evaluator.layout().num_frames;
  const Executor& executor = evaluator.executor();
  std::vector<int> by_size;  // within each chunk
  const bool alike =
      std::all_of(sizes.begin(), sizes.end(), [this](char size) { return size == largest_size; });
  if (!alike) {
    by_size.resize(incidences.size());
    std::iota(by_size.begin(), by_size.end(), 0);
  }
  executor.For(num_chunks(), 1, [&](int first, int last) {
    std::vector<std::int64_t> next;
    for (int chunk = first; chunk < last; ++chunk) {
      int* const order = alike ? nullptr : by_size.data();
      PlaceBlocksOf(chunk, num_frames, order, &next);
    }
  });
  const auto incidence = [&](int i) { return alike ? i : by_size[i]; };
  CountingSort(
      executor, num_frames, static_cast<int>(incidences.size()),
      [&](int i) { return frames[incidence(i)]; }, &frame_begin, &frame_incidences);
  if (!alike) {
    std::transform(frame_incidences.begin(), frame_incidences.end(), frame_incidences.begin(),
                   incidence);
  }
}

// Puts the chunk's part of `order`, unless null, by size. All chunks begin at 0: they use the same
// memory one after the other. `next`: where the next block of each frame goes. A counting sort by
// frame of blocks of unlike length: first how many quads each frame has in the chunk, whose sums
// are where it begins, then each block takes the next place of its frame.
void LandmarkIncidences::PlaceBlocksOf(int chunk, int num_frames, int* order,
                                       std::vector<std::int64_t>* next) {
  const int first = begin[chunk_begin[chunk]];
  const int last = begin[chunk_begin[chunk + 1]];
  if (order != nullptr) {
    std::stable_sort(order + first, order + last,
                     [this](int a, int b) { return sizes[landmarks[a]] < sizes[landmarks[b]]; });
  }
  next->assign(static_cast<std::size_t>(num_frames) + 1, 0);
  for (int q = first; q < last; ++q) {
    (*next)[frames[q] + 1] += QuadsOfBlock(q);
  }
  std::partial_sum(next->begin(), next->end(), next->begin());
  for (int i = first; i < last; ++i) {
    const int q = order != nullptr ? order[i] : i;
    std::int64_t& next_quad = (*next)[frames[q]];
    incidences[q].y = static_cast<std::int32_t>(next_quad);
    next_quad += QuadsOfBlock(q);
  }
}

// From the number of an incidence to its place, the flag kept. In the same order as FrameFinder
// went, by tasks over landmarks: a factor has one landmark, so no target is written twice.
void LandmarkIncidences::SetTargets(const Evaluator& evaluator) {
  evaluator.executor().For(num_landmarks(), kIncidenceGrain, [&](int first, int last) {
    for (int l = first; l < last; ++l) {
      const Incidence* const of_landmark = incidences.data() + begin[l];
      ForEachFactorOf(*this, l, evaluator, &y_targets_, [&](const Factor& factor) {
        for (int s = 0; s < factor.num_slots; ++s) {
          std::int32_t& target = factor.targets[s];
          target = target < 0 ? target : 2 * of_landmark[target >> 1].y + (target & 1);
        }
      });
    }
  });
}

// Kernels know factors by their records. Last, since what is above asks the graph, which knows
// factors by their own numbers. Where records have the order of the factors there is nothing to do.
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
