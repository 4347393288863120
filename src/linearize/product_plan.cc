#include "linearize/product_plan.h"

#include <algorithm>
#include <utility>
#include <vector>

#include "base/counting_sort.h"
#include "linear/pattern_rows.h"

namespace inceres::internal {
namespace {

// The symbolic half of all sums of blocks: which products Jᵢᵀ Jⱼ make up C_ij, and which Y_li
// Y_ljᵀ make up what S_ij loses (docs/algorithms.md, "Schur complement" and "Determinism"). Found
// once for a structure, it is a list of terms for each block of the lower triangle, each term a
// pair of places in memory, grouped in segments whose terms have the same source, so one kernel
// call with fixed sizes does a segment. The order of terms is that of the plan, and a block is
// summed by one task: so the sum has the same bits for any number of threads.
//
// A block on the diagonal takes products of its frame's own factors, and the gradient and b take
// the same factors, in the same order: a term says where both are.
//
// Terms may outnumber everything else in a problem. They are therefore met twice, to be counted
// and to be written, and are never stored in between; memory is asked for between the two passes.

// The factors that touch each frame through one slot of one family.
struct SlotAdjacency {
  std::vector<int> begin;  // per frame, one more
  UnwrittenVector<std::int32_t> factors;
};

// Factors of one frame stay in ascending order, and with them the terms.
SlotAdjacency FactorsByFrame(const Linearization& cache, const Evaluator& evaluator, int slot) {
  const Layout& layout = evaluator.layout();
  const std::ptrdiff_t num_slots = cache.num_slots;
  const VariableId* const ids = evaluator.graph().Variables(cache.id, 0) + slot;
  SlotAdjacency adjacency;
  CountingSort(
      evaluator.executor(), layout.num_frames, cache.num_factors,
      [&](int i) { return layout.FrameOf(ids[i * num_slots]); }, &adjacency.begin,
      &adjacency.factors);
  return adjacency;
}

// The blocks of J that are there, of a family many of whose are left out: by factor, and by the
// frame they belong to.
// With dynamic sparsity most slots of a family may be empty, and going through all pairs of its
// slots would cost their square.
struct SparseBlocks {
  struct Block {
    int slot;
    int frame;
  };
  struct Place {
    int factor;
    int slot;
  };
  std::vector<int> factor_begin;  // per factor, one more
  std::vector<Block> blocks;
  std::vector<int> frame_begin;  // per frame, one more
  std::vector<Place> places;
};

SparseBlocks FindSparseBlocks(const Linearization& cache, const FactorGraph& graph,
                              const Layout& layout) {
  const std::ptrdiff_t num_slots = cache.num_slots;
  const VariableId* ids = graph.Variables(cache.id, 0);
  // Blocks by factor, and from these places by frame.
  SparseBlocks sparse;
  sparse.factor_begin.push_back(0);
  for (std::ptrdiff_t i = 0; i < cache.num_factors; ++i) {
    for (std::ptrdiff_t s = 0; s < num_slots; ++s) {
      // A block that was left out has no offset; a landmark has no frame.
      const int frame = cache.tangent_offsets[i * num_slots + s] < 0
                            ? -1
                            : layout.FrameOf(ids[i * num_slots + s]);
      if (frame >= 0) {
        sparse.blocks.push_back({static_cast<int>(s), frame});
      }
    }
    sparse.factor_begin.push_back(static_cast<int>(sparse.blocks.size()));
  }
  const auto for_each_place = [&](const auto& add) {
    for (int i = 0; i < cache.num_factors; ++i) {
      for (int k = sparse.factor_begin[i]; k < sparse.factor_begin[i + 1]; ++k) {
        add(sparse.blocks[k].frame, SparseBlocks::Place{i, sparse.blocks[k].slot});
      }
    }
  };
  CountingSort(layout.num_frames, for_each_place, &sparse.frame_begin, &sparse.places);
  return sparse;
}

// How much of a plan falls to one block.
// A segment ends wherever the source changes, so a source that comes back counts again.
struct Share {
  // Called once for each term, in the plan's order.
  void Add(int source) {
    ++num_terms;
    num_segments += last_source != source ? 1 : 0;
    last_source = source;
  }

