#pragma once

#include <cstddef>
#include <memory>
#include <utility>
#include <vector>

#include <ceres/cost_function.h>

#include "inceres/problem/ambient_family.h"

namespace inceres {

/// Cost functions written for Ceres, AutoDiff ones most often, as factors of a FactorGraph or an
/// IncrementalSolver of the core, next to the built-in families. One family holds cost functions of
/// one shape: `residual_size` residuals over blocks of the ambient sizes of `slots`, whose tangent
/// sizes are those of the variables. They are called with Ceres's conventions; their ambient
/// Jacobians are projected by the variables' manifolds, which are the core's (problem/manifolds.h).
///
/// A cost function of another shape is a mistake that nobody notices before it writes beyond its
/// room. One that returns false, or writes what is not finite, is an evaluation that fails, named
/// with its factor.
///
/// Cost: one virtual call a factor, nothing allocated up to 512 Jacobian entries. Threads: cost
/// functions are called concurrently if the solver runs with several threads, as in Ceres; Add and
/// Place are for one writer.
class CeresCostFamily : public AmbientFamily<CeresCostFamily> {
 public:
  /// What Add and Place take.
  using Measurement = std::shared_ptr<const ceres::CostFunction>;

  /// For cost functions of this shape: see above.
  CeresCostFamily(int residual_size, std::vector<Slot> slots)
      : AmbientFamily<CeresCostFamily>(residual_size, std::move(slots)) {}

  /// A cost function that whoever owns it keeps for as long as the family has it. Nothing is
  /// counted.
  static Measurement Borrowed(const ceres::CostFunction* cost) {
    return Measurement(Measurement(), cost);
  }

  /// Memory for so many factors.
  void Reserve(std::size_t num_factors) { costs_.reserve(num_factors); }
  /// Appends a cost function of the family's shape.
  void Add(Measurement cost) { costs_.push_back(std::move(cost)); }
  /// Puts the cost function at an index: one in use or the next one.
  void Place(int index, const Measurement& cost) { PlaceIn(&costs_, index, cost); }
  /// The cost function at an index.
  const Measurement& at(int index) const { return costs_[static_cast<std::size_t>(index)]; }

  int size() const override { return static_cast<int>(costs_.size()); }
  const char* Name() const override { return "ceres::CostFunction"; }
  std::string Describe(int i) const override {
    return internal::DescribeObject("cost function", at(i).get());
  }

  /// Asks for the cost function's memory; for AmbientFamily.
  void Prefetch(int i) const { __builtin_prefetch(at(i).get()); }
  /// Calls the cost function; for AmbientFamily.
  bool EvaluateOne(int i, const double* const* parameters, double* residuals,
                   double** jacobians) const {
    return at(i)->Evaluate(parameters, residuals, jacobians);
  }

 private:
  std::vector<Measurement> costs_;
};

}  // namespace inceres
