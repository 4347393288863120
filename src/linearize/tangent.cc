#include "linearize/tangent.h"

#include <algorithm>
#include <functional>

#include "inceres/problem/ambient_family.h"

// M = ∂(x ⊞ δ)/∂δ at δ = 0, and what kind it is (docs/algorithms.md, "Linearization"). An identity
// or a selection of columns makes J M a copy; only a dense M needs a product. The kind is found
// from the numbers at each point, by exact comparison with 0 and 1, so that user manifolds need
// not declare it and a map that is special at one point only is treated right at the next.

namespace inceres::internal {
namespace {

// Exact comparison: one that is nearly the identity is a dense map.
bool IsIdentity(const TangentMap& map) {
  if (map.ambient_size != map.tangent_size) {
    return false;
  }
  for (int r = 0; r < map.ambient_size; ++r) {
    for (int c = 0; c < map.tangent_size; ++c) {
      if (map.plus_jacobian[r * map.tangent_size + c] != (r == c ? 1.0 : 0.0)) {
        return false;
      }
    }
  }
  return true;
}

// Finds for each column its single unit entry; false if there is a column without that form, of
// which and those after it nothing is known.
bool FindSelection(const TangentMap& map, int* selection) {
  std::fill_n(selection, map.tangent_size, -1);
  for (int c = 0; c < map.tangent_size; ++c) {
    for (int r = 0; r < map.ambient_size; ++r) {
      const double entry = map.plus_jacobian[r * map.tangent_size + c];
      if (entry == 0.0) {
        // A zero is no entry; a second nonzero one, or one that is not 1, makes the column no
        // selection.
        continue;
      }
      if (entry != 1.0 || selection[c] >= 0) {
        selection[c] = -1;
        return false;
      }
      selection[c] = r;
    }
    if (selection[c] < 0) {
      return false;
    }
  }
  return true;
}

// Row k of M is that of the identity, whose entry there is known.
// Together with a unit column k: the product then copies column k and leaves it out of all others.
bool IsUnitRow(const TangentMap& map, int k) {
  const double* row = map.plus_jacobian + k * map.tangent_size;
  for (int c = 0; c < map.tangent_size; ++c) {
    if (c != k && row[c] != 0.0) {
      return false;
    }
  }
  return true;
}

// Of the columns whose unit entry is known.
// Whether a column is a unit vector is known from FindSelection, its row is looked at here.
int CountIdentityColumns(const TangentMap& map, const int* selection) {
  int count = 0;
  while (count < map.tangent_size && selection[count] == count && IsUnitRow(map, count)) {
    ++count;
  }
  return count;
}

// Returns null, or what is wrong with M.
// Ceres's test of outputs: filled with a value nobody computes, then checked for it and for NaN.
const char* EvaluatePlusJacobian(const FactorGraph& graph, VariableId id, const double* x,
                                 std::vector<double>* M) {
  // First-estimate Jacobians: the map belongs to the pinned values as well.
  const double* pinned = graph.HasPins() ? graph.PinnedValues(id) : nullptr;
  const int count = static_cast<int>(M->size());
  MarkUnwritten(M->data(), count);
  if (!graph.manifold(id)->PlusJacobian(pinned != nullptr ? pinned : x, M->data())) {
    return "returned false";
  }
  return AreWritten(M->data(), count) ? nullptr
                                      : "has an entry that is not finite or was not written";
}

}  // namespace

// From the cheapest kind to the dearest: J M is a copy, a copy of columns, a product.
void ClassifyTangentMap(TangentMap* map, int* selection) {
  if (IsIdentity(*map)) {
    map->kind = TangentMap::Kind::kIdentity;
  } else if (FindSelection(*map, selection)) {
    map->kind = TangentMap::Kind::kSelection;
    map->selection = selection;
    // Leading columns that stay where they are, as those of a product with a Euclidean first part.
    map->num_identity_columns = 0;
    while (map->num_identity_columns < map->tangent_size &&
           selection[map->num_identity_columns] == map->num_identity_columns) {
      ++map->num_identity_columns;
    }
  } else {
    map->kind = TangentMap::Kind::kDense;
    map->num_identity_columns = CountIdentityColumns(*map, selection);
  }
}

// Without a manifold a plain sum.
bool MoveVariable(const FactorGraph& graph, VariableId id, const double* x, const double* delta,
                  double* moved) {
  if (const Manifold* manifold = graph.manifold(id)) {
    return manifold->Plus(x, delta, moved);
  }
  std::transform(x, x + graph.AmbientSize(id), delta, moved, std::plus<>());
  return true;
}

void Tangent::Set(const FactorGraph& graph, VariableId id, bool wanted) {
  map_ = TangentMap();
  map_.ambient_size = graph.AmbientSize(id);
  map_.tangent_size = graph.TangentSize(id);
  // Until it is computed, and always of a variable without a manifold.
  map_.kind = wanted ? TangentMap::Kind::kIdentity : TangentMap::Kind::kConstant;
  const bool curved = wanted && graph.manifold(id) != nullptr;
  if (curved && curved_ == nullptr) {
    curved_ = std::make_unique<Curved>();
  }
  if (curved_ != nullptr) {
    // A variable whose manifold is gone keeps the struct, with no size: is_curved() asks for M.
    curved_->M.resize(curved ? map_.ambient_size * map_.tangent_size : 0);
    curved_->selection.resize(curved ? map_.tangent_size : 0);
    curved_->stale = true;
    curved_->has_candidate = false;
  }
}

const char* Tangent::Compute(const FactorGraph& graph, VariableId id, const double* x) {
  if (const char* fault = EvaluatePlusJacobian(graph, id, x, &curved_->M)) {
    return fault;
  }
  map_.plus_jacobian = curved_->M.data();
  ClassifyTangentMap(&map_, curved_->selection.data());
  curved_->stale = false;
  return nullptr;
}

// Into a second matrix: the map of the current point is still in use until the step is accepted.
const char* Tangent::ComputeCandidate(const FactorGraph& graph, VariableId id, const double* x) {
  curved_->candidate_M.resize(curved_->M.size());
  const char* fault = EvaluatePlusJacobian(graph, id, x, &curved_->candidate_M);
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
  curved_->M.swap(curved_->candidate_M);
  const bool same = map_.plus_jacobian != nullptr && curved_->M == curved_->candidate_M;
  map_.plus_jacobian = curved_->M.data();
  if (!same) {
    ClassifyTangentMap(&map_, curved_->selection.data());
  }
}

}  // namespace inceres::internal
