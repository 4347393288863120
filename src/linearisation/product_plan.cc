#include "linearisation/product_plan.h"

#include <algorithm>
#include <map>
#include <numeric>
#include <tuple>

namespace inceres::internal {
namespace {

// The factors that touch each frame through one slot of one family.
struct SlotAdjacency {
  std::vector<int> begin;  // per frame, one more
  std::vector<std::int32_t> factors;
};

SlotAdjacency FactorsByFrame(const FamilyCache& cache, const FactorGraph& graph, const Layout& layout, int slot) {
  const int num_slots = cache.family->num_slots();
  const VariableId* ids = graph.Variables(cache.id, 0);
  SlotAdjacency adjacency;
  adjacency.begin.assign(layout.num_frames + 1, 0);
  const auto frame_of = [&](int i) { return layout.FrameOf(ids[static_cast<std::ptrdiff_t>(i) * num_slots + slot]); };
  for (int i = 0; i < cache.num_factors; ++i) {
    const int frame = frame_of(i);
    if (frame >= 0) {
      ++adjacency.begin[frame + 1];
    }
  }
  std::partial_sum(adjacency.begin.begin(), adjacency.begin.end(), adjacency.begin.begin());
  adjacency.factors.resize(adjacency.begin.back());
  std::vector<int> next(adjacency.begin.begin(), adjacency.begin.end() - 1);
  for (int i = 0; i < cache.num_factors; ++i) {
    const int frame = frame_of(i);
    if (frame >= 0) {
      adjacency.factors[next[frame]++] = i;
    }
  }
  return adjacency;
}

// The terms of one block row, collected in a fixed order and then sorted by column, order kept.
class RowTerms {
 public:
  void Add(int column, int source, ProductTerm term) { entries_.push_back({column, source, term}); }

  template <typename Function>
  void ForEachColumn(Function&& function) const {
    for (const Entry& entry : entries_) {
      function(entry.column);
    }
  }

  // Appends the row to the plan. slot_of_column maps a column to its place among the row's num_columns blocks.
  void AppendTo(const std::vector<int>& slot_of_column, int num_columns, ProductPlan* plan) {
    start_.assign(num_columns + 1, 0);
    for (const Entry& entry : entries_) {
      ++start_[slot_of_column[entry.column] + 1];
    }
    std::partial_sum(start_.begin(), start_.end(), start_.begin());
    const std::size_t base = plan->terms.size();
    plan->terms.resize(base + entries_.size());
    sources_.resize(entries_.size());
    next_.assign(start_.begin(), start_.end() - 1);
    for (const Entry& entry : entries_) {
      const auto column = static_cast<std::size_t>(slot_of_column[entry.column]);
      const auto place = static_cast<std::size_t>(next_[column]++);
      plan->terms[base + place] = entry.term;
      sources_[place] = entry.source;
    }
    for (std::size_t c = 0; c < static_cast<std::size_t>(num_columns); ++c) {
      plan->segments_begin.push_back(static_cast<int>(plan->segments.size()));
      for (int first = start_[c]; first < start_[c + 1];) {
        int last = first;
        while (last < start_[c + 1] && sources_[last] == sources_[first]) {
          ++last;
        }
        plan->segments.push_back({sources_[first], static_cast<int>(base) + first, last - first});
        first = last;
      }
    }
    entries_.clear();
  }

 private:
  struct Entry {
    int column;
    int source;
    ProductTerm term;
  };
  std::vector<Entry> entries_;
  std::vector<int> start_;
  std::vector<int> next_;
  std::vector<int> sources_;
};

class PlanBuilder {
 public:
  PlanBuilder(const Evaluator& evaluator, const LandmarkIncidences& incidences, FramePlans* plans)
      : evaluator_(evaluator), layout_(evaluator.layout()), incidences_(incidences), plans_(plans) {
    for (const FamilyCache& cache : evaluator.families()) {
      auto& slots = adjacency_.emplace_back();
      for (int s = 0; cache.num_factors > 0 && s < cache.family->num_slots(); ++s) {
        slots.push_back(FactorsByFrame(cache, evaluator.graph(), layout_, s));
      }
    }
  }

  void Build() {
    for (int chunk = 0; chunk < incidences_.num_chunks(); ++chunk) {
      for (int size = 1; size <= LandmarkIncidences::kMaxLandmarkSize; ++size) {
        plans_->schur_sources.push_back({chunk, size});
      }
    }
    BlockPattern& pattern = plans_->pattern;
    const int num_frames = layout_.num_frames;
    ReserveTerms();
    pattern.offsets.assign(layout_.packed_offset.begin(), layout_.packed_offset.begin() + num_frames + 1);
    pattern.row_begin.push_back(0);
    pattern.value_begin.push_back(0);
    std::vector<int> marked(num_frames, -1);
    std::vector<int> slot_of_column(num_frames, 0);
    std::vector<int> columns;
    for (int row = 0; row < num_frames; ++row) {
      CollectHessianTerms(row);
      CollectSchurTerms(row);
      columns.assign(1, row);
      marked[row] = row;
      const auto mark = [&](int column) {
        if (marked[column] != row) {
          marked[column] = row;
          columns.push_back(column);
        }
      };
      hessian_row_.ForEachColumn(mark);
      schur_row_.ForEachColumn(mark);
      std::sort(columns.begin(), columns.end());
      for (std::size_t c = 0; c < columns.size(); ++c) {
        slot_of_column[columns[c]] = static_cast<int>(c);
        pattern.columns.push_back(columns[c]);
        pattern.value_begin.push_back(pattern.value_begin.back() +
                                      static_cast<std::int64_t>(pattern.block_size(row)) * pattern.block_size(columns[c]));
        plans_->block_row.push_back(row);
      }
      pattern.row_begin.push_back(static_cast<int>(pattern.columns.size()));
      hessian_row_.AppendTo(slot_of_column, static_cast<int>(columns.size()), &plans_->hessian);
      schur_row_.AppendTo(slot_of_column, static_cast<int>(columns.size()), &plans_->schur);
    }
    plans_->hessian.segments_begin.push_back(static_cast<int>(plans_->hessian.segments.size()));
    plans_->schur.segments_begin.push_back(static_cast<int>(plans_->schur.segments.size()));
  }

