#pragma once

#include <utility>
#include <vector>

#include "inceres/problem/factor_family.h"

namespace inceres {

// A family whose factors are only connected, never evaluated: what the tests of the graph itself
// need.
class BlankFamily final : public FactorFamily {
 public:
  struct Measurement {};

  BlankFamily(int residual_size, std::vector<Slot> slots, int size = 0)
      : FactorFamily(residual_size, std::move(slots)), size_(size) {}
  void Add(const Measurement&) { ++size_; }
  void Place(int index, const Measurement&) { size_ += index == size_ ? 1 : 0; }
  int size() const override { return size_; }
  const char* Name() const override { return "blank"; }
  EvaluationFailure Evaluate(const FactorBatch& batch) const override {
    return {batch.begin, "blank factors have no residual"};
  }

 private:
  int size_;
};

}  // namespace inceres
