#pragma once

#include <algorithm>
#include <memory>
#include <vector>

#include "inceres/problem/factor_graph.h"

namespace inceres::internal {

/// Two values of every variable of a living graph, current and candidate, at addresses that never move: pointer tables into them
/// stay right while variables come and go. Between iterations the two are equal. Borrowed constants stand where their owner keeps
/// them.
class IncrementalValues {
 public:
  int num_variables() const { return static_cast<int>(current_.size()); }
  double* current(VariableId id) { return current_[id]; }
  const double* current(VariableId id) const { return current_[id]; }
  double* candidate(VariableId id) { return candidate_[id]; }

  /// Takes over a variable with its values in the graph. The id of a removed one is used again for one of equal ambient size, and
  /// so is its room.
  void Add(const FactorGraph& graph, VariableId id) {
    const int size = graph.AmbientSize(id);
    if (id >= num_variables()) {
      current_.resize(id + 1, nullptr);
      candidate_.resize(id + 1, nullptr);
      rooms_.resize(id + 1, nullptr);
      sizes_.resize(id + 1, 0);
    }
    sizes_[id] = size;
    if (graph.StateOffset(id) < 0) {
      current_[id] = candidate_[id] = const_cast<double*>(graph.Values(id));  // never written: its tangent size is 0
      return;
    }
    if (rooms_[id] == nullptr) {
      rooms_[id] = Allocate(2 * size);
    }
    current_[id] = rooms_[id];
    candidate_[id] = rooms_[id] + size;
    Set(id, graph.Values(id));
  }

  void Set(VariableId id, const double* values) {
    std::copy_n(values, sizes_[id], current_[id]);
    std::copy_n(values, sizes_[id], candidate_[id]);
  }
  void Accept(VariableId id) { std::copy_n(candidate_[id], sizes_[id], current_[id]); }
  void Reject(VariableId id) { std::copy_n(current_[id], sizes_[id], candidate_[id]); }

 private:
  static constexpr int kChunk = 8192;

  double* Allocate(int size) {
    if (chunks_.empty() || used_ + size > capacity_) {
      capacity_ = std::max(kChunk, size);
      chunks_.push_back(std::make_unique<double[]>(capacity_));
      used_ = 0;
    }
    double* values = chunks_.back().get() + used_;
    used_ += size;
    return values;
  }

  std::vector<std::unique_ptr<double[]>> chunks_;
  int used_ = 0;
  int capacity_ = 0;
  std::vector<int> sizes_;
  std::vector<double*> rooms_;  // per variable; null: it never had values of its own
  std::vector<double*> current_;
  std::vector<double*> candidate_;
};

}  // namespace inceres::internal