  int num_terms = 0;
  int num_segments = 0;
  int last_source = -1;
};

// A block of a row.
struct CountedBlock {
  int column = -1;
  Share hessian;
  Share schur;
};

// Rows are counted, then every block is given its place, then rows are filled in: the rows of
// either pass are independent tasks, and nothing is stored twice. Both passes meet the terms of a
// block in the same order, by source.
class PlanBuilder {
 public:
  PlanBuilder(const Evaluator& evaluator, const LandmarkIncidences& incidences, SchurBlocks blocks,
              const FrameClusters* clusters, FramePlans* plans)
      : evaluator_(evaluator),
        layout_(evaluator.layout()),
        incidences_(incidences),
        schur_blocks_(blocks),
        clusters_(blocks == SchurBlocks::kClustered ? clusters : nullptr),
        plans_(plans) {
    for (const Linearization& cache : evaluator.families()) {
      auto& slots = adjacency_.emplace_back();
      auto& sparse = sparse_.emplace_back();
      // Sources of a family are all ordered pairs of its slots, row slot major.
      first_source_.push_back(static_cast<int>(plans->hessian_sources.size()));
      if (cache.num_factors > 0 && evaluator.leaves_out_zero_blocks()) {
        sparse = FindSparseBlocks(cache, evaluator.graph(), layout_);
      }
      for (int s = 0; cache.num_factors > 0 && s < cache.num_slots; ++s) {
        if (!evaluator.leaves_out_zero_blocks()) {
          slots.push_back(FactorsByFrame(cache, evaluator, s));
        }
        for (int c = 0; c < cache.num_slots; ++c) {
          plans->hessian_sources.push_back({cache.id, s, c});
        }
      }
    }
    // One source a chunk and landmark size: by chunk, because Y of one chunk is in memory at a
    // time, and by size, because a kernel has one depth.
    for (int chunk = 0; chunk < incidences.num_chunks(); ++chunk) {
      const auto first_source = static_cast<int>(plans->schur_sources.size());
      for (int size = 1; size <= LandmarkIncidences::kMaxLandmarkSize; ++size) {
        plans->schur_sources.push_back({chunk, size});
      }
      for (int l = incidences.chunk_begin[chunk]; l < incidences.chunk_begin[chunk + 1]; ++l) {
        source_of_landmark_.push_back(first_source + incidences.sizes[l] - 1);
      }
    }
  }

  // Rows of the lower triangle are independent: each block belongs to one row.
  void Build() {
    const int num_frames = layout_.num_frames;
    rows_.resize(num_frames);
    // At most about kTasks tasks: each has a table over all columns.
    const int grain = std::max(1, num_frames / kTasks);
    const Executor& executor = evaluator_.executor();
    executor.For(num_frames, grain, [this](int begin, int end) { CountRows(begin, end); });
    Place();
    executor.For(num_frames, grain, [this](int begin, int end) { FillRows(begin, end); });
  }

 private:
  static constexpr int kTasks = 32;
  // Bytes of a block: its row and column, where its values, those of C, and its segments in either
  // plan begin, and its place in the first chunk.
  static constexpr std::int64_t kBlock = 6 * sizeof(std::int32_t) + 2 * sizeof(std::int64_t);
  // Of a segment, and the place of its block in a later chunk.
  static constexpr std::int64_t kSegment = sizeof(ProductPlan::Segment) + 2 * sizeof(std::int32_t);
  // Of a row: b, and vectors that solvers have.
  static constexpr std::int64_t kRow = 4 * sizeof(double);

  void CountRows(int begin, int end) {
    // One entry a column, reset by exchange as rows are finished: cleaning costs the row's blocks
    // only.
    std::vector<CountedBlock> by_column(layout_.num_frames);
    std::vector<int> columns;
    for (int row = begin; row < end; ++row) {
      const auto block = [&](int column) -> CountedBlock& {
        CountedBlock& counted = by_column[column];
        if (counted.column < 0) {
          counted.column = column;
          columns.push_back(column);
        }
        return counted;
      };
      block(row);  // whatever there is, it has a diagonal
      ForEachHessianTerm(
          row, [&](int column, int source, ProductTerm) { block(column).hessian.Add(source); });
      ForEachSchurTerm(
          row, [&](int column, int source, ProductTerm) { block(column).schur.Add(source); });
      // Only the columns are sorted; the terms keep the order in which they are met.
      std::sort(columns.begin(), columns.end());
      rows_[row].reserve(columns.size());
      for (const int column : columns) {
        rows_[row].push_back(std::exchange(by_column[column], CountedBlock()));
      }
      columns.clear();
    }
  }