 private:
  // There are millions of terms: growing by doubling would take up to three times their memory.
  void ReserveTerms() {
    std::size_t num_schur_terms = 0;
    for (std::size_t l = 0; l + 1 < incidences_.begin.size(); ++l) {
      const auto views = static_cast<std::size_t>(incidences_.begin[l + 1] - incidences_.begin[l]);
      num_schur_terms += views * (views + 1) / 2;
    }
    plans_->schur.terms.reserve(num_schur_terms);
    std::size_t num_hessian_terms = 0;
    for (const std::vector<SlotAdjacency>& slots : adjacency_) {
      for (const SlotAdjacency& slot : slots) {
        num_hessian_terms += slot.factors.size();  // what is off the diagonal is added where it is found
      }
    }
    plans_->hessian.terms.reserve(num_hessian_terms);
  }

  int SourceIndex(int family, int row_slot, int column_slot) {
    const auto key = std::make_tuple(family, row_slot, column_slot);
    const auto [entry, inserted] = source_index_.try_emplace(key, static_cast<int>(plans_->hessian_sources.size()));
    if (inserted) {
      plans_->hessian_sources.push_back({family, row_slot, column_slot});
    }
    return entry->second;
  }

  void CollectHessianTerms(int row) {
    for (const FamilyCache& cache : evaluator_.families()) {
      const int num_slots = cache.family->num_slots();
      const auto& slots = adjacency_[cache.id];
      for (int r = 0; r < num_slots && !slots.empty(); ++r) {
        const SlotAdjacency& adjacency = slots[r];
        const int begin = adjacency.begin[row];
        const int end = adjacency.begin[row + 1];
        for (int c = 0; begin < end && c < num_slots; ++c) {
          CollectSlotPair(cache, row, r, c, adjacency.factors.data() + begin, end - begin);
        }
      }
    }
  }

  void CollectSlotPair(const FamilyCache& cache, int row, int r, int c, const std::int32_t* factors, int count) {
    const VariableId* ids = evaluator_.graph().Variables(cache.id, 0);
    const auto row_quads = static_cast<std::int32_t>(cache.slots[r].factor_stride / kQuad);
    const auto column_quads = static_cast<std::int32_t>(cache.slots[c].factor_stride / kQuad);
    int source = -1;
    for (int n = 0; n < count; ++n) {
      const std::int32_t i = factors[n];
      const int column = layout_.FrameOf(ids[static_cast<std::ptrdiff_t>(i) * cache.family->num_slots() + c]);
      if (column < 0 || column > row) {
        continue;
      }
      if (source < 0) {
        source = SourceIndex(cache.id, r, c);
      }
      hessian_row_.Add(column, source, {i * column_quads, i * row_quads});
    }
  }

  void CollectSchurTerms(int row) {
    for (int k = incidences_.frame_begin[row]; k < incidences_.frame_begin[row + 1]; ++k) {
      const auto q = static_cast<std::size_t>(incidences_.frame_incidences[k]);
      const auto l = static_cast<std::size_t>(incidences_.landmarks[q]);
      const int chunk = incidences_.ChunkOf(incidences_.landmarks[q]);
      const int source = LandmarkIncidences::kMaxLandmarkSize * chunk + incidences_.sizes[l] - 1;  // see Build
      for (int other = incidences_.begin[l]; other < incidences_.begin[l + 1]; ++other) {
        const int column = incidences_.frames[other];
        if (column <= row) {
          schur_row_.Add(column, source, {incidences_.incidences[other].y, incidences_.incidences[q].y});
        }
      }
    }
  }

  const Evaluator& evaluator_;
  const Layout& layout_;
  const LandmarkIncidences& incidences_;
  FramePlans* plans_;
  std::vector<std::vector<SlotAdjacency>> adjacency_;  // per family and slot
  std::map<std::tuple<int, int, int>, int> source_index_;
  RowTerms hessian_row_;
  RowTerms schur_row_;
};

}  // namespace

FramePlans::FramePlans(const Evaluator& evaluator, const LandmarkIncidences& incidences) {
  PlanBuilder(evaluator, incidences, this).Build();
}

}  // namespace inceres::internal
