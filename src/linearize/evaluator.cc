#include "linearize/evaluator.h"

#include <algorithm>
#include <cstdint>
#include <iterator>
#include <numeric>
#include <string>

namespace inceres::internal {
namespace {

// factors per task on one thread, at most: a few tens of microseconds of built-in Jacobians
constexpr int kChunkSize = 256;
constexpr int kSumSize = 16;       // factors per sum of costs; chunks are so many or a multiple
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

// A NaN stays one.
void Clamp(const VariableBounds& bounds, double* x) {
  for (std::size_t k = 0; k < bounds.lower.size(); ++k) {
    x[k] = std::min(std::max(x[k], bounds.lower[k]), bounds.upper[k]);
  }
}

}  // namespace

Evaluator::Evaluator(const FactorGraph& graph, const Layout& layout, const Executor& executor,
                     JacobianStorage storage)
    : graph_(&graph),
      layout_(layout),
      executor_(executor),
      storage_(storage),
      current_(graph.state()),
      candidate_(graph.state()) {
  BuildTangents();
  BuildBounds();
  families_.reserve(graph.num_families());
  for (FamilyId id = 0; id < graph.num_families(); ++id) {
    BuildFamily(id);
    BuildChunks(id);
  }
  chunk_failures_.resize(chunks_.size());
}

// Where chunks are cut may depend on the number of threads, where sums of costs are may not. Both
// end at free places, which nobody evaluates: their residuals and Jacobians stay zero.
void Evaluator::BuildChunks(FamilyId id) {
  const int num_factors = families_[id].num_factors;
  const int task_size = executor_.num_threads() > 1 ? families_[id].family->TaskSize() : kChunkSize;
  const int chunk_size =
      (std::clamp(task_size, 1, kChunkSize) + kSumSize - 1) / kSumSize * kSumSize;
  const bool gaps = graph_->NumFreePlaces(id) > 0;
  for (int begin = 0; begin < num_factors;) {
    int end = std::min((begin / chunk_size + 1) * chunk_size, num_factors);
    for (int i = begin; gaps && i < end; ++i) {
      end = graph_->HasFactor(id, i) ? end : i;
    }
    if (end > begin) {
      chunks_.push_back({id, begin, end, static_cast<int>(sums_.size())});
      sums_.resize(sums_.size() +
                   static_cast<std::size_t>((end - 1) / kSumSize - begin / kSumSize + 1));
    }
    begin = std::max(end, begin + 1);
  }
}

void Evaluator::Rebind(const FactorGraph& graph) {
  graph_ = &graph;
  SetCurrent(graph.state());
  std::copy(graph.state().begin(), graph.state().end(), candidate_.begin());
  bounds_.clear();
  BuildBounds();
  // Without borrowed values all parameters are where they were: in the two states, at offsets of
  // the structure.
  const bool borrows = BorrowsValues(graph);
  for (Chunk& chunk : chunks_) {
    chunk.at_candidate = chunk.at_candidate && !borrows;
  }
  for (FamilyId id = 0; id < graph.num_families(); ++id) {
    if (borrows) {
      FindAllParameters(id);
    }
    if (storage_ == JacobianStorage::
                        // a loss that was not finite may have left 0 · ∞ in columns nobody writes
        kWholeRows) {
      ZeroedArray& J = families_[id].jacobian_values;
      std::fill_n(J.data(), J.size(), 0.0);
    }
    BindFamily(id);
  }
}

void Evaluator::BuildFamily(FamilyId id) {
  Linearization& cache = families_.emplace_back(*graph_, id);
  if (storage_ == JacobianStorage::kBySlot) {
    cache.Grow(graph_->NumFactors(id), graph_->NumFactors(id));
  } else {
    cache.GrowTables(graph_->NumFactors(id));
    PlaceWholeRows(&cache);
  }
  const VariableId* ids = cache.parameters.empty() ? nullptr : graph_->Variables(id, 0);
  executor_.For(static_cast<int>(cache.parameters.size()), kEntryGrain, [&](int begin, int end) {
    for (int k = begin; k < end; ++k) {
      // null at a free place
      cache.tangent_maps[k] = ids[k] < 0 ? nullptr : &tangents_[ids[k]].map();
    }
    if (storage_ == JacobianStorage::kBySlot) {
      PlaceInTangent(&cache, begin, end);
    }
  });
  FindAllParameters(id);
  BindFamily(id);
}

// The entries (factor and slot) from begin to end.
void Evaluator::PlaceInTangent(Linearization* cache, std::ptrdiff_t begin,
                               std::ptrdiff_t end) const {
  const VariableId* ids = begin < end ? graph_->Variables(cache->id, 0) : nullptr;
  for (std::ptrdiff_t k = begin; k < end; ++k) {
    const int position = ids[k] < 0 ? -1 : layout_.position[ids[k]];  // a free place has none
    cache->tangent_offsets[k] = position < 0 ? -1 : layout_.quad_offset[position];
  }
}

void Evaluator::LeaveOutZeroBlocks(const Chunk& chunk, Linearization* cache) {
  const std::size_t num_slots = cache->slots.size();
  for (std::size_t s = 0; s < num_slots; ++s) {
    const SlotJacobians& slot = cache->slots[s];
    const double* J = slot.data + chunk.begin * slot.factor_stride;
    for (int i = chunk.begin; i < chunk.end; ++i, J += slot.factor_stride) {
      if (std::all_of(J, J + slot.factor_stride, [](double entry) { return entry == 0.0; })) {
        cache->tangent_offsets[i * num_slots + s] = -1;
      }
    }
  }
}

void Evaluator::PlaceWholeRows(Linearization* cache) const {
  cache->storage = JacobianStorage::kWholeRows;
  cache->candidate_residuals = ZeroedArray(cache->residuals.size());
  cache->candidate_parameters.resize(cache->parameters.size());
  const int row_stride = PadToQuad(layout_.size());
  const std::ptrdiff_t factor_stride = std::ptrdiff_t{cache->residual_size} * row_stride;
  cache->jacobian_values =
      ZeroedArray(static_cast<std::size_t>(cache->num_factors * factor_stride));
  double* const J = cache->jacobian_values.data();
  cache->slots = {{J, factor_stride, row_stride, layout_.size()}};
  cache->tangent_offsets = {0};
  for (int s = 0; cache->num_factors > 0 && s < cache->num_slots; ++s) {
    const int position = layout_.position[graph_->Variables(cache->id, 0)[s]];
    cache->views[s] = {J + (position < 0 ? 0 : layout_.packed_offset[position]), factor_stride,
                       row_stride};
  }
}

// What of a family's cache is the graph's own.
void Evaluator::BindFamily(FamilyId id) {
  Linearization& cache = families_[id];
  cache.graph = graph_;
  cache.family = &graph_->family(id);
  const VariableId* ids = cache.parameters.empty() ? nullptr : graph_->Variables(id, 0);
  cache.pins.clear();
  for (std::size_t k = 0; graph_->HasPins() && k < cache.parameters.size(); ++k) {
    const bool moves = ids[k] >= 0 && layout_.position[ids[k]] >= 0;
    cache.Pin(k, moves ? graph_->PinnedValues(ids[k]) : nullptr);
  }
}

void Evaluator::FindAllParameters(FamilyId id) {
  Linearization& cache = families_[id];
  FindParameters(current_, id, &cache.parameters);
  FindParameters(candidate_, id, &cache.candidate_parameters);
}

// Of all factors of the family, or of none where there is no room for them.
void Evaluator::FindParameters(const std::vector<double>& state, FamilyId id,
                               std::vector<const double*>* parameters) const {
  const int num_slots = graph_->family(id).num_slots();
  const VariableId* ids = parameters->empty() ? nullptr : graph_->Variables(id, 0);
  executor_.For(static_cast<int>(parameters->size()), kEntryGrain, [&](int begin, int end) {
    const double** const result = parameters->data();
    for (int k = begin; k < end; ++k) {
      if (k - num_slots >= begin &&
          ids[k] == ids[k - num_slots]) {  // as that of the factor before, as many are
        result[k] = result[k - num_slots];
      } else if (ids[k] >= 0) {  // not a free place
        result[k] = graph_->ValuesIn(state.data(), ids[k]);
      }
    }
  });
}

void Evaluator::BuildTangents() {
  tangents_.resize(graph_->num_variables());
  for (VariableId id = 0; id < graph_->num_variables(); ++id) {
    tangents_[id].Set(*graph_, id, /*wanted=*/layout_.position[id] >= 0);
  }
  std::copy_if(layout_.variables.begin(), layout_.variables.end(), std::back_inserter(curved_),
               [this](VariableId id) { return tangents_[id].is_curved(); });
}

void Evaluator::BuildBounds() {
  for (std::size_t i = 0; graph_->HasBounds() && i < layout_.variables.size(); ++i) {
    if (const VariableBounds* bounds = graph_->bounds(layout_.variables[i])) {
      bounds_.resize(layout_.variables.size());
      bounds_[i] = bounds;
    }
  }
}

// compute(tangent, id, x) of all that have a manifold; it returns what is wrong.
template <typename Compute>
Status Evaluator::ComputeTangents(const std::vector<double>& state, const Compute& compute) {
  for (const VariableId id : curved_) {
    if (const char* fault = compute(&tangents_[id], id, graph_->ValuesIn(state.data(), id))) {
      return Status::Error(
          StatusCode::kEvaluationFailed,
          "PlusJacobian of the manifold of variable " + std::to_string(id) + " " + fault);
    }
  }
  return Status::Ok();
}

bool Evaluator::MoveCandidate(const double* delta) {
  for (std::size_t i = 0; i < layout_.variables.size(); ++i) {
    const VariableId id = layout_.variables[i];
    const std::int64_t offset = graph_->StateOffset(id);
    const double* x = current_.data() + offset;
    double* moved = candidate_.data() + offset;
    if (!MoveVariable(*graph_, id, x, delta + layout_.packed_offset[i], moved)) {
      return false;
    }
    if (IsConstrained() && bounds_[i] != nullptr) {
      Clamp(*bounds_[i], moved);
    }
  }
  return true;
}

// Parameters that are not of the state, constants in the user's memory, stay where they are. Whole
// rows keep both points'.
void Evaluator::PointTo(bool candidate, Chunk* chunk) {
  if (storage_ == JacobianStorage::kWholeRows || chunk->at_candidate == candidate) {
    return;
  }
  chunk->at_candidate = candidate;
  Linearization& cache = families_[chunk->family];
  const double* const from = candidate ? current_.data() : candidate_.data();
  const double* const to = candidate ? candidate_.data() : current_.data();
  const auto address = [](const double* p) { return reinterpret_cast<std::uintptr_t>(p); };
  const std::uintptr_t size = current_.size() * sizeof(double);
  for (std::ptrdiff_t k = cache.Entry(chunk->begin); k < cache.Entry(chunk->end); ++k) {
    const double* const p = cache.parameters[k];
    if (address(p) - address(from) < size) {
      cache.parameters[k] = to + (p - from);
    }
  }
}

void Evaluator::PointToCandidate() {
  for (Chunk& chunk : chunks_) {
    PointTo(/*candidate=*/true, &chunk);
  }
}

EvaluationFailure Evaluator::EvaluateChunk(bool jacobians, Chunk* chunk) {
  PointTo(!jacobians, chunk);
  Linearization& cache = families_[chunk->family];
  if (jacobians && leaves_out_zero_blocks_) {
    PlaceInTangent(&cache, cache.Entry(chunk->begin), cache.Entry(chunk->end));
  }
  const EvaluationFailure failure = jacobians ? cache.Linearize(chunk->begin, chunk->end)
                                              : cache.EvaluateCandidate(chunk->begin, chunk->end);
  if (!failure.failed()) {
    double* sum = sums_.data() + chunk->first_sum;
    for (int begin = chunk->begin; begin < chunk->end;) {
      const int end = std::min((begin / kSumSize + 1) * kSumSize, chunk->end);
      *sum++ = SumCosts(jacobians, &cache, begin, end);
      begin = end;
    }
    if (jacobians && leaves_out_zero_blocks_) {
      LeaveOutZeroBlocks(*chunk, &cache);
    }
  }
  return failure;
}

// And robustifies, with Jacobians.
double Evaluator::SumCosts(bool jacobians, Linearization* family_cache, int begin, int end) {
  Linearization& cache = *family_cache;
  double* residuals = jacobians ? cache.residuals.data() : cache.candidate_residuals.data();
  const int rows = cache.residual_size;
  if (!graph_->HasLosses(cache.id)) {
    return PlainCost(residuals + static_cast<std::ptrdiff_t>(begin) * rows,
                     static_cast<std::ptrdiff_t>(end - begin) * rows);
  }
  const auto num_slots = static_cast<int>(cache.slots.size());
  const std::ptrdiff_t offset_stride = cache.storage == JacobianStorage::kBySlot ? num_slots : 0;
  double cost = 0.0;
  for (int i = begin; i < end; ++i) {
    double* f = residuals + static_cast<std::ptrdiff_t>(i) * rows;
    const Loss* loss = graph_->loss(cache.id, i);
    cost += jacobians ? RobustifyFactor(loss, rows, num_slots, cache.slots.data(), i,
                                        cache.tangent_offsets.data() + i * offset_stride,
                                        loss_curvature_, f)
                      : RobustCost(loss, f, rows);
  }
  return cost;
}

Status Evaluator::DescribeFailure(bool jacobians, FamilyId id,
                                  const EvaluationFailure& failure) const {
  const Linearization& cache = families_[id];
  return Status::Error(
      StatusCode::kEvaluationFailed,
      graph_->DescribeFailure(id, failure,
                              jacobians ? cache.Parameters(failure.factor)
                                        : cache.CandidateParameters(failure.factor)));
}

// Announces all factors of a family that asks for it.
Status Evaluator::Prepare(bool jacobians, FamilyId id) {
  if (!families_[id].family->Prepares()) {
    return Status::Ok();
  }
  announced_.clear();
  for (Chunk& chunk : chunks_) {
    if (chunk.family != id) {
      continue;
    }
    PointTo(!jacobians, &chunk);
    for (int i = chunk.begin; i < chunk.end; ++i) {
      announced_.push_back(i);
    }
  }
  const EvaluationFailure failure = families_[id].Prepare(jacobians, announced_);
  return failure.failed() ? DescribeFailure(jacobians, id, failure) : Status::Ok();
}

Status Evaluator::EvaluateAll(bool jacobians, double* cost) {
  for (FamilyId id = 0; id < static_cast<int>(families_.size()); ++id) {
    const Status status = Prepare(jacobians, id);
    if (!status.ok()) {
      return status;
    }
  }
  const int first_failed = EvaluateTasks(
      executor_, &chunk_failures_, [&](int k) { return EvaluateChunk(jacobians, &chunks_[k]); });
  if (first_failed >= 0) {
    return DescribeFailure(jacobians, chunks_[first_failed].family, chunk_failures_[first_failed]);
  }
  *cost = std::accumulate(sums_.begin(), sums_.end(), 0.0);
  return Status::Ok();
}

Status Evaluator::EvaluateCandidateCost(double* cost) {
  const Status status =
      ComputeTangents(candidate_, [this](Tangent* tangent, VariableId id, const double* x) {
        return tangent->ComputeCandidate(*graph_, id, x);
      });
  return status.ok() ? EvaluateAll(/*jacobians=*/false, cost) : status;
}

void Evaluator::AcceptCandidate() {
  current_.swap(candidate_);
  for (const VariableId id : curved_) {
    tangents_[id].AcceptCandidate();
  }
  for (Chunk& chunk : chunks_) {
    chunk.at_candidate = !chunk.at_candidate;
  }
  if (storage_ == JacobianStorage::kWholeRows) {
    for (Linearization& cache : families_) {
      cache.parameters.swap(cache.candidate_parameters);
    }
  }
}

int Evaluator::Recenter() {
  int num_changed = 0;
  for (Chunk& chunk : chunks_) {
    if (families_[chunk.family].family->Recenters()) {
      PointTo(/*candidate=*/false, &chunk);
    }
  }
  for (const Linearization& cache : families_) {
    for (int i = 0; cache.family->Recenters() && i < cache.num_factors; ++i) {
      const bool there = graph_->NumFreePlaces(cache.id) == 0 || graph_->HasFactor(cache.id, i);
      num_changed += there && cache.family->Recenter(i, cache.Parameters(i)) ? 1 : 0;
    }
  }
  return num_changed;
}

void Evaluator::SetCurrent(const std::vector<double>& state) {
  std::copy(state.begin(), state.end(), current_.begin());  // in place: the families point into it
}

Status Evaluator::EvaluateJacobians(bool known_point, double* cost) {
  if (!known_point) {
    Status status =
        ComputeTangents(current_, [this](Tangent* tangent, VariableId id, const double* x) {
          return tangent->Compute(*graph_, id, x);
        });
    if (!status.ok()) {
      return status;
    }
  }
  return EvaluateAll(/*jacobians=*/true, cost);
}

std::int64_t Evaluator::Bytes() const {
  std::int64_t bytes = 0;
  for (const Linearization& cache : families_) {
    bytes += static_cast<std::int64_t>(sizeof(double) *
                                       (cache.residuals.size() * 2 + cache.jacobian_values.size()));
    bytes += static_cast<std::int64_t>(cache.parameters.size() *
                                       (2 * sizeof(void*) + sizeof(std::int32_t)));
    bytes += static_cast<std::int64_t>(cache.candidate_parameters.size() * sizeof(void*));
  }
  for (const VariableId id : curved_) {
    bytes += static_cast<std::int64_t>(sizeof(double) * 2 * graph_->AmbientSize(id) *
                                       graph_->TangentSize(id));
  }
  return bytes + static_cast<std::int64_t>(sizeof(double) * current_.size() * 2);
}

}  // namespace inceres::internal