  // Blocks and segments are numbered with 32 bits, terms are not.
  // Memory is counted from the exact numbers of the first pass, before the second takes it.
  void CheckSize() const {
    std::int64_t blocks = 0, segments = 0, terms = 0;
    for (int row = 0; row < layout_.num_frames; ++row) {
      blocks += static_cast<std::int64_t>(rows_[row].size());
      for (const CountedBlock& block : rows_[row]) {
        segments += block.hessian.num_segments + block.schur.num_segments;
        terms += block.hessian.num_terms + block.schur.num_terms;
      }
    }
    constexpr std::int64_t kMostBlocks = std::int64_t{1} << 31;
    MemoryBudget::CheckCount(blocks, kMostBlocks, "blocks of the reduced system");
    MemoryBudget::CheckCount(segments, kMostBlocks, "runs of products");
    evaluator_.Take(terms * static_cast<std::int64_t>(sizeof(ProductTerm)) + segments * kSegment +
                        blocks * kBlock + layout_.frame_size() * kRow,
                    "the plan of the products that form the reduced system");
  }

  // The pattern, and where in the plans each block begins.
  void Place() {
    CheckSize();
    plans_->pattern = PatternWithoutBlocks(layout_.FrameOffsets());
    const FactorGraph& graph = evaluator_.graph();
    for (int row = 0; graph.HasEliminationGroups() && row < layout_.num_frames; ++row) {
      plans_->pattern.groups.push_back(graph.elimination_group(layout_.variables[row]));
    }
    std::vector<int> columns;
    for (int row = 0; row < layout_.num_frames; ++row) {
      columns.clear();
      for (const CountedBlock& block : rows_[row]) {
        columns.push_back(block.column);
        plans_->block_row.push_back(row);
        // segments_begin and first_term are running sums over the blocks, so a row's places do not
        // depend on who counted it.
        hessian_.Place(block.hessian, &plans_->hessian);
        schur_.Place(block.schur, &plans_->schur);
      }
      AppendRow(columns, &plans_->pattern);
      // The row's counts are given back at once.
      std::vector<CountedBlock>().swap(rows_[row]);
    }
    hessian_.Allocate(&plans_->hessian);
    schur_.Allocate(&plans_->schur);
  }

  void FillRows(int begin, int end) {
    // Scratch of the task; rows of different tasks write to different places of the plans.
    const BlockPattern& pattern = plans_->pattern;
    Filling hessian(hessian_, layout_.num_frames, &plans_->hessian);
    Filling schur(schur_, layout_.num_frames, &plans_->schur);
    for (int row = begin; row < end; ++row) {
      for (int block = pattern.row_begin[row]; block < pattern.row_begin[row + 1]; ++block) {
        hessian.Begin(pattern.columns[block], block);
        schur.Begin(pattern.columns[block], block);
      }
      ForEachHessianTerm(row, [&](int column, int source, ProductTerm term) {
        hessian.Add(column, source, term);
      });
      ForEachSchurTerm(
          row, [&](int column, int source, ProductTerm term) { schur.Add(column, source, term); });
      for (int block = pattern.row_begin[row]; block < pattern.row_begin[row + 1]; ++block) {
        hessian.End(pattern.columns[block], block);
        schur.End(pattern.columns[block], block);
      }
    }
  }

  // Where the terms of each block begin.
  struct Places {
    void Place(const Share& share, ProductPlan* plan) {
      first_term.push_back(num_terms);
      plan->segments_begin.push_back(num_segments);
      num_terms += share.num_terms;
      num_segments += share.num_segments;
    }
    void Allocate(ProductPlan* plan) const {
      plan->segments_begin.push_back(num_segments);
      plan->terms.resize(num_terms);
      plan->segments.resize(num_segments);
    }
    std::vector<std::int64_t> first_term;
    std::int64_t num_terms = 0;
    int num_segments = 0;
  };

  // Writes the terms of a row's blocks to their places.
  class Filling {
   public:
    Filling(const Places& places, int num_columns, ProductPlan* plan)
        : places_(places), plan_(plan), next_(num_columns) {}

