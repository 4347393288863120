#include "linearize/variable_look_up.h"

#include <algorithm>

#include "base/address.h"

namespace inceres::internal {

// Parameters and tangent maps by variable (docs/large.md, "Memory"). A table of them by slot takes
// 32 bytes of an observation; to look them up takes a few instructions beside the hundreds of its
// evaluation.
//
// The pointers of a few factors at a time are collected on the stack, in the form in which a
// family's Evaluate expects them, with the address that factor 0 would have: families, and the
// failures that they report, know factors by their own numbers and nothing of this. Tables per
// variable are small next to those per slot, as each variable has many factors, and are shared by
// all families.
//
// What is looked up stays true as long as the solve: PointPair's states never move, and points that
// trade places have their values swapped, not their addresses.

namespace {

constexpr int kMostEntries = 1024;  // at a time: so many pointers are on the stack
constexpr int kMostSlots = 16;
static_assert(kMostSlots <= kMostEntries);

}  // namespace

// Of a variable that was removed there is nothing to point to, and no factor names it.
void VariableLookUp::Bind(const FactorGraph& graph, const PointPair& points) {
  values_.resize(graph.num_variables());
  for (VariableId id = 0; id < graph.num_variables(); ++id) {
    values_[id] = graph.HasVariable(id) ? graph.ValuesIn(points.pointed().data(), id) : nullptr;
  }
  maps_ = points.tangent_maps();
}

// Small families take little. Families whose factors are evaluated otherwise than in passes over
// chunks keep their tables: those with strips or whole rows, or that prepare for a list of factors,
// move expansion points, have pins or keep evaluations. Memory is given back here by swapping with
// empty columns, since clearing would keep it.
void VariableLookUp::Serve(Linearization* family) const {
  const FactorFamily& factors = *family->family;
  if (!Linearization::MayHaveStrips(family->num_factors) || family->has_strips() ||
      family->has_whole_rows() || family->residual_size > kMostRows ||
      family->num_slots > kMostSlots || factors.Prepares() || factors.Recenters() ||
      !family->pins.empty() || family->BytesKept() > 0) {
    return;
  }
  family->look_up = this;
  UnwrittenVector<const double*>().swap(family->parameters);
  UnwrittenVector<const TangentMap*>().swap(family->tangent_maps);
  family->candidate_residuals = ZeroedArray();
}

// Threads: any number, for the tables are only read and what is collected is on the stack of each.
// Factors are evaluated in ascending order, and the first failure ends it, as in one call for all
// of them. Without Jacobians no maps are collected, and the family is told of none.
EvaluationFailure VariableLookUp::Evaluate(const Linearization& family, FactorBatch batch) const {
  const double* values[kMostEntries];
  const TangentMap* maps[kMostEntries];
  const bool jacobians = batch.jacobians != nullptr;
  const int end = batch.end;
  for (int first = batch.begin; first < end; first = batch.end) {
    batch.begin = first;
    batch.end = std::min(first + kMostEntries / family.num_slots, end);
    const VariableId* const ids = family.graph->Variables(family.id, first);
    const int count = (batch.end - first) * family.num_slots;
    for (int k = 0; k < count; ++k) {
      values[k] = values_[ids[k]];
    }
    for (int k = 0; jacobians && k < count; ++k) {
      maps[k] = maps_[ids[k]];
    }
    batch.parameters = AddressBefore(family.Entry(first), values);
    batch.tangent_maps = jacobians ? AddressBefore(family.Entry(first), maps) : nullptr;
    const EvaluationFailure failure = family.family->Evaluate(batch);
    if (failure.failed()) {
      return failure;
    }
  }
  return {};
}

EvaluationFailure EvaluateBatch(const Linearization& family, const FactorBatch& batch) {
  return family.look_up != nullptr ? family.look_up->Evaluate(family, batch)
                                   : family.family->Evaluate(batch);
}

// For messages: what a factor was given when it failed. Where values are looked up there is one
// place for both points, which has those of the one that was evaluated last.
std::vector<const double*> ParametersOf(const Linearization& family, int factor, bool candidate) {
  std::vector<const double*> result;
  result.reserve(static_cast<std::size_t>(family.num_slots));
  for (int s = 0; s < family.num_slots; ++s) {
    result.push_back(family.look_up != nullptr
                         ? family.look_up->Values(family.graph->Variables(family.id, factor)[s])
                     : candidate ? family.CandidateParameters(factor)[s]
                                 : family.LinearizedParameters(factor)[s]);
  }
  return result;
}

// Of parameters and maps there is a pointer each, hence twice the former; what was given back
// counts no more.
std::int64_t BytesOf(const Linearization& family) {
  // Whole rows have one tangent offset.
  const std::size_t num_offsets = std::max(family.parameters.size(), family.tangent_offsets.size());
  const std::size_t doubles = family.residuals.size() + family.candidate_residuals.size() +
                              family.jacobian_values.size() + family.strip_values.size();
  const std::size_t offsets = num_offsets + family.records.size() + family.record_offsets.size() +
                              family.zero_blocks.all_offsets.size();
  const std::size_t pointers = 2 * family.parameters.size() + family.candidate_parameters.size();
  return static_cast<std::int64_t>(doubles * sizeof(double) + offsets * sizeof(std::int32_t) +
                                   pointers * sizeof(void*) +
                                   family.loss_values.size() * sizeof(LossValue)) +
         static_cast<std::int64_t>(family.zero_blocks.all_offsets.size()) +  // and a byte for each
         family.BytesKept();
}

}  // namespace inceres::internal
