#include "schur/direct_elimination.h"

#include <algorithm>
#include <cmath>

#include "linear/pattern_rows.h"
#include "linear/small_cholesky.h"

namespace inceres::internal {

// Elimination sums each block of S over a list of products that is made once and serves every step.
// Here the lists are those of a chunk of landmarks, made while what they refer to is in the cache:
//
//     S_ij += Σ over the chunk of Σ over the factors of l of J_iᵀJ_j − Y_li Y_ljᵀ,   i ≥ j.
//
// First the landmarks of a chunk, each writing its own U_inv and Y, then the lists, then block by
// block what they add. A block has one order of its sum for any number of threads.
//
// Lists are made by one thread, in the order of the landmarks and of their factors, and a block's
// list is summed by one task. Products of Jacobians come before those of Y in each chunk, chunk
// after chunk: that is the order of a block's sum. Where Jacobians come in chunks the evaluation
// calls AddChunk for each of them while it is in memory, and they are never kept.
//
// P is not damped, so a landmark may have no factor, or one that is rounding. Both count as open,
// and such a landmark adds nothing to S; the caller says which they are. Determined landmarks may
// leave a frame nothing but rounding, which S does not show: so diag(C) is summed beside S, where
// the Jacobians are listed.

namespace {

constexpr int kLandmarksATask = 64;
constexpr int kBlocksATask = 4;

// Variances are held against 1 / P_ii, those with all else known: units cancel. NaN is infinite.
double InflationOf(int size, const double* P, const double* U_inv) {
  double largest = 0.0;
  for (int i = 0; i < size; ++i) {
    const double inflation = VarianceOfCoordinate(size, U_inv, i) * P[i * kQuad + i];
    if (!(inflation < HUGE_VAL)) {
      return HUGE_VAL;
    }
    largest = std::max(largest, inflation);
  }
  return largest;
}

}  // namespace

// The pattern is found before anything is evaluated, by a pass over the incidences.
DirectElimination::DirectElimination(Evaluator* evaluator, const LandmarkIncidences& incidences)
    : evaluator_(*evaluator),
      incidences_(incidences),
      kernels_(BestKernels()),
      chunks_(evaluator->jacobian_chunks()) {
  if (chunks_ != nullptr) {
    chunks_->Cut(incidences);
    chunks_->ReadBy([this](int chunk) { AddChunk(chunk); });
  }
  FindOthers();
  FindPattern();
}

// Which families have factors that touch no landmark is seen by counting: others need no look at
// each of theirs.
void DirectElimination::FindOthers() {
  const std::vector<Linearization>& families = evaluator_.families();
  std::vector<int> num_of_landmarks(families.size(), 0);
  for (const LandmarkFactors& entry : incidences_.factors) {
    num_of_landmarks[incidences_.FamilyOf(entry)] += entry.count;
  }
  others_.resize(families.size());
  for (const Linearization& cache : families) {
    if (num_of_landmarks[cache.id] < cache.num_factors) {
      FindOthersOf(cache);
    }
  }
}

// By ascending record, in which chunks are stretches of them.
void DirectElimination::FindOthersOf(const Linearization& cache) {
  const Layout& layout = evaluator_.layout();
  for (int i = 0; i < cache.num_factors; ++i) {
    const VariableId* ids = evaluator_.graph().Variables(cache.id, i);
    const auto is_landmark = [&](VariableId id) { return layout.LandmarkOf(id) >= 0; };
    if (std::none_of(ids, ids + cache.num_slots, is_landmark)) {
      others_[cache.id].push_back(cache.Record(i));
    }
  }
  std::sort(others_[cache.id].begin(), others_[cache.id].end());
}

// Frames that share a landmark or a factor. Each row is gathered from its frame's landmarks and
// from factors between frames, each column once, until the row is full. Factors of landmarks couple
// no frames that the landmark does not. Rows of blocks are padded, for the kernels add to S
// directly.
void DirectElimination::FindPattern() {
  const Layout& layout = evaluator_.layout();
  std::vector<std::vector<int>> coupled(static_cast<std::size_t>(layout.num_frames));
  for (const Linearization& cache : evaluator_.families()) {
    for (const int record : others_[cache.id]) {
      const VariableId* ids = evaluator_.graph().Variables(cache.id, FactorAt(cache.id, record));
      for (int a = 0; a < cache.num_slots; ++a) {
        for (int b = 0; b < cache.num_slots; ++b) {
          const int i = layout.FrameOf(ids[a]), j = layout.FrameOf(ids[b]);
          if (i > j && j >= 0) {
            coupled[i].push_back(j);
          }
        }
      }
    }
  }
  pattern_ = PatternWithoutBlocks(layout.FrameOffsets());
  pattern_.padded = true;
  RowColumns row(layout.num_frames);
  for (int i = 0; i < layout.num_frames; ++i) {
    row.Begin(i);
    const auto add = [&row](int j) { row.Add(j); };
    std::for_each(coupled[i].begin(), coupled[i].end(), add);
    for (int k = incidences_.frame_begin[i]; k < incidences_.frame_begin[i + 1] && !row.IsFull();
         ++k) {
      const int l = incidences_.landmarks[incidences_.frame_incidences[k]];
      std::for_each(incidences_.frames.begin() + incidences_.begin[l],
                    incidences_.frames.begin() + incidences_.begin[l + 1], add);
    }
    AppendRow(row.Ascending(), &pattern_);
    block_row_.resize(pattern_.columns.size(), i);
  }
  IndexBlocks();
}

// A table by row and column, as wide as the envelope, where that is at most four times as many
// places as there are blocks: a product is then listed without a search. Else BlockAt searches the
// row.
void DirectElimination::IndexBlocks() {
  constexpr std::int64_t kMostPlaces = 4;  // of each block
  std::int64_t num_places = 0;
  for (int row = 0; row < pattern_.num_blocks(); ++row) {
    const int first = pattern_.columns[pattern_.row_begin[row]];
    row_place_.push_back(num_places - first);
    num_places += row + 1 - first;
  }
  const auto num_blocks = static_cast<int>(pattern_.columns.size());
  if (num_places <= kMostPlaces * num_blocks) {
    block_of_.resize(static_cast<std::size_t>(num_places));
    for (int block = 0; block < num_blocks; ++block) {
      block_of_[static_cast<std::size_t>(row_place_[block_row_[block]] + pattern_.columns[block])] =
          block;
    }
  }
}

// One for each two slots of each family.
void DirectElimination::MakeSources() {
  const auto num_blocks = static_cast<int>(pattern_.columns.size());
  for (const Linearization& cache : evaluator_.families()) {
    // Each pair of slots has lists of its own: counts for all blocks are for families with products
    // in many of them.
    const bool is_small = cache.num_factors < num_blocks / 8;
    first_source_.push_back(sources_.size());
    for (int r = 0; r < cache.num_slots; ++r) {
      for (int c = 0; c < cache.num_slots; ++c) {
        sources_.push_back({&cache, r, c,
                            static_cast<std::int32_t>(cache.slots[r].factor_stride / kQuad),
                            static_cast<std::int32_t>(cache.slots[c].factor_stride / kQuad),
                            ProductLists(is_small ? 0 : num_blocks)});
      }
    }
  }
  of_sizes_.assign(LandmarkIncidences::kMaxLandmarkSize, ProductLists(num_blocks));
}

// U_inv, and the inflation; infinite of one that is not determined. P comes from the Jacobians of
// the landmark's factors, which are in the cache and are read again for Y. Its η is summed with it
// and not used: a covariance has no right-hand side.
double DirectElimination::FactorizeLandmark(int landmark) {
  const double no_damping[kQuad] = {};
  double P[kQuad * kQuad] = {}, eta[kQuad] = {};
  const int size = incidences_.sizes[landmark];
  double* const U_inv = U_inv_.data() + std::ptrdiff_t{landmark} * kQuad * kQuad;
  for (int k = incidences_.factors_begin[landmark]; k < incidences_.factors_begin[landmark + 1];
       ++k) {
    kernels_.landmark_gram(size, incidences_.factors[k], P, eta);
  }
  const bool has_factor = InvertCholeskyFactor(size, P, no_damping, U_inv);
  const double inflation = has_factor ? InflationOf(size, P, U_inv) : HUGE_VAL;
  return inflation <= max_inflation_ ? inflation : HUGE_VAL;
}

void DirectElimination::EliminateLandmark(int landmark) {
  for (int k = incidences_.factors_begin[landmark]; k < incidences_.factors_begin[landmark + 1];
       ++k) {
    kernels_.eliminate(incidences_.sizes[landmark], incidences_.factors[k], UInv(landmark),
                       Y_.data());
  }
}

// Products of its factors, and of Y with Y. Pairs of its frames, each with itself too: of two
// frames the one that comes later in the layout has the row. In the kernel's words `b` has the
// rows, hence the order of the places.
void DirectElimination::ListLandmark(int landmark) {
  for (int k = incidences_.factors_begin[landmark]; k < incidences_.factors_begin[landmark + 1];
       ++k) {
    const LandmarkFactors& entry = incidences_.factors[k];
    ListRecords(evaluator_.families()[incidences_.FamilyOf(entry)], entry.factors, entry.count,
                inflation_[landmark]);
  }
  ProductLists& lists = of_sizes_[incidences_.sizes[landmark] - 1];
  const int begin = incidences_.begin[landmark], end = incidences_.begin[landmark + 1];
  for (int p = begin; p < end; ++p) {
    const int i = incidences_.frames[p];
    const std::int32_t y_i = incidences_.incidences[p].y;
    for (int q = begin; q <= p; ++q) {
      const int j = incidences_.frames[q];
      const std::int32_t y_j = incidences_.incidences[q].y;
      lists.Add(i >= j ? BlockAt(i, j) : BlockAt(j, i),
                i >= j ? ProductTerm{y_j, y_i} : ProductTerm{y_i, y_j});
    }
  }
}

// Slots of constants and of landmarks have no frame, and are passed over. Of each pair of slots the
// lower triangle is listed; where two slots hold different frames, one of the two orders is.
// `inflation`: of their landmark; 1 without one.
void DirectElimination::ListRecords(const Linearization& cache, const std::int32_t* records,
                                    int count, double inflation) {
  const Layout& layout = evaluator_.layout();
  const VariableId* const ids_of_all = evaluator_.graph().Variables(cache.id, 0);
  for (int n = 0; n < count; ++n) {
    const std::int32_t record = records[n];
    const VariableId* const ids = ids_of_all + cache.Entry(FactorAt(cache.id, record));
    Source* of_row = sources_.data() + first_source_[cache.id];
    for (int r = 0; r < cache.num_slots; ++r, of_row += cache.num_slots) {
      const int i = layout.FrameOf(ids[r]);
      if (i >= 0) {
        AddSquares(cache, record, r, i, inflation);
      }
      for (int c = 0; i >= 0 && c < cache.num_slots; ++c) {
        const int j = layout.FrameOf(ids[c]);
        if (j >= 0 && j <= i) {
          of_row[c].lists.Add(BlockAt(i, j),
                              {record * of_row[c].column_quads, record * of_row[c].row_quads});
        }
      }
    }
  }
}

// Of the columns of one Jacobian, to diag(C). One thread does, in the order of the lists.
void DirectElimination::AddSquares(const Linearization& cache, std::int32_t record, int slot,
                                   int frame, double inflation) {
  const SlotJacobians& jacobian = cache.slots[slot];
  const double* J = jacobian.data + record * jacobian.factor_stride;
  double* const diagonal = diagonal_.data() + pattern_.offsets[frame];
  double* const rounding = rounding_.data() + pattern_.offsets[frame];
  for (int r = 0; r < cache.residual_size; ++r, J += jacobian.row_stride) {
    for (int c = 0; c < pattern_.block_size(frame); ++c) {
      diagonal[c] += J[c] * J[c];
      rounding[c] += inflation * J[c] * J[c];
    }
  }
}

// Those that come with the chunk: all with the last one where Jacobians are kept.
void DirectElimination::ListOthers(int chunk) {
  if (chunks_ == nullptr && chunk + 1 < incidences_.num_chunks()) {
    return;
  }
  for (const Linearization& cache : evaluator_.families()) {
    const std::vector<std::int32_t>& others = others_[cache.id];
    auto begin = others.begin(), end = others.end();
    if (chunks_ != nullptr) {
      begin = std::lower_bound(begin, end, chunks_->Begin(chunk, cache.id));
      end = std::lower_bound(begin, end, chunks_->End(chunk, cache.id));
    }
    ListRecords(cache, others.data() + (begin - others.begin()), static_cast<int>(end - begin),
                /*inflation=*/1.0);
  }
}

// Source by source, and within each block by block, in parallel: no two lists of a source are of
// one block. Products of Y have one list for each size of landmark, whose rows the kernel takes as
// depth.
void DirectElimination::AddLists() {
  for (Source& source : sources_) {
    AddProducts(ProductsOf(*source.cache, source.row_slot, source.column_slot), 1.0, &source.lists);
  }
  BlockProducts of_Y;
  of_Y.a = of_Y.b = Y_.data();
  of_Y.tail = incidences_.tail;
  for (std::size_t k = 0; k < of_sizes_.size(); ++k) {
    of_Y.depth = static_cast<int>(k) + 1;
    AddProducts(of_Y, -1.0, &of_sizes_[k]);
  }
}

// `kind`: what its products have in common. Those of Y are symmetric on the diagonal. Those of
// Jacobians with the same slot twice are as well. Operands are near, since they were written for
// this chunk, and nothing is fetched ahead.
void DirectElimination::AddProducts(const BlockProducts& kind, double sign, ProductLists* lists) {
  const std::vector<ProductLists::List>& sorted = lists->Sort();
  evaluator_.executor().For(static_cast<int>(sorted.size()), kBlocksATask, [&](int begin, int end) {
    BlockProducts products = kind;
    products.is_near = true;
    for (int n = begin; n < end; ++n) {
      const ProductLists::List& list = sorted[static_cast<std::size_t>(n)];
      const int row = block_row_[list.block], column = pattern_.columns[list.block];
      products.terms = lists->terms() + list.first_term;
      products.count = list.count;
      products.a_size = pattern_.block_size(column);
      products.b_size = pattern_.block_size(row);
      products.symmetric = row == column;
      kernels_.accumulate_products(products, sign, S_.data() + pattern_.value_begin[list.block]);
    }
  });
  lists->Clear();
}

// Behind the chunks of landmarks come those of factors that touch none.
void DirectElimination::AddChunk(int chunk) {
  if (chunk < incidences_.num_chunks()) {
    EliminateLandmarks(incidences_.chunk_begin[chunk], incidences_.chunk_begin[chunk + 1]);
  }
  ListOthers(chunk);
  AddLists();
}

// Open ones are only noted here, each by its own inflation, so no order among tasks matters.
void DirectElimination::EliminateLandmarks(int first, int last) {
  evaluator_.executor().For(last - first, kLandmarksATask, [&](int begin, int end) {
    // All factors first: one does not wait for another's roots and divisions.
    for (int l = first + begin; l < first + end; ++l) {
      inflation_[l] = FactorizeLandmark(l);
    }
    for (int l = first + begin; l < first + end; ++l) {
      if (inflation_[l] < HUGE_VAL) {
        EliminateLandmark(l);
      }
    }
  });
  for (int l = first; l < last; ++l) {
    if (inflation_[l] < HUGE_VAL) {
      ListLandmark(l);
    }
  }
}

// With open landmarks S lacks their part, and means nothing; all of them are looked at, so that the
// message can name each.
Status DirectElimination::Eliminate(double max_inflation, std::vector<int>* open) {
  const int num_landmarks = incidences_.num_landmarks();
  MakeSources();
  max_inflation_ = max_inflation;
  S_ = ZeroedArray(static_cast<std::size_t>(pattern_.value_begin.back()));
  Y_ = ZeroedArray::Unwritten(static_cast<std::size_t>(incidences_.y_quads * kQuad));
  U_inv_ = ZeroedArray::Unwritten(static_cast<std::size_t>(num_landmarks) * kQuad * kQuad);
  inflation_.assign(static_cast<std::size_t>(num_landmarks), 0.0);
  diagonal_.assign(static_cast<std::size_t>(pattern_.size()), 0.0);
  rounding_ = diagonal_;
  double cost = 0.0;
  // Nothing was evaluated at this state before. Chunks are added as they come.
  const Status status = evaluator_.EvaluateJacobians(/*known_point=*/false, &cost);
  if (!status.ok()) {
    return status;
  }
  for (int chunk = 0; chunks_ == nullptr && chunk < incidences_.num_chunks(); ++chunk) {
    AddChunk(chunk);
  }
  open->clear();
  for (int l = 0; l < num_landmarks; ++l) {
    if (!(inflation_[l] < HUGE_VAL)) {
      open->push_back(l);
    }
  }
  return Status::Ok();
}

}  // namespace inceres::internal
