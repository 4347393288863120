#pragma once

#include <cstddef>
#include <string>
#include <vector>

#include "inceres/problem/check_jacobians.h"
#include "problem/ridders.h"

namespace inceres::internal {

/// A variable as a factor sees it.
struct SlotPoint {
  const double* values = nullptr;
  const Manifold* manifold = nullptr;  // null: Euclidean
  bool has_tangent = true;
};

/// Checks factors of one family, one after the other, and writes what it finds into a report.
class FamilyCheck {
 public:
  FamilyCheck(const FactorFamily& family, FamilyId id, const JacobianCheckOptions& options,
              JacobianReport* report)
      : family_(family),
        id_(id),
        options_(options),
        report_(*report),
        num_slots_(static_cast<std::size_t>(family.num_slots())),
        num_rows_(static_cast<std::size_t>(family.residual_size())),
        parameters_(num_slots_),
        map_pointers_(num_slots_),
        residuals_(num_rows_),
        maps_(num_slots_),
        plus_(num_slots_),
        selections_(num_slots_),
        jacobians_(num_slots_),
        views_(num_slots_) {}

  /// False if something failed to evaluate: failure() then says what, and what_failed() where.
  bool Check(int factor, const std::vector<SlotPoint>& point);
  const EvaluationFailure& failure() const { return failure_; }
  const std::string& what_failed() const { return what_failed_; }

 private:
  EvaluationFailure Evaluate(bool jacobians);
  bool WriteAnalytic();
  bool EvaluateAt(std::size_t slot, const std::vector<double>& delta, double* residuals);
  bool CheckColumn(std::size_t slot, std::size_t column);
  void Judge(std::size_t slot, std::size_t column, const NumericDerivative& derivative);
  std::size_t NumColumns(std::size_t slot) const {
    return static_cast<std::size_t>(maps_[slot].tangent_size);
  }

  const FactorFamily& family_;
  const FamilyId id_;
  const JacobianCheckOptions& options_;
  JacobianReport& report_;
  const std::size_t num_slots_;
  const std::size_t num_rows_;
  std::vector<const double*> parameters_;
  std::vector<const TangentMap*> map_pointers_;
  std::vector<double> residuals_;

  std::vector<SlotPoint> point_;
  int factor_ = -1;
  std::vector<TangentMap> maps_;
  std::vector<std::vector<double>> plus_;       // plus-Jacobians, by slot
  std::vector<std::vector<int>> selections_;    // of the maps, by slot
  std::vector<std::vector<double>> jacobians_;  // tangent, row-major, by slot
  std::vector<JacobianView> views_;
  std::vector<double> largest_;  // of each row
  EvaluationFailure failure_;
  std::string what_failed_;
};

}  // namespace inceres::internal
