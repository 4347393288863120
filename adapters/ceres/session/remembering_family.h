#pragma once

#include <cstdint>
#include <vector>

#include <ceres/cost_function.h>

#include "inceres/ceres/cost_family.h"

namespace inceres::internal {

/// A family of a user's cost functions, borrowed, with what it takes to recognize them later: of
/// each, parameters and the residual there.
///
/// Recognition compares cost-only calls with each other: a Jacobian call may round differently
/// (AutoDiff divides otherwise than plain doubles do). So Remember, after a solve, evaluates
/// cost-only where the first Jacobian call was, and there where the solve has ended; later solves
/// record what their own cost-only calls say, the last of which is mostly where they end; and
/// Recognize, before the next one, evaluates again. There, and not where Jacobians are from, values
/// are to be had for the next solve as they stand.
///
/// Threads: Evaluate as any family, on disjoint ranges; the rest from one thread. Memory per place:
/// Σ ambient sizes + residuals.
class RememberingFamily final : public CeresCostFamily {
 public:
  /// Without `remembers` nothing is kept, and Recognize is always false.
  RememberingFamily(int num_residuals, std::vector<Slot> slots, bool remembers);

  EvaluationFailure Evaluate(const FactorBatch& batch) const override;

  /// Puts a cost function to a place, in use or the next one; what was known of the place is
  /// forgotten. Null: no cost function is there any more.
  void PlaceBorrowed(int i, const ceres::CostFunction* cost);

  /// What is remembered of the place may be another function's: it is to be linearized anew.
  void Doubt(int i);
  /// Prepares a place that was linearized to be recognized at these values of its parameters.
  void Remember(int i, const double* const* parameters);
  /// Whether `cost` evaluates, cost only, to the remembered residual, bit by bit, and where it now
  /// is, if that is elsewhere, at all. False also if that proves nothing: the residual was zero, it
  /// was another one when Jacobians were asked for, or the place was never linearized.
  bool Recognize(int i, const ceres::CostFunction* cost, const double* const* parameters);

 private:
  enum class Memory : std::uint8_t {
    kNone,        ///< not linearized, or not to be recognized
    kLinearized,  ///< parameters and residual of the last Jacobian call
    kProof,       ///< of a cost-only call
  };

  double* Values(int i) const { return records_.data() + static_cast<std::size_t>(i) * stride_; }
  double* Residual(int i) const { return Values(i) + num_values_; }
  void Record(const FactorBatch& batch, int i) const;
  void CopyValues(const double* const* parameters, double* values) const;
  bool HasValues(int i, const double* const* parameters) const;
  bool EvaluateCostOnly(const ceres::CostFunction& cost, const double* values);
  bool MoveProof(int i, const ceres::CostFunction& cost, const double* const* parameters);
  bool EvaluateCostOnlyAt(const ceres::CostFunction& cost, const double* const* parameters);
  bool SaysNothing(const double* residual) const;
  bool IsFinite() const;
  bool Proves(const double* with_jacobians) const;

  bool remembers_;
  std::size_t num_values_ = 0;
  std::size_t stride_ = 0;
  mutable std::vector<double> records_;  // per place: parameters, residual
  mutable std::vector<Memory> memory_;   // per place
  std::vector<double> residual_;         // of a cost-only call
  std::vector<const double*> pointers_;
};

}  // namespace inceres::internal
