#include "linearize/tangent.h"

#include <algorithm>
#include <functional>
#include <new>
#include <utility>

#include "inceres/problem/ambient_family.h"
#include "problem/tangent_kind.h"

// M = ∂(x ⊞ δ)/∂δ at δ = 0, and what kind it is (docs/algorithms.md, "Linearization"), which is
// found at each point (problem/tangent_kind.h): a map that is special at one point only is treated
// right at the next.

namespace inceres::internal {
namespace {

// Returns null, or what is wrong with M.
// Ceres's test of outputs: filled with a value nobody computes, then checked for it and for NaN.
const char* EvaluatePlusJacobian(const FactorGraph& graph, VariableId id, const double* x,
                                 int count, double* M) {
  // First-estimate Jacobians: the map belongs to the pinned values as well.
  const double* pinned = graph.HasPins() ? graph.PinnedValues(id) : nullptr;
  MarkUnwritten(M, count);
  if (!graph.manifold(id)->PlusJacobian(pinned != nullptr ? pinned : x, M)) {
    return "returned false";
  }
  return AreWritten(M, count) ? nullptr : "has an entry that is not finite or was not written";
}

}  // namespace

// Without a manifold a plain sum.
bool MoveVariable(const FactorGraph& graph, VariableId id, const double* x, const double* delta,
                  double* moved) {
  if (const Manifold* manifold = graph.manifold(id)) {
    return manifold->Plus(x, delta, moved);
  }
  std::transform(x, x + graph.AmbientSize(id), delta, moved, std::plus<>());
  return true;
}

void ClampToBounds(const VariableBounds& bounds, double* x) {
  for (std::size_t k = 0; k < bounds.lower.size(); ++k) {
    x[k] = std::clamp(x[k], bounds.lower[k], bounds.upper[k]);
  }
}

// Two matrices, aligned as those of their own allocations would be, and a selection.
std::unique_ptr<Tangent::Curved, Tangent::Free> Tangent::MakeCurved(int size) {
  const auto count = (static_cast<std::size_t>(size) + 1) / 2 * 2;
  void* const memory = ::operator new(sizeof(Curved) + count * (2 * sizeof(double) + sizeof(int)));
  auto* const curved = new (memory) Curved();
  auto* const doubles = reinterpret_cast<double*>(curved + 1);
  curved->M = new (doubles) double[count];
  curved->candidate_M = new (doubles + count) double[count];
  curved->selection = new (doubles + 2 * count) int[count];
  curved->capacity = size;
  return std::unique_ptr<Curved, Free>(curved);
}

void Tangent::Set(const FactorGraph& graph, VariableId id, bool wanted) {
  map_ = TangentMap();
  map_.ambient_size = graph.AmbientSize(id);
  map_.tangent_size = graph.TangentSize(id);
  // Until it is computed, and always of a variable without a manifold.
  map_.kind = wanted ? TangentMap::Kind::kIdentity : TangentMap::Kind::kConstant;
  const bool curved = wanted && graph.manifold(id) != nullptr;
  // Fits an int, or FactorGraph::Validate has refused the variable.
  const int size = curved ? map_.ambient_size * map_.tangent_size : 0;
  if (curved && (curved_ == nullptr || curved_->capacity < size)) {
    curved_ = MakeCurved(size);
  }
  if (curved_ != nullptr) {
    // A variable whose manifold is gone keeps the struct, with no size.
    curved_->size = size;
    curved_->stale = true;
    curved_->has_candidate = false;
  }
}

const char* Tangent::Compute(const FactorGraph& graph, VariableId id, const double* x) {
  if (const char* fault = EvaluatePlusJacobian(graph, id, x, curved_->size, curved_->M)) {
    return fault;
  }
  map_.plus_jacobian = curved_->M;
  ClassifyTangentMap(&map_, curved_->selection);
  curved_->stale = false;
  return nullptr;
}

// Into a second matrix: the map of the current point is still in use until the step is accepted.
const char* Tangent::ComputeCandidate(const FactorGraph& graph, VariableId id, const double* x) {
  const char* fault = EvaluatePlusJacobian(graph, id, x, curved_->size, curved_->candidate_M);
  curved_->has_candidate = fault == nullptr;
  return fault;
}

// Classified only now: the kind may differ from point to point.
void Tangent::AcceptCandidate() {
  // Told by a flag and not by the matrix, whose memory stays: the one of an older candidate would
  // pass for this one's.
  if (!curved_->has_candidate) {
    return MarkMoved();  // nobody has asked
  }
  curved_->has_candidate = false;
  curved_->stale = false;
  // The older matrix becomes the room of the next candidate. The address of map_ stays; its data
  // moves.
  std::swap(curved_->M, curved_->candidate_M);
  const bool same = map_.plus_jacobian != nullptr &&
                    std::equal(curved_->M, curved_->M + curved_->size, curved_->candidate_M);
  map_.plus_jacobian = curved_->M;
  if (!same) {
    ClassifyTangentMap(&map_, curved_->selection);
  }
}

}  // namespace inceres::internal