    void Begin(int column, int block) {
      next_[column] = {places_.first_term[block], plan_->segments_begin[block], -1};
    }
    // A new source begins a new segment; terms follow each other in memory.
    void Add(int column, int source, ProductTerm term) {
      Next& next = next_[column];
      if (next.source != source) {
        plan_->segments[next.segment++] = {next.term, 0, source};
        next.source = source;
      }
      plan_->terms[next.term++] = term;
    }
    // Counts follow from where the next segment begins, walked from the last one.
    void End(int column, int block) {
      std::int64_t end = next_[column].term;
      for (int s = plan_->segments_begin[block + 1] - 1; s >= plan_->segments_begin[block]; --s) {
        plan_->segments[s].count = static_cast<int>(end - plan_->segments[s].first_term);
        end = plan_->segments[s].first_term;
      }
    }

   private:
    struct Next {
      std::int64_t term = 0;
      int segment = 0;
      int source = -1;
    };
    const Places& places_;
    ProductPlan* plan_;
    std::vector<Next> next_;  // per column
  };

  // By family, slot of the row, slot of the column, factor: all terms of a source one after the
  // other.
  template <typename Visit>
  void ForEachHessianTerm(int row, const Visit& visit) const {
    for (const Linearization& cache : evaluator_.families()) {
      if (evaluator_.leaves_out_zero_blocks()) {
        ForEachSparseTerm(cache, row, visit);
        continue;
      }
      const std::vector<SlotAdjacency>& slots = adjacency_[cache.id];
      const auto num_slots = static_cast<int>(slots.size());
      for (int r = 0; r < num_slots; ++r) {
        const std::int32_t* begin = slots[r].factors.data() + slots[r].begin[row];
        const std::int32_t* end = slots[r].factors.data() + slots[r].begin[row + 1];
        for (int c = 0; begin < end && c < num_slots; ++c) {
          // Slots of landmarks and constants have no terms.
          if (!slots[c].factors.empty()) {
            ForEachTermOfSlots(cache, row, r, c, begin, end, visit);
          }
        }
      }
    }
  }

  // By factor, so that the terms of a block have one source each where a variable is in one slot,
  // as mostly.
  // A frame in two slots, or factors that have it in different ones, only make more segments.
  template <typename Visit>
  void ForEachSparseTerm(const Linearization& cache, int row, const Visit& visit) const {
    const SparseBlocks& sparse = sparse_[cache.id];
    const int num_slots = cache.num_slots;
    if (cache.num_factors == 0) {
      return;
    }
    for (int k = sparse.frame_begin[row]; k < sparse.frame_begin[row + 1]; ++k) {
      const auto [factor, slot] = sparse.places[k];
      const auto row_quads = static_cast<std::int32_t>(cache.slots[slot].factor_stride / kQuad);
      for (int other = sparse.factor_begin[factor]; other < sparse.factor_begin[factor + 1];
           ++other) {
        const auto [column_slot, column] = sparse.blocks[other];
        // The lower triangle; with column == row both orders of two slots count, as in Σ J_iᵀ J_i.
        if (column <= row) {
          // Offsets in quads from the beginning of a slot's Jacobians, the column's first.
          const auto column_quads =
              static_cast<std::int32_t>(cache.slots[column_slot].factor_stride / kQuad);
          const std::int32_t record = cache.Record(factor);
          visit(column, first_source_[cache.id] + slot * num_slots + column_slot,
                ProductTerm{record * column_quads,
                            record * (column_slot == slot ? cache.residual_size : row_quads)});
        }
      }
    }
  }

  template <typename Visit>
  void ForEachTermOfSlots(const Linearization& cache, int row, int r, int c,
                          const std::int32_t* begin, const std::int32_t* end,
                          const Visit& visit) const {
    // All factors that have the row's frame in slot r; the column's is whatever they have in slot
    // c.
    const VariableId* ids = evaluator_.graph().Variables(cache.id, 0) + c;
    const auto row_quads = static_cast<std::int32_t>(cache.slots[r].factor_stride / kQuad);
    const auto column_quads = static_cast<std::int32_t>(cache.slots[c].factor_stride / kQuad);
    const std::int32_t b_step = r == c ? cache.residual_size : row_quads;
    const int num_slots = cache.num_slots;
    const int source = first_source_[cache.id] + r * num_slots + c;
    for (const std::int32_t* i = begin; i < end; ++i) {
      const int column = layout_.FrameOf(ids[static_cast<std::ptrdiff_t>(*i) * num_slots]);
      if (column >= 0 && column <= row) {
        const std::int32_t record = cache.Record(*i);
        visit(column, source, ProductTerm{record * column_quads, record * b_step});
      }
    }
  }

