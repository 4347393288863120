#pragma once

#include <algorithm>
#include <cstdint>
#include <memory>
#include <vector>

#include "inceres/problem/factor_graph.h"
#include "linearize/tangent.h"

namespace inceres::internal {

/// The variables of a living graph: two values each, current and candidate, which are equal between
/// iterations; the tangent map; and the place of the step in one padded vector. Addresses never
/// move: pointer tables to them stay right while variables come and go. Borrowed constants stand
/// where their owner keeps them.
class VariableStore {
 public:
  /// Takes over a variable with its values in the graph; it takes no part in the system yet. The id
  /// of a removed one is used again for one of equal ambient size, and so is its room.
  void Add(const FactorGraph& graph, VariableId id);
  /// It takes part from now on, at a place in the padded vector.
  void Enter(const FactorGraph& graph, VariableId id);
  /// Gives that place back.
  void Remove(VariableId id);

  double* current(VariableId id) { return At(id).current; }
  const double* current(VariableId id) const { return At(id).current; }
  double* candidate(VariableId id) { return At(id).candidate; }
  void Set(VariableId id, const double* values);
  void Accept(VariableId id) {
    Variable& variable = At(id);
    std::copy_n(variable.candidate, variable.tangent.map().ambient_size, variable.current);
    variable.tangent.MarkMoved();
  }
  void Reject(VariableId id) {
    const Variable& variable = At(id);
    std::copy_n(variable.current, variable.tangent.map().ambient_size, variable.candidate);
  }

  const TangentMap& map(VariableId id) const { return At(id).tangent.map(); }
  /// The point its map belongs to is another: the variable's pin has moved.
  void MarkMoved(VariableId id) { At(id).tangent.MarkMoved(); }
  /// Brings the map up to date. False if the manifold's PlusJacobian fails.
  bool RefreshMap(const FactorGraph& graph, VariableId id) {
    Variable& variable = At(id);
    return variable.tangent.Refresh(graph, id, variable.current) == nullptr;
  }

  /// Quads into the padded step; -1 for a variable outside the system.
  std::int32_t quad(VariableId id) const { return At(id).quad; }
  std::int32_t num_quads() const { return num_quads_; }

 private:
  struct Variable {
    double* room = nullptr;  // null: it never had values of its own
    double* current = nullptr;
    double* candidate = nullptr;
    std::int32_t quad = -1;
    Tangent tangent;
  };

  // Variables in chunks of a power of two: they are looked up in the innermost loops, and do not
  // move.
  static constexpr int kVariablesShift = 6;
  static constexpr std::int32_t kVariablesPerChunk = 1 << kVariablesShift;
  Variable& At(VariableId id) {
    return variables_[id >> kVariablesShift][id & (kVariablesPerChunk - 1)];
  }
  const Variable& At(VariableId id) const {
    return variables_[id >> kVariablesShift][id & (kVariablesPerChunk - 1)];
  }
  double* Allocate(int size);

  std::vector<std::unique_ptr<Variable[]>> variables_;
  std::vector<std::unique_ptr<double[]>> chunks_;
  int used_ = 0;
  int capacity_ = 0;                                   // of the last chunk
  std::vector<std::vector<std::int32_t>> free_quads_;  // by the number of quads
  std::int32_t num_quads_ = 0;
};

}  // namespace inceres::internal
