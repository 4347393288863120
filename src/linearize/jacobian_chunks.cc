#include "linearize/jacobian_chunks.h"

#include <algorithm>
#include <numeric>
#include <utility>

#include "base/address.h"
#include "linearize/evaluator.h"
#include "linearize/incidences.h"
#include "linearize/robust_costs.h"

namespace inceres::internal {

// J where there is no memory for it (docs/large.md, "Memory"; docs/algorithms.md, "Linearization").
// All readers find a record's block at data + record · stride, and know nothing of chunks: data is
// moved, chunk by chunk, so that the records at hand lie in the one array that there is.
//
// Evaluations of one point give the same bits however often they are asked for: values of losses
// that were found meanwhile at a candidate are recognized by their residuals, and found anew.
//
// Chunks are those of the elimination, by landmarks, so that P and Y of a landmark are made of
// Jacobians that are all there. Factors that touch no landmark come in chunks of their own behind
// those, or with the chunk of the landmark before which they lie. Within a chunk each family has a
// stretch of the array, whose records ascend.
//
// A factor's J and residual have the bits that they would have if they were kept, for it is
// evaluated by the same call of its family; what is not the same is the order in which sums go over
// all factors. A chunk's cost is a sum over pieces, which are cut by the problem alone, and the
// cost one over chunks.

namespace {

// Records that a task evaluates, at most.
constexpr int kPieceSize = 256;

}  // namespace

Status BringJacobians(const Evaluator& evaluator, int chunk) {
  JacobianChunks* const chunks = evaluator.jacobian_chunks();
  return chunks != nullptr ? chunks->Bring(chunk) : Status::Ok();
}

const char* JacobianChunks::Obstacle(const FactorGraph& graph) {
  for (FamilyId id = 0; id < graph.num_families(); ++id) {
    if (graph.family(id).Prepares()) {
      return "a family that prepares evaluations";
    }
  }
  return graph.HasPins() ? "pinned variables" : nullptr;
}

// All blocks of a record follow each other, so that the stride of the first slot is the record's
// length.
std::int64_t JacobianChunks::QuadsOf(FamilyId family) const {
  const std::vector<SlotJacobians>& slots = evaluator_.families()[family].slots;
  return slots.empty() ? 0 : slots[0].factor_stride / kQuad;
}

// Memory is asked for by name before it is taken, and is that of the largest chunk: all of them use
// it one after the other. Slots point there from the beginning, so that none is without an address
// before the first evaluation.
void JacobianChunks::Cut(const LandmarkIncidences& incidences) {
  FindFactors();
  CutByLandmarks(incidences);
  CutTheRest();
  CutIntoPieces();
  std::int64_t most = 0;
  for (int chunk = 0; chunk < num_chunks_; ++chunk) {
    std::int64_t quads = 0;
    for (const Linearization& cache : evaluator_.families()) {
      quads += (End(chunk, cache.id) - Begin(chunk, cache.id)) * QuadsOf(cache.id);
    }
    most = std::max(most, quads);
  }
  const auto size = static_cast<std::size_t>((most + 1) * kQuad);  // a last row is a whole quad
  evaluator_.Take(Bytes() + static_cast<std::int64_t>(sizeof(double) * size),
                  "the Jacobians of a chunk of landmarks");
  values_ = ZeroedArray(size);
  for (Linearization& cache : evaluator_.families()) {
    cache.PlaceSlots(0, values_.data());
  }
}

// The inverse of Linearization::records; empty, as that is, where each factor is its own record.
void JacobianChunks::FindFactors() {
  factors_.resize(evaluator_.families().size());
  for (const Linearization& cache : evaluator_.families()) {
    std::vector<std::int32_t>& factors = factors_[cache.id];
    factors.resize(cache.records.size());
    for (std::size_t i = 0; i < factors.size(); ++i) {
      factors[cache.records[i]] = static_cast<std::int32_t>(i);
    }
  }
}

// A landmark's records ascend, and those of the landmarks before it lie before them. What is
// between them, without a landmark, goes with the next. So the end of a chunk in a family is behind
// the last record of its landmarks, and never before that of the chunk before, where a chunk has
// none of the family.
void JacobianChunks::CutByLandmarks(const LandmarkIncidences& incidences) {
  num_chunks_ = incidences.num_chunks();
  std::vector<int> end(evaluator_.families().size(), 0);
  ends_ = end;
  for (int chunk = 0; chunk < num_chunks_; ++chunk) {
    const std::vector<int>& begin = incidences.factors_begin;
    for (int k = begin[incidences.chunk_begin[chunk]]; k < begin[incidences.chunk_begin[chunk + 1]];
         ++k) {
      const LandmarkFactors& entry = incidences.factors[k];
      const FamilyId family = incidences.FamilyOf(entry);
      end[family] = std::max(end[family], entry.factors[entry.count - 1] + 1);
    }
    ends_.insert(ends_.end(), end.begin(), end.end());
  }
}

// Factors of frames alone: chunks as large as those of landmarks, family after family. A chunk may
// have the end of one family and the beginning of the next. Where it is full it is closed, and the
// family goes on in another one; a single record that is larger than a chunk has one by itself.
void JacobianChunks::CutTheRest() {
  std::vector<int> end(ends_.end() - static_cast<std::ptrdiff_t>(evaluator_.families().size()),
                       ends_.end());
  std::int64_t quads = 0;  // of a chunk that is not closed
  const auto close = [&] {
    ends_.insert(ends_.end(), end.begin(), end.end());
    ++num_chunks_;
    quads = 0;
  };
  for (const Linearization& cache : evaluator_.families()) {
    const std::int64_t size = std::max<std::int64_t>(QuadsOf(cache.id), 1);
    while (end[cache.id] < cache.num_factors) {
      const std::int64_t room = (LandmarkIncidences::kQuadsPerChunk - quads) / size;
      if (room <= 0 && quads > 0) {
        close();
        continue;
      }
      const std::int64_t left = cache.num_factors - end[cache.id];
      const std::int64_t count = std::min(left, std::max<std::int64_t>(room, 1));
      end[cache.id] += static_cast<int>(count);
      quads += count * size;
    }
  }
  if (quads > 0) {
    close();
  }
}

// The most that a chunk has decides how much room costs, failures and moved views get, once: no
// evaluation allocates.
void JacobianChunks::CutIntoPieces() {
  std::size_t most = 0, most_slots = 0;
  bool any_moved = false;
  pieces_begin_.assign(1, 0);
  for (int chunk = 0; chunk < num_chunks_; ++chunk) {
    for (const Linearization& cache : evaluator_.families()) {
      // Costly families (user code) are cut finer, for one thread too: costs are summed by piece.
      const int size = InWholeSums(cache.family->TaskSize(), kPieceSize);
      for (int begin = Begin(chunk, cache.id); begin < End(chunk, cache.id); begin += size) {
        pieces_.push_back({cache.id, begin, std::min(begin + size, End(chunk, cache.id))});
      }
      any_moved = any_moved || !cache.records.empty();
      most_slots = std::max(most_slots, cache.slots.size());
    }
    most = std::max(most, pieces_.size() - static_cast<std::size_t>(pieces_begin_.back()));
    pieces_begin_.push_back(static_cast<int>(pieces_.size()));
  }
  costs_.reserve(most);
  failures_.reserve(most);
  moved_.resize(any_moved ? most : 0);
  for (Moved& moved : moved_) {
    moved.slots.reserve(most_slots);
    moved.views.reserve(most_slots);
  }
}

// A pass in which each chunk is read by whoever sums H while it is in memory; without that it would
// have to come twice. On a failure the cost is of no use, and chunks behind it were not evaluated.
Status JacobianChunks::Linearize(bool known_point, double* cost) {
  *cost = 0.0;
  in_memory_ = -1;
  for (int chunk = 0; chunk < num_chunks_; ++chunk) {
    double of_chunk = 0.0;
    const Status status = Evaluate(chunk, known_point, &of_chunk);
    if (!status.ok()) {
      return status;
    }
    *cost += of_chunk;
    if (reader_) {
      reader_(chunk);
    }
  }
  return Status::Ok();
}

// The point was linearized before: tangent maps are there, and losses may be. The chunk that is in
// memory already costs nothing: a pass may go on with the one that the pass before has ended with.
Status JacobianChunks::Bring(int chunk) {
  double cost = 0.0;
  return chunk == in_memory_ ? Status::Ok() : Evaluate(chunk, /*known_point=*/true, &cost);
}

// Nothing counts as in memory until all of it is: who is told of a failure must not find half a
// chunk. Of pieces that fail the first one is named, in the order of the families and their
// records, whichever thread met it first. Pieces' costs are added in their order.
Status JacobianChunks::Evaluate(int chunk, bool known_point, double* cost) {
  in_memory_ = -1;
  evaluator_.points().PointTo(/*candidate=*/false);
  double* next = values_.data();
  for (Linearization& cache : evaluator_.families()) {
    cache.PlaceSlots(Begin(chunk, cache.id), next);
    next += (End(chunk, cache.id) - Begin(chunk, cache.id)) * QuadsOf(cache.id) * kQuad;
  }
  const int first = pieces_begin_[chunk];
  const auto count = static_cast<std::size_t>(pieces_begin_[chunk + 1] - first);
  costs_.assign(count, 0.0);
  failures_.resize(count);
  const int first_failed = EvaluateTasks(evaluator_.executor(), &failures_, [&](int k) {
    return EvaluatePiece(pieces_[first + k], known_point, moved_.empty() ? nullptr : &moved_[k],
                         &costs_[k]);
  });
  if (first_failed >= 0) {
    return evaluator_.DescribeFailure(/*jacobians=*/true, pieces_[first + first_failed].family,
                                      failures_[first_failed]);
  }
  in_memory_ = chunk;
  *cost = std::accumulate(costs_.begin(), costs_.end(), 0.0);
  return Status::Ok();
}

// Behind the last record from this one on whose factors follow each other, and are there; the
// record itself where its own is not.
int JacobianChunks::EndOfRun(const Piece& piece, int record) const {
  const FactorGraph& graph = evaluator_.graph();
  const bool gaps = graph.NumFreePlaces(piece.family) > 0;
  const int shift = FactorAt(piece.family, record) - record;
  int end = record;
  while (end < piece.end && FactorAt(piece.family, end) == end + shift &&
         (!gaps || graph.HasFactor(piece.family, end + shift))) {
    ++end;
  }
  return end;
}

// Where records are in the order of the factors a piece is one run, but for free places. Else it is
// cut into runs of factors that are neighbors in both orders, of a problem that was filled photo by
// photo mostly single ones; each is evaluated by its factors' numbers and written to its records,
// by views that are moved for it. Each piece of a chunk has such views of its own, so that tasks do
// not disturb each other.
EvaluationFailure JacobianChunks::EvaluatePiece(const Piece& piece, bool known_point, Moved* moved,
                                                double* cost) {
  Linearization& cache = evaluator_.families()[piece.family];
  for (int record = piece.begin; record < piece.end;) {
    const int end = EndOfRun(piece, record);
    const int factor = FactorAt(piece.family, record);
    LinearizationPlaces places = cache.places();
    if (factor != record) {
      // As if factor 0 were so many records before its own place.
      const std::ptrdiff_t before = factor - record;
      moved->slots.assign(cache.slots.begin(), cache.slots.end());
      moved->views.assign(cache.views.begin(), cache.views.end());
      for (std::size_t s = 0; s < cache.slots.size(); ++s) {
        moved->slots[s].data =
            AddressBefore(before * cache.slots[s].factor_stride, cache.slots[s].data);
        moved->views[s].data = moved->slots[s].data;
      }
      places = {moved->slots.data(), moved->views.data(),
                AddressBefore(before * cache.residual_size, places.residuals)};
    }
    if (end > record) {
      const EvaluationFailure failure =
          EvaluateRun(piece.family, factor, factor + end - record, known_point, places, cost);
      if (failure.failed()) {
        return failure;
      }
    }
    record = std::max(end, record + 1);  // a free place is passed over
  }
  return {};
}

// Losses are applied in groups of kSumSize from the beginning of the run, right after the
// evaluation, while its Jacobians are in the cache.
EvaluationFailure JacobianChunks::EvaluateRun(FamilyId family, int begin, int end, bool known_point,
                                              const LinearizationPlaces& places, double* cost) {
  Linearization& cache = evaluator_.families()[family];
  EvaluationFailure failure = cache.Linearize(begin, end, places);
  for (int first = begin; first < end && !failure.failed(); first += kSumSize) {
    *cost += SumCosts(/*linearized=*/true, known_point, evaluator_.loss_curvature(), first,
                      std::min(first + kSumSize, end), /*candidate_f=*/nullptr, places, &cache,
                      &failure);
  }
  return failure;
}

std::int64_t JacobianChunks::Bytes() const {
  std::size_t ints = ends_.size() + pieces_begin_.size();
  for (const std::vector<std::int32_t>& factors : factors_) {
    ints += factors.size();
  }
  return static_cast<std::int64_t>(ints * sizeof(int) + pieces_.size() * sizeof(Piece) +
                                   values_.size() * sizeof(double));
}

}  // namespace inceres::internal
