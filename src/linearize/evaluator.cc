#include "linearize/evaluator.h"

#include <algorithm>
#include <cstdint>
#include <numeric>

#include "base/address.h"
#include "linearize/jacobian_places.h"
#include "linearize/robust_costs.h"
#include "linearize/single_jacobians.h"
#include "linearize/variable_look_up.h"

namespace inceres::internal {
namespace {

// Residuals, Jacobians and costs of all factors (docs/algorithms.md, "Linearization";
// docs/ceres_contract.md, "Evaluation").
//
// Tasks are chunks of factors of one family. Their parameters are one table of pointers into one of
// the two states (PointPair), found once: evaluating at the other point swaps what the states hold,
// so no pointer is touched.
//
// The bits do not depend on the number of threads: a cost is summed over groups of kSumSize
// factors, each group by one task, and the groups in their order. Chunks are multiples of these
// groups. The failure that is reported is that of the first chunk that fails, whoever met it
// first.

// factors per task on one thread, at most: a few tens of microseconds of built-in Jacobians
constexpr int kChunkSize = 256;
constexpr int kEntryGrain = 8192;  // connections per task, a few nanoseconds each

// Whether the values of any variable lie in memory that is not the graph's.
bool BorrowsValues(const FactorGraph& graph) {
  for (VariableId id = 0; id < graph.num_variables(); ++id) {
    if (graph.StateOffset(id) < 0) {
      return true;
    }
  }
  return false;
}

}  // namespace

Evaluator::Evaluator(const FactorGraph& graph, const Layout& layout, const Executor& executor,
                     JacobianStorage storage)
    : graph_(&graph),
      layout_(layout),
      executor_(executor),
      storage_(storage),
      points_(graph, layout) {
  families_.reserve(graph.num_families());
  for (FamilyId id = 0; id < graph.num_families(); ++id) {
    BuildFamily(id);
    BuildChunks(id);
  }
  CutStrips();
  if (storage == JacobianStorage::kInChunks) {
    jacobian_chunks_ = std::make_unique<JacobianChunks>(this);
  }
}

// The chunks of a family that has strips, as many as fit into one; those of the others as they
// come.
void Evaluator::CutStrips() {
  for (int k = 0; k < static_cast<int>(chunks_.size()); ++k) {
    const Chunk& chunk = chunks_[k];
    const int family = families_[chunk.family].has_strips() ? chunk.family : -1;
    const bool goes_on = !strips_.empty() && strips_.back().family == family &&
                         (family < 0 || chunk.end - chunks_[strips_.back().begin].begin <=
                                            Linearization::kStripSize);
    if (!goes_on) {
      strips_.push_back({family, k, k});
    }
    strips_.back().end = k + 1;
  }
  const auto has_strips = [](const Linearization& cache) { return cache.has_strips(); };
  const auto keeps_singles = [](const Linearization& cache) { return cache.keeps_singles(); };
  if (std::none_of(families_.begin(), families_.end(), has_strips)) {
    strips_.clear();
  }
  if (std::any_of(families_.begin(), families_.end(), keeps_singles)) {
    gradient_.resize(static_cast<std::size_t>(layout_.quad_offset.back()) * kQuad);
  }
}

// Where chunks are cut may depend on the number of threads, where sums of costs are may not. Both
// end at free places, which nobody evaluates: their residuals and Jacobians stay zero.
void Evaluator::BuildChunks(FamilyId id) {
  const int num_factors = families_[id].num_factors;
  // Costly families (user code) are cut finer where there are threads to share them.
  const int task_size = executor_.num_threads() > 1 ? families_[id].family->TaskSize() : kChunkSize;
  const int chunk_size = InWholeSums(task_size, kChunkSize);
  const bool gaps = graph_->NumFreePlaces(id) > 0;
  for (int begin = 0; begin < num_factors;) {
    // Cut at multiples of chunk_size from the family's beginning, so that a free place shifts no
    // later cut.
    int end = std::min((begin / chunk_size + 1) * chunk_size, num_factors);
    for (int i = begin; gaps && i < end; ++i) {
      end = graph_->HasFactor(id, i) ? end : i;
    }
    if (end > begin) {
      // Where a chunk begins or ends at a free place its first or last group has fewer factors.
      chunks_.push_back({id, begin, end, static_cast<int>(sums_.size())});
      sums_.resize(sums_.size() +
                   static_cast<std::size_t>((end - 1) / kSumSize - begin / kSumSize + 1));
    }
    // A free place ends a chunk and is passed over.
    begin = std::max(end, begin + 1);
  }
}

// Same structure, so chunks, tables and offsets stay; what is rebound is what a graph owns:
// families, losses, pins, and values that lie elsewhere.
void Evaluator::Rebind(const FactorGraph& graph) {
  graph_ = &graph;
  points_.Rebind(graph);
  // Without borrowed values all parameters are where they were, at offsets of the structure.
  const bool borrows = BorrowsValues(graph);
  for (FamilyId id = 0; id < graph.num_families(); ++id) {
    if (borrows) {
      FindParameters(id);
    }
    // a loss that was not finite may have left 0 · ∞ in columns nobody writes
    if (storage_ == JacobianStorage::kWholeRows) {
      ZeroedArray& J = families_[id].jacobian_values;
      std::fill_n(J.data(), J.size(), 0.0);
    }
    BindFamily(id);
  }
}

void Evaluator::BuildFamily(FamilyId id) {
  Linearization& cache = families_.emplace_back(*graph_, id);
  PlaceJacobians(layout_, storage_, &cache);
  const VariableId* ids = cache.parameters.empty() ? nullptr : graph_->Variables(id, 0);
  // Entries are independent of each other.
  executor_.For(static_cast<int>(cache.parameters.size()), kEntryGrain, [&](int begin, int end) {
    for (int k = begin; k < end; ++k) {
      // null at a free place
      cache.tangent_maps[k] = ids[k] < 0 ? nullptr : &points_.tangent_map(ids[k]);
    }
    if (storage_ != JacobianStorage::kWholeRows) {
      PlaceInTangent(layout_, begin, end, &cache);
    }
  });
  if (storage_ == JacobianStorage::kBySlot) {
    ClearUnwritten(&cache);
  }
  FindParameters(id);
  BindFamily(id);
}

void Evaluator::MakeRoomToKeep() {
  for (Linearization& cache : families_) {
    if (HasRoomFor(cache.BytesToKeep())) {
      Take(cache.BytesToKeep(), "the Jacobians of coordinate descent");
      cache.MakeRoomToKeep();
    }
  }
}

void Evaluator::set_leaves_out_zero_blocks(bool leaves_out) {
  leaves_out_zero_blocks_ = leaves_out;
  KeepAllOffsets(leaves_out, &families_);
}

// What of a family's cache is the graph's own.
void Evaluator::BindFamily(FamilyId id) {
  Linearization& cache = families_[id];
  cache.KeepEvaluations(false);
  cache.graph = graph_;
  cache.family = &graph_->family(id);
  if (graph_->HasLosses(id)) {
    cache.loss_values.resize(cache.num_factors);
  }
  const VariableId* ids = cache.parameters.empty() ? nullptr : graph_->Variables(id, 0);
  cache.pins.clear();
  // A variable that does not move has no Jacobian that a pin could freeze.
  for (std::size_t k = 0; graph_->HasPins() && k < cache.parameters.size(); ++k) {
    const bool moves = ids[k] >= 0 && layout_.position[ids[k]] >= 0;
    cache.Pin(k, moves ? graph_->PinnedValues(ids[k]) : nullptr);
  }
}

// Of all factors of the family. Neighboring factors mostly share variables slot by slot, so that
// the lookup is spared.
void Evaluator::FindParameters(FamilyId id) {
  const int num_slots = graph_->family(id).num_slots();
  UnwrittenVector<const double*>& parameters = families_[id].parameters;
  const VariableId* ids = parameters.empty() ? nullptr : graph_->Variables(id, 0);
  const double* const state = points_.pointed().data();
  executor_.For(static_cast<int>(parameters.size()), kEntryGrain, [&](int begin, int end) {
    const double** const result = parameters.data();
    for (int k = begin; k < end; ++k) {
      if (k - num_slots >= begin &&
          ids[k] == ids[k - num_slots]) {  // as that of the factor before, as many are
        result[k] = result[k - num_slots];
      } else {  // null at a free place
        result[k] = ids[k] < 0 ? nullptr : graph_->ValuesIn(state, ids[k]);
      }
    }
  });
}

EvaluationFailure Evaluator::EvaluateChunk(bool jacobians, bool known_point, const Chunk& chunk) {
  Linearization& cache = families_[chunk.family];
  // Residuals that nobody reads again once their costs are summed.
  double of_chunk[kChunkSize * VariableLookUp::kMostRows];
  double* const candidate_f =
      cache.look_up != nullptr
          ? AddressBefore(std::ptrdiff_t{chunk.begin} * cache.residual_size, of_chunk)
          : cache.candidate_residuals.data();
  EvaluationFailure failure = jacobians
                                  ? cache.Linearize(chunk.begin, chunk.end)
                                  : cache.EvaluateCandidate(chunk.begin, chunk.end, candidate_f);
  if (jacobians && leaves_out_zero_blocks_) {
    PlaceNonzeroBlocks(chunk.begin, chunk.end, &cache);
  }
  // The group's sums stay those of an earlier pass after a failure, and nobody reads them.
  if (!failure.failed()) {
    SumCostsByGroup(jacobians, known_point, loss_curvature_, chunk.begin, chunk.end, candidate_f,
                    cache.places(), &cache, sums_.data() + chunk.first_sum, &failure);
    if (jacobians && leaves_out_zero_blocks_) {
      LeaveOutZeroBlocks(chunk.begin, chunk.end, &cache);
    }
    if (jacobians && cache.has_strips() && !failure.failed()) {
      cache.KeepStrip(chunk.begin, chunk.end);
    }
  }
  return failure;
}

// With the values at which it failed, by name.
Status Evaluator::DescribeFailure(bool jacobians, FamilyId id, const EvaluationFailure& failure) {
  failed_factor_ = {id, failure.factor, -1};
  const Linearization& cache = families_[id];
  return Status::Error(
      StatusCode::kEvaluationFailed,
      graph_->DescribeFailure(id, failure, ParametersOf(cache, failure.factor, !jacobians).data()));
}

// Announces all factors of a family that asks for it.
// In the order of the chunks, so the list ascends.
Status Evaluator::Prepare(bool jacobians, FamilyId id) {
  announced_.clear();
  for (const Chunk& chunk : chunks_) {
    for (int i = chunk.begin; chunk.family == id && i < chunk.end; ++i) {
      announced_.push_back(i);
    }
  }
  const EvaluationFailure failure = families_[id].Prepare(jacobians, announced_);
  return failure.failed() ? DescribeFailure(jacobians, id, failure) : Status::Ok();
}

// Announcements come first and on one thread: a family that prepares is told everything before any
// of it is evaluated.
Status Evaluator::EvaluateAll(bool jacobians, bool known_point, double* cost) {
  // Jacobians are taken at the current point, costs at the candidate.
  points_.PointTo(/*candidate=*/!jacobians);
  for (const Linearization& cache : families_) {
    if (!cache.family->Prepares()) {
      continue;
    }
    Status status = Prepare(jacobians, cache.id);
    if (!status.ok()) {
      return status;
    }
  }
  const Status status =
      jacobians && !strips_.empty()
          ? EvaluateStrips(known_point)
          : EvaluateChunks(jacobians, known_point, 0, static_cast<int>(chunks_.size()));
  if (status.ok()) {
    // Groups in the order of the graph, on one thread.
    *cost = std::accumulate(sums_.begin(), sums_.end(), 0.0);
  }
  return status;
}

Status Evaluator::EvaluateChunks(bool jacobians, bool known_point, int begin, int end) {
  chunk_failures_.resize(static_cast<std::size_t>(end - begin));
  const int first_failed = EvaluateTasks(executor_, &chunk_failures_, [&](int k) {
    return EvaluateChunk(jacobians, known_point, chunks_[begin + k]);
  });
  return first_failed < 0 ? Status::Ok()
                          : DescribeFailure(jacobians, chunks_[begin + first_failed].family,
                                            chunk_failures_[first_failed]);
}

// With Jacobians, some of them a strip of factors at a time.
Status Evaluator::EvaluateStrips(bool known_point) {
  executor_.For(static_cast<int>(gradient_.size()) / kQuad, kEntryGrain, [&](int begin, int end) {
    std::fill(gradient_.begin() + std::ptrdiff_t{begin} * kQuad,
              gradient_.begin() + std::ptrdiff_t{end} * kQuad, 0.0);
  });
  for (const Strip& strip : strips_) {
    if (strip.family >= 0) {
      families_[strip.family].BeginStrip(chunks_[strip.begin].begin);
    }
    const Status status = EvaluateChunks(/*jacobians=*/true, known_point, strip.begin, strip.end);
    if (strip.family >= 0) {
      if (status.ok() && families_[strip.family].keeps_singles()) {
        // Where strips end depends on the chunks, and so on the number of threads; a variable's sum
        // goes on from strip to strip, factor by factor, and does not.
        AddGradient(families_[strip.family], chunks_[strip.begin].begin, chunks_[strip.end - 1].end,
                    executor_, gradient_.data());
      }
      families_[strip.family].EndStrip();
    }
    if (!status.ok()) {
      return status;
    }
  }
  return Status::Ok();
}

// PlusJacobian at the candidate comes first, as in Ceres, and a failure there is one of the
// evaluation.
Status Evaluator::EvaluateCandidateCost(double* cost, bool knows_tangents) {
  const Status status = knows_tangents ? Status::Ok() : points_.ComputeCandidateTangents();
  return status.ok() ? EvaluateAll(/*jacobians=*/false, /*known_point=*/false, cost) : status;
}

// On one thread: expansion points are state of the families.
int Evaluator::Recenter() {
  int num_changed = 0;
  points_.PointTo(/*candidate=*/false);
  for (const Linearization& cache : families_) {
    for (int i = 0; cache.family->Recenters() && i < cache.num_factors; ++i) {
      const bool there = graph_->NumFreePlaces(cache.id) == 0 || graph_->HasFactor(cache.id, i);
      num_changed += there && cache.family->Recenter(i, cache.Parameters(i)) ? 1 : 0;
    }
  }
  return num_changed;
}

// A known point has been evaluated for its cost: its tangent maps came with that.
Status Evaluator::EvaluateJacobians(bool known_point, double* cost, bool knows_tangents) {
  if (!known_point && !knows_tangents) {
    Status status = points_.ComputeTangents();
    if (!status.ok()) {
      return status;
    }
  }
  const Status status = jacobian_chunks_ != nullptr
                            ? jacobian_chunks_->Linearize(known_point, cost)
                            : EvaluateAll(/*jacobians=*/true, known_point, cost);
  // Nobody comes back to this point.
  KeepEvaluations(false, &families_);
  return status;
}

std::int64_t Evaluator::Bytes() const {
  std::int64_t bytes = 0;
  for (const Linearization& cache : families_) {
    bytes += BytesOf(cache);
  }
  bytes += jacobian_chunks_ != nullptr ? jacobian_chunks_->Bytes() : 0;
  return bytes + static_cast<std::int64_t>(sizeof(double) * gradient_.size()) + points_.Bytes();
}

}  // namespace inceres::internal
