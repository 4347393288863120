#include "schur/direct_elimination.h"

#include <algorithm>

#include "linear/pattern_rows.h"
#include "linear/small_cholesky.h"
#include "linearize/jacobian_places.h"

namespace inceres::internal {

// Elimination sums each block of S over a list of products that is made once and serves every step.
// Here the lists are those of a chunk of landmarks, made while what they refer to is in the cache:
//
//     S_ij += Σ over the chunk of Σ over the factors of l of J_iᵀJ_j − Y_li Y_ljᵀ,   i ≥ j.
//
// First the factors of a chunk are evaluated, then its landmarks, each writing its own U_inv and Y,
// then the lists, then block by block what they add. A block has one order of its sum for any
// number of threads.

namespace {

constexpr int kLandmarksATask = 64;
constexpr int kBlocksATask = 4;

// Variances are held against 1 / P_ii, those with all else known: units cancel. NaN is open.
bool IsDetermined(int size, const double* P, const double* U_inv, double max_inflation) {
  for (int i = 0; i < size; ++i) {
    if (!(VarianceOfCoordinate(size, U_inv, i) * P[i * kQuad + i] <= max_inflation)) {
      return false;
    }
  }
  return true;
}

}  // namespace

DirectElimination::DirectElimination(Evaluator* evaluator, const LandmarkIncidences& incidences)
    : evaluator_(*evaluator), incidences_(incidences), kernels_(BestKernels()) {
  FindOwners();
  FindPattern();
  for (const Linearization& cache : evaluator_.families()) {
    CutFamily(cache);
  }
}

// A family is recognized by the address of its slots.
void DirectElimination::FindOwners() {
  const std::vector<Linearization>& families = evaluator_.families();
  std::vector<int> num_of_landmarks(families.size(), 0);
  owners_.reserve(incidences_.factors.size());
  for (const LandmarkFactors& entry : incidences_.factors) {
    const auto is_owner = [&](const Linearization& cache) {
      return cache.slots.data() == entry.jacobians;
    };
    owners_.push_back(!owners_.empty() && is_owner(*owners_.back())
                          ? owners_.back()
                          : &*std::find_if(families.begin(), families.end(), is_owner));
    num_of_landmarks[owners_.back()->id] += entry.count;
  }
  others_.resize(families.size());
  for (const Linearization& cache : families) {
    if (num_of_landmarks[cache.id] < cache.num_factors) {
      FindOthers(cache);
    }
  }
}

void DirectElimination::FindOthers(const Linearization& cache) {
  const Layout& layout = evaluator_.layout();
  for (int i = 0; i < cache.num_factors; ++i) {
    const VariableId* ids = evaluator_.graph().Variables(cache.id, i);
    const auto is_landmark = [&](VariableId id) { return layout.LandmarkOf(id) >= 0; };
    if (std::none_of(ids, ids + cache.num_slots, is_landmark)) {
      others_[cache.id].push_back(i);
    }
  }
}

// Where the family has the factors of a chunk behind those of the chunks before, it is cut there.
// Where it has not, all its factors are evaluated with the first chunk. Factors without a landmark
// go with those before them.
void DirectElimination::CutFamily(const Linearization& cache) {
  const int num_chunks = incidences_.num_chunks();
  std::vector<int>& cuts = cuts_.emplace_back(static_cast<std::size_t>(num_chunks) + 1, 0);
  cuts.back() = cache.num_factors;
  int end = 0;  // of the chunks so far
  bool in_order = true;
  for (int chunk = 0; chunk < num_chunks; ++chunk) {
    int first = cache.num_factors, last = -1;
    for (int k = incidences_.factors_begin[incidences_.chunk_begin[chunk]];
         k < incidences_.factors_begin[incidences_.chunk_begin[chunk + 1]]; ++k) {
      if (owners_[k] == &cache) {
        const LandmarkFactors& entry = incidences_.factors[k];
        first = std::min(first, entry.factors[0]);
        last = std::max(last, entry.factors[entry.count - 1]);
      }
    }
    in_order = in_order && first >= end;
    cuts[chunk] = chunk == 0 ? 0 : last >= 0 ? first : end;
    end = std::max(end, last + 1);
  }
  if (!in_order || end == 0) {
    std::fill(cuts.begin() + 1, cuts.end(), cache.num_factors);
  }
}

// Frames that share a landmark or a factor.
void DirectElimination::FindPattern() {
  const Layout& layout = evaluator_.layout();
  std::vector<std::vector<int>> coupled(static_cast<std::size_t>(layout.num_frames));
  for (const Linearization& cache : evaluator_.families()) {
    for (const int factor : others_[cache.id]) {
      const VariableId* ids = evaluator_.graph().Variables(cache.id, factor);
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
  pattern_ = PatternWithoutBlocks(
      {layout.packed_offset.begin(), layout.packed_offset.begin() + layout.num_frames + 1});
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
    first_source_.push_back(sources_.size());
    for (int r = 0; r < cache.num_slots; ++r) {
      for (int c = 0; c < cache.num_slots; ++c) {
        sources_.push_back({&cache, r, c,
                            static_cast<std::int32_t>(cache.slots[r].factor_stride / kQuad),
                            static_cast<std::int32_t>(cache.slots[c].factor_stride / kQuad),
                            ProductLists(num_blocks)});
      }
    }
  }
  of_sizes_.assign(LandmarkIncidences::kMaxLandmarkSize, ProductLists(num_blocks));
}

// U_inv; false of one that is not determined.
bool DirectElimination::FactorizeLandmark(int landmark, double max_inflation) {
  const double no_damping[kQuad] = {};
  double P[kQuad * kQuad] = {}, eta[kQuad] = {};
  const int size = incidences_.sizes[landmark];
  double* const U_inv = U_inv_.data() + std::ptrdiff_t{landmark} * kQuad * kQuad;
  for (int k = incidences_.factors_begin[landmark]; k < incidences_.factors_begin[landmark + 1];
       ++k) {
    kernels_.landmark_gram(size, incidences_.factors[k], P, eta);
  }
  return InvertCholeskyFactor(size, P, no_damping, U_inv) &&
         IsDetermined(size, P, U_inv, max_inflation);
}

void DirectElimination::EliminateLandmark(int landmark) {
  for (int k = incidences_.factors_begin[landmark]; k < incidences_.factors_begin[landmark + 1];
       ++k) {
    kernels_.eliminate(incidences_.sizes[landmark], incidences_.factors[k], UInv(landmark),
                       Y_.data());
  }
}

// Products of its factors, and of Y with Y.
void DirectElimination::ListLandmark(int landmark) {
  for (int k = incidences_.factors_begin[landmark]; k < incidences_.factors_begin[landmark + 1];
       ++k) {
    ListFactors(*owners_[k], incidences_.factors[k].factors, incidences_.factors[k].count);
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

void DirectElimination::ListFactors(const Linearization& cache, const std::int32_t* factors,
                                    int count) {
  const Layout& layout = evaluator_.layout();
  const VariableId* const ids_of_all = evaluator_.graph().Variables(cache.id, 0);
  for (int n = 0; n < count; ++n) {
    const std::int32_t factor = factors[n];
    const VariableId* const ids = ids_of_all + cache.Entry(factor);
    Source* of_row = sources_.data() + first_source_[cache.id];
    for (int r = 0; r < cache.num_slots; ++r, of_row += cache.num_slots) {
      const int i = layout.FrameOf(ids[r]);
      for (int c = 0; i >= 0 && c < cache.num_slots; ++c) {
        const int j = layout.FrameOf(ids[c]);
        if (j >= 0 && j <= i) {
          of_row[c].lists.Add(BlockAt(i, j),
                              {factor * of_row[c].column_quads, factor * of_row[c].row_quads});
        }
      }
    }
  }
}

// Those that are evaluated with the chunk.
void DirectElimination::ListOthers(int chunk) {
  for (const Linearization& cache : evaluator_.families()) {
    const std::vector<std::int32_t>& others = others_[cache.id];
    const auto begin = std::lower_bound(others.begin(), others.end(), cuts_[cache.id][chunk]);
    const auto end = std::lower_bound(begin, others.end(), cuts_[cache.id][chunk + 1]);
    ListFactors(cache, others.data() + (begin - others.begin()), static_cast<int>(end - begin));
  }
}

void DirectElimination::AddLists() {
  BlockProducts products;
  products.is_near = true;
  for (Source& source : sources_) {
    const Linearization& cache = *source.cache;
    products.a = cache.slots[source.column_slot].data;
    products.b = cache.slots[source.row_slot].data;
    products.depth = cache.residual_size;
    AddProducts(products, 1.0, &source.lists);
  }
  products.a = products.b = Y_.data();
  products.tail = incidences_.tail;
  for (std::size_t k = 0; k < of_sizes_.size(); ++k) {
    products.depth = static_cast<int>(k) + 1;
    AddProducts(products, -1.0, &of_sizes_[k]);
  }
}

// `kind`: what its products have in common. Those of Y are symmetric on the diagonal.
void DirectElimination::AddProducts(const BlockProducts& kind, double sign, ProductLists* lists) {
  const std::vector<ProductLists::List>& sorted = lists->Sort();
  evaluator_.executor().For(static_cast<int>(sorted.size()), kBlocksATask, [&](int begin, int end) {
    BlockProducts products = kind;
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

// A family's Jacobians stay where they are until it is cut.
Status DirectElimination::Evaluate(int chunk) {
  Status status;
  if (evaluator_.storage() != JacobianStorage::kInParts) {
    double cost = 0.0;
    return chunk == 0 ? evaluator_.EvaluateJacobians(/*known_point=*/false, &cost) : status;
  }
  if (chunk == 0) {
    status = evaluator_.points().ComputeTangents();
  }
  for (FamilyId id = 0; status.ok() && id < static_cast<int>(cuts_.size()); ++id) {
    const std::vector<int>& cuts = cuts_[id];
    if (chunk == 0) {
      int largest = 0;
      for (std::size_t k = 0; k + 1 < cuts.size(); ++k) {
        largest = std::max(largest, cuts[k + 1] - cuts[k]);
      }
      MakeRoomForPart(largest, &evaluator_.families()[id]);
    }
    if (cuts[chunk] < cuts[chunk + 1]) {
      status = evaluator_.EvaluatePart(id, cuts[chunk], cuts[chunk + 1]);
    }
  }
  return status;
}

Status DirectElimination::Eliminate(double max_inflation, std::vector<int>* open) {
  const int num_landmarks = incidences_.num_landmarks();
  MakeSources();
  S_ = ZeroedArray(static_cast<std::size_t>(pattern_.value_begin.back()));
  Y_ = ZeroedArray::Unwritten(static_cast<std::size_t>(incidences_.y_quads * kQuad));
  U_inv_ = ZeroedArray::Unwritten(static_cast<std::size_t>(num_landmarks) * kQuad * kQuad);
  std::vector<char> is_open(static_cast<std::size_t>(num_landmarks), 0);
  for (int chunk = 0; chunk < incidences_.num_chunks(); ++chunk) {
    const Status evaluated = Evaluate(chunk);
    if (!evaluated.ok()) {
      return evaluated;
    }
    const int first = incidences_.chunk_begin[chunk], last = incidences_.chunk_begin[chunk + 1];
    evaluator_.executor().For(last - first, kLandmarksATask, [&](int begin, int end) {
      // All factors first: one does not wait for another's roots and divisions.
      for (int l = first + begin; l < first + end; ++l) {
        is_open[l] = FactorizeLandmark(l, max_inflation) ? 0 : 1;
      }
      for (int l = first + begin; l < first + end; ++l) {
        if (is_open[l] == 0) {
          EliminateLandmark(l);
        }
      }
    });
    for (int l = first; l < last; ++l) {
      if (is_open[l] == 0) {
        ListLandmark(l);
      }
    }
    ListOthers(chunk);
    AddLists();
  }
  open->clear();
  for (int l = 0; l < num_landmarks; ++l) {
    if (is_open[l] != 0) {
      open->push_back(l);
    }
  }
  return Status::Ok();
}

}  // namespace inceres::internal