  // By chunk, landmark size and landmark, as frame_incidences lists them. The cost is the sum over
  // landmarks of the square of the frames that see them.
  template <typename Visit>
  void ForEachSchurTerm(int row, const Visit& visit) const {
    // Without blocks b still takes those of the diagonal, if there is a Y of all landmarks.
    const bool has_terms = plans_->forms_schur || incidences_.num_chunks() == 1;
    const int end = has_terms ? incidences_.frame_begin[row + 1] : 0;
    for (int k = incidences_.frame_begin[row]; k < end; ++k) {
      const int q = incidences_.frame_incidences[k];
      const int l = incidences_.landmarks[q];
      const int source = source_of_landmark_[l];
      visit(row, source, ProductTerm{incidences_.incidences[q].y, l * kQuad});
      // Block Jacobi preconditioners need no others.
      if (schur_blocks_ == SchurBlocks::kDiagonal || schur_blocks_ == SchurBlocks::kNone) {
        continue;
      }
      for (int other = incidences_.begin[l]; other < incidences_.begin[l + 1]; ++other) {
        const int column = incidences_.frames[other];
        if (column < row && (clusters_ == nullptr || clusters_->Keeps(row, column))) {
          visit(column, source,
                ProductTerm{incidences_.incidences[other].y, incidences_.incidences[q].y});
        }
      }
    }
  }

  const Evaluator& evaluator_;
  const Layout& layout_;
  const LandmarkIncidences& incidences_;
  SchurBlocks schur_blocks_;
  const FrameClusters* clusters_;  // of kClustered
  FramePlans* plans_;
  std::vector<std::vector<SlotAdjacency>>
      adjacency_;                        // per family and slot, where no blocks are left out
  std::vector<SparseBlocks> sparse_;     // per family, where some are
  std::vector<int> first_source_;        // per family: of its slot pairs among hessian_sources
  std::vector<int> source_of_landmark_;  // among schur_sources
  std::vector<std::vector<CountedBlock>> rows_;
  Places hessian_;
  Places schur_;
};

// Jacobians that come in the order of their records are met in that order. Where factors have
// another one the terms of a segment ascend by these.
void SortByRecord(const Evaluator& evaluator, FramePlans* plans) {
  constexpr int kSegmentGrain = 64;
  ProductPlan& plan = plans->hessian;
  const auto sort = [&](const ProductPlan::Segment& segment) {
    const int family = plans->hessian_sources[segment.source].family;
    if (!evaluator.families()[family].records.empty()) {
      ProductTerm* const first = plan.terms.data() + segment.first_term;
      std::sort(first, first + segment.count,
                [](const ProductTerm& a, const ProductTerm& b) { return a.a < b.a; });
    }
  };
  evaluator.executor().For(
      static_cast<int>(plan.segments.size()), kSegmentGrain, [&](int begin, int end) {
        std::for_each(plan.segments.begin() + begin, plan.segments.begin() + end, sort);
      });
}

// Of factors that touch many variables most pairs of slots have no term, where few of the blocks
// are not zero.
void DropUnusedSources(FramePlans* plans) {
  std::vector<ProductPlan::Segment>& segments = plans->hessian.segments;
  std::vector<FramePlans::HessianSource>& sources = plans->hessian_sources;
  if (sources.size() <= segments.size()) {
    return;  // all of them may be used, and there are not more of them than of segments
  }
  std::vector<int> renumbered(sources.size(), 0);
  for (const ProductPlan::Segment& segment : segments) {
    renumbered[segment.source] = 1;
  }
  int num_used = 0;
  for (std::size_t k = 0; k < sources.size(); ++k) {
    if (renumbered[k] != 0) {
      sources[num_used] = sources[k];
      renumbered[k] = num_used++;
    }
  }
  sources.resize(num_used);
  for (ProductPlan::Segment& segment : segments) {
    segment.source = renumbered[segment.source];
  }
}

}  // namespace

FramePlans::FramePlans(const Evaluator& evaluator, const LandmarkIncidences& incidences,
                       SchurBlocks blocks, const FrameClusters* clusters)
    : forms_schur(blocks != SchurBlocks::kNone) {
  PlanBuilder(evaluator, incidences, blocks, clusters, this).Build();
  if (evaluator.storage() == JacobianStorage::kInChunks) {
    SortByRecord(evaluator, this);
  }
  DropUnusedSources(this);
}

}  // namespace inceres::internal
