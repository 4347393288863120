#pragma once

#include <cstdint>
#include <functional>
#include <map>
#include <vector>

#include "base/aligned_vector.h"
#include "inceres/problem/factor_graph.h"
#include "linearize/linearization.h"
#include "linearize/tangent.h"
#include "simd/kernels.h"

namespace inceres::internal {

/// The rows of one factor of a linear system, corrected for its loss: f, and J of each slot (null
/// where none was wanted).
struct LinearizedFactor {
  int rows = 0;
  const double* f = nullptr;
  const SlotJacobians* slots = nullptr;  // the factor counts as number 0
};

/// Linearizes single factors of a graph at given values, for those who need a few of them once:
/// marginalization. As the Evaluator does it: pinned variables where they are pinned, projection to
/// the tangent space, then the correction for the loss.
class FactorLinearizer {
 public:
  using ValuesOf = std::function<const double*(VariableId)>;
  /// Jacobians are those of the variables for which wanted(id) holds, whatever the graph says of
  /// their constancy; they must have a tangent space.
  FactorLinearizer(const FactorGraph& graph, ValuesOf values,
                   std::function<bool(VariableId)> wanted);
  FactorLinearizer(const FactorLinearizer&) = delete;
  FactorLinearizer& operator=(const FactorLinearizer&) = delete;

  /// The result is valid until the next call. Fails as FactorFamily::Evaluate or
  /// Manifold::PlusJacobian do, with their names.
  Status Linearize(FactorId id, LinearizedFactor* result);
  /// The same before its loss.
  Status LinearizePlainly(FactorId id, LinearizedFactor* result);

 private:
  Status MapOf(VariableId id, const TangentMap** map);
  Status Connect(FactorId id, Linearization* factors);

  const FactorGraph& graph_;
  ValuesOf values_;
  std::function<bool(VariableId)> wanted_;
  std::map<VariableId, Tangent> tangents_;  // addresses stay
  TangentMap constant_;
  // without room for Jacobians: of each only the present factor is filled
  std::map<FamilyId, Linearization> families_;
  AlignedVector<double> jacobians_;
  std::vector<SlotJacobians> slots_;
  std::vector<std::int32_t> offsets_;  // per slot: 0, or -1 where no Jacobian is wanted
};

}  // namespace inceres::internal
