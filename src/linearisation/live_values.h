#pragma once

#include <algorithm>
#include <memory>
#include <vector>

#include "inceres/graph/factor_graph.h"

namespace inceres::internal {

/// Two values of every variable of a growing graph, current and candidate, at addresses that never move: pointer tables into them
/// stay right while variables are added. Between iterations the two are equal.
class LiveValues {
 public:
  int num_variables() const { return static_cast<int>(current_.size()); }
  double* current(VariableId id) { return current_[id]; }
  const double* current(VariableId id) const { return current_[id]; }
  double* candidate(VariableId id) { return candidate_[id]; }

  /// Takes over the variables the graph has gained, with their values there.
  void Grow(const FactorGraph& graph) {
    for (VariableId id = num_variables(); id < graph.num_variables(); ++id) {
      const int size = graph.AmbientSize(id);
      sizes_.push_back(size);
      for (std::vector<double*>* values : {&current_, &candidate_}) {
        values->push_back(Allocate(size));
        std::copy_n(graph.Values(id), size, values->back());
      }
    }
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
  std::vector<double*> current_;
  std::vector<double*> candidate_;
};

}  // namespace inceres::internal
