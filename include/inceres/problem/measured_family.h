#pragma once

#include <cstddef>
#include <utility>
#include <vector>

#include "inceres/problem/factor_family.h"

namespace inceres {

/// A family that keeps one M per factor: what the built-in families with a plain measurement have in common. Threads: one writer.
template <typename M>
class MeasuredFamily : public FactorFamily {
 public:
  using Measurement = M;

  void Add(const Measurement& measurement) { measurements_.push_back(measurement); }
  /// Overwrites the measurement at `index`, or appends it if index == size().
  void Place(int index, const Measurement& measurement) { PlaceIn(&measurements_, index, measurement); }
  void Reserve(int num_factors) { measurements_.reserve(static_cast<std::size_t>(num_factors)); }

  int size() const override { return static_cast<int>(measurements_.size()); }

 protected:
  using FactorFamily::FactorFamily;

  const Measurement& measurement(int i) const { return measurements_[static_cast<std::size_t>(i)]; }

 private:
  std::vector<Measurement> measurements_;
};

}  // namespace inceres
