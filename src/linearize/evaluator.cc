#include "linearize/evaluator.h"

#include <algorithm>
#include <cstdint>
#include <string>

#include "base/lowest_index.h"
#include "linearize/moved_factors.h"
#include "linearize/robustify.h"
#include "linearize/tangent_classes.h"

namespace inceres::internal {
namespace {

constexpr int kChunkSize = 256;    // factors per task on one thread, at most: a few tens of microseconds of built-in Jacobians
constexpr int kSumSize = 16;       // factors per sum of costs; chunks are so many or a multiple
constexpr int kEntryGrain = 8192;  // connections per task, a few nanoseconds each

// What whole rows serve.
constexpr int kMaxWholeColumns = 16;
constexpr std::int64_t kMaxWholeRows = 1024;

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

JacobianStorage StorageFor(const FactorGraph& graph, const Layout& layout) {
  std::int64_t num_rows = 0;
  bool whole = layout.num_landmarks() == 0 && layout.size() <= kMaxWholeColumns;
  for (FamilyId id = 0; whole && id < graph.num_families(); ++id) {
    const std::int64_t num_factors = graph.NumFactors(id);
    num_rows += num_factors * graph.family(id).residual_size();
    whole = num_rows <= kMaxWholeRows && graph.NumFreePlaces(id) == 0;
    if (whole && num_factors > 1) {
      const VariableId* ids = graph.Variables(id, 0);
      whole = std::equal(ids, ids + (num_factors - 1) * graph.family(id).num_slots(), graph.Variables(id, 1));
    }
  }
  return whole ? JacobianStorage::kWholeRows : JacobianStorage::kBySlot;
}

FactorRows FamilyCache::Rows(int begin, int end) const {
  FactorRows rows;
  rows.begin = begin;
  rows.end = end;
  rows.residual_size = rows_per_block();
  rows.num_slots = static_cast<int>(slots.size());
  rows.jacobians = slots.data();
  rows.residuals = residuals.data();
  rows.tangent_offsets = tangent_offsets.data();
  return rows;
}

Evaluator::Evaluator(const FactorGraph& graph, const Layout& layout, const Executor& executor, JacobianStorage storage)
    : graph_(&graph),
      layout_(layout),
      executor_(executor),
      storage_(storage),
      current_(graph.state()),
      candidate_(graph.state()) {
  BuildMaps();
  BuildBounds();
  families_.resize(graph.num_families());
  for (FamilyId id = 0; id < graph.num_families(); ++id) {
    BuildFamily(id);
    BuildChunks(id);
  }
  chunk_failures_.resize(chunks_.size());
}

// Where chunks are cut may depend on the number of threads, where sums of costs are may not. Both end at free places, which
// nobody evaluates: their residuals and Jacobians stay zero.
void Evaluator::BuildChunks(FamilyId id) {
  const int num_factors = families_[id].num_factors;
  const int task_size = executor_.num_threads() > 1 ? families_[id].family->TaskSize() : kChunkSize;
  const int chunk_size = (std::clamp(task_size, 1, kChunkSize) + kSumSize - 1) / kSumSize * kSumSize;
  const bool gaps = graph_->NumFreePlaces(id) > 0;
  for (int begin = 0; begin < num_factors;) {
    int end = std::min((begin / chunk_size + 1) * chunk_size, num_factors);
    for (int i = begin; gaps && i < end; ++i) {
      end = graph_->HasFactor(id, i) ? end : i;
    }
    if (end > begin) {
      chunks_.push_back({id, begin, end, static_cast<int>(sums_.size())});
      sums_.resize(sums_.size() + static_cast<std::size_t>((end - 1) / kSumSize - begin / kSumSize + 1));
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
  // Without borrowed values all parameters are where they were: in the two states, at offsets of the structure.
  const bool borrows = BorrowsValues(graph);
  for (Chunk& chunk : chunks_) {
    chunk.at_candidate = chunk.at_candidate && !borrows;
  }
  for (FamilyId id = 0; id < graph.num_families(); ++id) {
    if (borrows) {
      FindAllParameters(id);
    }
    if (storage_ == JacobianStorage::kWholeRows) {  // a loss that was not finite may have left 0 · ∞ in columns nobody writes
      ZeroedArray& J = families_[id].jacobian_values;
      std::fill_n(J.data(), J.size(), 0.0);
    }
    BindFamily(id);
  }
}

void Evaluator::BuildFamily(FamilyId id) {
  FamilyCache& cache = families_[id];
  const FactorFamily& family = graph_->family(id);
  cache.id = id;
  cache.family = &family;
  cache.storage = storage_;
  cache.num_factors = graph_->NumFactors(id);
  const auto n = static_cast<std::size_t>(cache.num_factors);
  const auto rows = static_cast<std::size_t>(family.residual_size());
  cache.residuals = ZeroedArray(n * rows);
  cache.candidate_residuals = ZeroedArray(n * rows);

  const std::size_t num_entries = n * static_cast<std::size_t>(family.num_slots());
  cache.parameters.resize(num_entries);
  cache.candidate_parameters.resize(storage_ == JacobianStorage::kWholeRows ? num_entries : 0);
  cache.tangent_maps.resize(num_entries);
  const VariableId* ids = num_entries > 0 ? graph_->Variables(id, 0) : nullptr;
  executor_.For(static_cast<int>(num_entries), kEntryGrain, [&](int begin, int end) {
    for (int k = begin; k < end; ++k) {
      cache.tangent_maps[k] = ids[k] < 0 ? nullptr : &maps_[ids[k]];  // null at a free place
    }
  });
  if (storage_ == JacobianStorage::kBySlot) {
    PlaceSlots(&cache);
  } else {
    PlaceWholeRows(&cache);
  }
  FindAllParameters(id);
  BindFamily(id);
}

void Evaluator::PlaceSlots(FamilyCache* cache) const {
  const FactorFamily& family = *cache->family;
  const std::ptrdiff_t n = cache->num_factors;
  std::ptrdiff_t total = 0;
  for (int s = 0; s < family.num_slots(); ++s) {
    const int row_stride = PadToQuad(family.slot(s).tangent_size);
    const std::ptrdiff_t factor_stride = std::ptrdiff_t{family.residual_size()} * row_stride;
    cache->slots.push_back({nullptr, factor_stride, row_stride, family.slot(s).tangent_size});
    total += n * factor_stride;
  }
  cache->jacobian_values = ZeroedArray(static_cast<std::size_t>(total));
  double* next = cache->jacobian_values.data();
  for (SlotJacobians& slot : cache->slots) {
    slot.data = next;
    next += n * slot.factor_stride;
    cache->views.push_back({slot.data, slot.factor_stride, slot.row_stride});
  }
  const std::size_t num_entries = cache->parameters.size();
  cache->tangent_offsets.resize(num_entries);
  executor_.For(static_cast<int>(num_entries), kEntryGrain, [&](int begin, int end) { PlaceInTangent(cache, begin, end); });
}

// The entries (factor and slot) from begin to end.
void Evaluator::PlaceInTangent(FamilyCache* cache, std::ptrdiff_t begin, std::ptrdiff_t end) const {
  const VariableId* ids = begin < end ? graph_->Variables(cache->id, 0) : nullptr;
  for (std::ptrdiff_t k = begin; k < end; ++k) {
    const int position = ids[k] < 0 ? -1 : layout_.position[ids[k]];  // a free place has none
    cache->tangent_offsets[k] = position < 0 ? -1 : layout_.quad_offset[position];
  }
}

void Evaluator::LeaveOutZeroBlocks(const Chunk& chunk, FamilyCache* cache) {
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

void Evaluator::PlaceWholeRows(FamilyCache* cache) const {
  const FactorFamily& family = *cache->family;
  const int row_stride = PadToQuad(layout_.size());
  const std::ptrdiff_t factor_stride = std::ptrdiff_t{family.residual_size()} * row_stride;
  cache->jacobian_values = ZeroedArray(static_cast<std::size_t>(cache->num_factors * factor_stride));
  double* const J = cache->jacobian_values.data();
  cache->slots.push_back({J, factor_stride, row_stride, layout_.size()});
  cache->tangent_offsets.push_back(0);
  for (int s = 0; cache->num_factors > 0 && s < family.num_slots(); ++s) {
    const int position = layout_.position[graph_->Variables(cache->id, 0)[s]];
    cache->views.push_back({J + (position < 0 ? 0 : layout_.packed_offset[position]), factor_stride, row_stride});
  }
}

// What of a family's cache is the graph's own.
void Evaluator::BindFamily(FamilyId id) {
  FamilyCache& cache = families_[id];
  cache.family = &graph_->family(id);
  cache.has_losses = graph_->HasLosses(id);
  const std::size_t num_entries = cache.parameters.size();
  const VariableId* ids = num_entries > 0 ? graph_->Variables(id, 0) : nullptr;
  cache.pins.clear();
  for (std::size_t k = 0; graph_->HasPins() && k < num_entries; ++k) {
    const bool moves = ids[k] >= 0 && layout_.position[ids[k]] >= 0;
    const double* pinned = moves ? graph_->PinnedValues(ids[k]) : nullptr;
    if (pinned != nullptr) {
      cache.pins.resize(num_entries, nullptr);
      cache.pins[k] = pinned;
    }
  }
  cache.jacobian_parameters.resize(cache.pins.size());
}

void Evaluator::FindAllParameters(FamilyId id) {
  FamilyCache& cache = families_[id];
  FindParameters(current_, id, &cache.parameters);
  FindParameters(candidate_, id, &cache.candidate_parameters);
}

// Of all factors of the family, or of none where there is no room for them.
void Evaluator::FindParameters(const std::vector<double>& state, FamilyId id, std::vector<const double*>* parameters) const {
  const int num_slots = graph_->family(id).num_slots();
  const VariableId* ids = parameters->empty() ? nullptr : graph_->Variables(id, 0);
  executor_.For(static_cast<int>(parameters->size()), kEntryGrain, [&](int begin, int end) {
    const double** const result = parameters->data();
    for (int k = begin; k < end; ++k) {
      if (k - num_slots >= begin && ids[k] == ids[k - num_slots]) {  // as that of the factor before, as many are
        result[k] = result[k - num_slots];
      } else if (ids[k] >= 0) {  // not a free place
        result[k] = graph_->ValuesIn(state.data(), ids[k]);
      }
    }
  });
}

void Evaluator::BuildMaps() {
  maps_.resize(graph_->num_variables());
  for (VariableId id = 0; id < graph_->num_variables(); ++id) {
    TangentMap& map = maps_[id];
    map.ambient_size = graph_->AmbientSize(id);
    map.tangent_size = graph_->TangentSize(id);
    map.kind = layout_.position[id] < 0 ? TangentMap::Kind::kConstant : TangentMap::Kind::kIdentity;
  }
  std::int64_t num_entries = 0;
  std::int64_t num_columns = 0;
  for (std::size_t i = 0; i < layout_.variables.size(); ++i) {
    const VariableId id = layout_.variables[i];
    if (graph_->manifold(id) != nullptr) {
      curved_.push_back(static_cast<int>(i));
      plus_jacobian_offset_.push_back(num_entries);
      selection_offset_.push_back(num_columns);
      num_entries += static_cast<std::int64_t>(graph_->AmbientSize(id)) * graph_->TangentSize(id);
      num_columns += graph_->TangentSize(id);
    }
  }
  plus_jacobians_.resize(num_entries);
  candidate_plus_jacobians_.resize(num_entries);
  selections_.resize(num_columns);
}

void Evaluator::BuildBounds() {
  for (std::size_t i = 0; graph_->HasBounds() && i < layout_.variables.size(); ++i) {
    if (const VariableBounds* bounds = graph_->bounds(layout_.variables[i])) {
      bounds_.resize(layout_.variables.size());
      bounds_[i] = bounds;
    }
  }
}

Status Evaluator::ComputePlusJacobians(const std::vector<double>& state, std::vector<double>* values) {
  for (std::size_t k = 0; k < curved_.size(); ++k) {
    const VariableId id = layout_.variables[curved_[k]];
    double* out = values->data() + plus_jacobian_offset_[k];
    const double* pinned = graph_->HasPins() ? graph_->PinnedValues(id) : nullptr;
    const double* x = pinned != nullptr ? pinned : graph_->ValuesIn(state.data(), id);
    const int count = graph_->AmbientSize(id) * graph_->TangentSize(id);
    if (const char* fault = EvaluatePlusJacobian(*graph_->manifold(id), x, count, out)) {
      return Status::Error(StatusCode::kEvaluationFailed,
                           "PlusJacobian of the manifold of variable " + std::to_string(id) + " " + fault);
    }
  }
  return Status::Ok();
}

void Evaluator::ClassifyMaps() {
  for (std::size_t k = 0; k < curved_.size(); ++k) {
    TangentMap& map = maps_[layout_.variables[curved_[k]]];
    map.plus_jacobian = plus_jacobians_.data() + plus_jacobian_offset_[k];
    ClassifyTangentMap(&map, selections_.data() + selection_offset_[k]);
  }
}

bool Evaluator::MoveCandidate(const double* delta) {
  for (std::size_t i = 0; i < layout_.variables.size(); ++i) {
    const VariableId id = layout_.variables[i];
    const std::int64_t offset = graph_->StateOffset(id);
    const double* x = current_.data() + offset;
    double* moved = candidate_.data() + offset;
    const double* step = delta + layout_.packed_offset[i];
    if (const Manifold* manifold = graph_->manifold(id)) {
      if (!manifold->Plus(x, step, moved)) {
        return false;
      }
    } else {
      for (int k = 0; k < graph_->AmbientSize(id); ++k) {
        moved[k] = x[k] + step[k];
      }
    }
    if (IsConstrained() && bounds_[i] != nullptr) {
      Clamp(*bounds_[i], moved);
    }
  }
  return true;
}

// Parameters that are not of the state, constants in the user's memory, stay where they are. Whole rows keep both points'.
void Evaluator::PointTo(bool candidate, Chunk* chunk) {
  if (storage_ == JacobianStorage::kWholeRows || chunk->at_candidate == candidate) {
    return;
  }
  chunk->at_candidate = candidate;
  FamilyCache& cache = families_[chunk->family];
  const double* const from = candidate ? current_.data() : candidate_.data();
  const double* const to = candidate ? candidate_.data() : current_.data();
  const auto address = [](const double* p) { return reinterpret_cast<std::uintptr_t>(p); };
  const std::uintptr_t size = current_.size() * sizeof(double);
  const std::ptrdiff_t num_slots = cache.family->num_slots();
  for (std::ptrdiff_t k = chunk->begin * num_slots; k < chunk->end * num_slots; ++k) {
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

// Jacobians at the pinned values, then residuals where the variables are.
EvaluationFailure Evaluator::EvaluatePinned(const Chunk& chunk, FactorBatch batch) {
  FamilyCache& cache = families_[chunk.family];
  const int num_slots = cache.family->num_slots();
  const auto first = static_cast<std::ptrdiff_t>(chunk.begin) * num_slots;
  const auto last = static_cast<std::ptrdiff_t>(chunk.end) * num_slots;
  for (std::ptrdiff_t k = first; k < last; ++k) {
    cache.jacobian_parameters[k] = cache.pins[k] != nullptr ? cache.pins[k] : cache.parameters[k];
  }
  batch.parameters = cache.jacobian_parameters.data();
  const EvaluationFailure failure = cache.family->Evaluate(batch);
  const auto is_pinned = [&](int i) {
    const auto pins = cache.pins.begin() + static_cast<std::ptrdiff_t>(i) * num_slots;
    return std::any_of(pins, pins + num_slots, [](const double* pin) { return pin != nullptr; });
  };
  return failure.failed() ? failure : EvaluateMoved(*cache.family, batch, cache.parameters.data(), is_pinned);
}

EvaluationFailure Evaluator::EvaluateChunk(bool jacobians, Chunk* chunk) {
  PointTo(!jacobians, chunk);
  FamilyCache& cache = families_[chunk->family];
  FactorBatch batch;
  batch.begin = chunk->begin;
  batch.end = chunk->end;
  batch.parameters =
      jacobians || cache.candidate_parameters.empty() ? cache.parameters.data() : cache.candidate_parameters.data();
  batch.residuals = jacobians ? cache.residuals.data() : cache.candidate_residuals.data();
  if (jacobians) {
    batch.tangent_maps = cache.tangent_maps.data();
    batch.jacobians = cache.views.data();
    if (leaves_out_zero_blocks_) {
      const std::ptrdiff_t num_slots = cache.family->num_slots();
      PlaceInTangent(&cache, chunk->begin * num_slots, chunk->end * num_slots);
    }
  }
  const EvaluationFailure failure =
      jacobians && !cache.pins.empty() ? EvaluatePinned(*chunk, batch) : cache.family->Evaluate(batch);
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
double Evaluator::SumCosts(bool jacobians, FamilyCache* family_cache, int begin, int end) {
  FamilyCache& cache = *family_cache;
  double* residuals = jacobians ? cache.residuals.data() : cache.candidate_residuals.data();
  const int rows = cache.family->residual_size();
  if (!cache.has_losses) {
    return PlainCost(residuals + static_cast<std::ptrdiff_t>(begin) * rows, static_cast<std::ptrdiff_t>(end - begin) * rows);
  }
  const auto num_slots = static_cast<int>(cache.slots.size());
  const std::ptrdiff_t offset_stride = cache.storage == JacobianStorage::kBySlot ? num_slots : 0;
  double cost = 0.0;
  for (int i = begin; i < end; ++i) {
    double* f = residuals + static_cast<std::ptrdiff_t>(i) * rows;
    const Loss* loss = graph_->loss(cache.id, i);
    cost += loss != nullptr && jacobians
                ? RobustifyFactor(*loss, rows, num_slots, cache.slots.data(), i, cache.tangent_offsets.data() + i * offset_stride,
                                  reduces_curvature_, f)
                : RobustCost(loss, f, rows);
  }
  return cost;
}

// What lies behind a chunk that failed is left out, as Ceres calls nothing more after a failure: the first one is the one told
// of.
Status Evaluator::EvaluateAll(bool jacobians, double* cost) {
  LowestIndex first_failed(static_cast<int>(chunks_.size()));
  executor_.For(static_cast<int>(chunks_.size()), 1, [&](int begin, int end) {
    for (int k = begin; k < end; ++k) {
      EvaluationFailure& failure = chunk_failures_[static_cast<std::size_t>(k)];
      failure = EvaluationFailure();
      if (k < first_failed.get()) {
        failure = EvaluateChunk(jacobians, &chunks_[static_cast<std::size_t>(k)]);
      }
      if (failure.failed()) {
        first_failed.Note(k);
      }
    }
  });
  *cost = 0.0;
  for (std::size_t k = 0; k < chunks_.size(); ++k) {
    const EvaluationFailure& failure = chunk_failures_[k];
    if (failure.failed()) {
      const FamilyCache& cache = families_[chunks_[k].family];
      const auto& parameters = jacobians || cache.candidate_parameters.empty() ? cache.parameters : cache.candidate_parameters;
      const auto first = static_cast<std::ptrdiff_t>(failure.factor) * cache.family->num_slots();
      return Status::Error(StatusCode::kEvaluationFailed, graph_->DescribeFailure(cache.id, failure, parameters.data() + first));
    }
  }
  for (const double sum : sums_) {
    *cost += sum;
  }
  return Status::Ok();
}

Status Evaluator::EvaluateCandidateCost(double* cost) {
  const Status status = ComputePlusJacobians(candidate_, &candidate_plus_jacobians_);
  return status.ok() ? EvaluateAll(/*jacobians=*/false, cost) : status;
}

void Evaluator::AcceptCandidate() {
  current_.swap(candidate_);
  plus_jacobians_.swap(candidate_plus_jacobians_);
  for (Chunk& chunk : chunks_) {
    chunk.at_candidate = !chunk.at_candidate;
  }
  if (storage_ == JacobianStorage::kWholeRows) {
    for (FamilyCache& cache : families_) {
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
  for (const FamilyCache& cache : families_) {
    const std::ptrdiff_t num_slots = cache.family->num_slots();
    for (int i = 0; cache.family->Recenters() && i < cache.num_factors; ++i) {
      const bool there = graph_->NumFreePlaces(cache.id) == 0 || graph_->HasFactor(cache.id, i);
      num_changed += there && cache.family->Recenter(i, cache.parameters.data() + i * num_slots) ? 1 : 0;
    }
  }
  return num_changed;
}

void Evaluator::SetCurrent(const std::vector<double>& state) {
  std::copy(state.begin(), state.end(), current_.begin());  // in place: the families point into it
}

Status Evaluator::EvaluateJacobians(bool known_point, double* cost) {
  if (!known_point) {
    Status status = ComputePlusJacobians(current_, &plus_jacobians_);
    if (!status.ok()) {
      return status;
    }
  }
  ClassifyMaps();
  return EvaluateAll(/*jacobians=*/true, cost);
}

std::int64_t Evaluator::Bytes() const {
  std::int64_t bytes = 0;
  for (const FamilyCache& cache : families_) {
    bytes += static_cast<std::int64_t>(sizeof(double) * (cache.residuals.size() * 2 + cache.jacobian_values.size()));
    bytes += static_cast<std::int64_t>(cache.parameters.size() * (2 * sizeof(void*) + sizeof(std::int32_t)));
    bytes += static_cast<std::int64_t>(cache.candidate_parameters.size() * sizeof(void*));
  }
  return bytes + static_cast<std::int64_t>(sizeof(double) * (current_.size() * 2 + plus_jacobians_.size() * 2));
}

}  // namespace inceres::internal
