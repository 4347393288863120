#include "problem/family_check.h"

#include <algorithm>
#include <cmath>
#include <functional>
#include <limits>

#include "base/address.h"
#include "problem/find_fault.h"
#include "problem/tangent_kind.h"

namespace inceres::internal {

// One factor: its tangent Jacobian as the family writes it, column by column against a numeric
// derivative of the residuals along x ⊞ δ. Ridders' method gives an estimate of its own error, and
// so there are three verdicts: right, wrong, and uncertain, where the numeric derivative is not
// good enough to tell. An entry is compared with the largest of its row, over all slots: a
// derivative that is small beside its neighbors cannot be known to more digits than they allow.

// A batch counts from the family's first factor, and arrays are of this one alone. Without tangent
// maps and views the family evaluates residuals only.
EvaluationFailure FamilyCheck::Evaluate(bool jacobians) {
  const std::ptrdiff_t entry = std::ptrdiff_t{factor_} * family_.num_slots();
  return family_.Evaluate(
      {factor_, factor_ + 1, AddressBefore(entry, parameters_.data()),
       jacobians ? AddressBefore(entry, map_pointers_.data()) : nullptr,
       AddressBefore(std::ptrdiff_t{factor_} * family_.residual_size(), residuals_.data()),
       jacobians ? views_.data() : nullptr});
}

bool FamilyCheck::WriteAnalytic() {
  for (std::size_t s = 0; s < num_slots_; ++s) {
    const FactorFamily::Slot& slot = family_.slot(static_cast<int>(s));
    maps_[s] = TangentMap();
    maps_[s].ambient_size = slot.ambient_size;
    // Columns there are only where the variable can be moved.
    maps_[s].tangent_size = point_[s].has_tangent ? slot.tangent_size : 0;
    maps_[s].kind = NumColumns(s) == 0 ? TangentMap::Kind::kConstant : TangentMap::Kind::kIdentity;
    // Through the plus-Jacobian, if there is a manifold: what is checked is what solvers use.
    if (NumColumns(s) > 0 && point_[s].manifold != nullptr) {
      plus_[s].assign(static_cast<std::size_t>(slot.ambient_size) * NumColumns(s), 0.0);
      if (!point_[s].manifold->PlusJacobian(point_[s].values, plus_[s].data())) {
        what_failed_ = "PlusJacobian of the manifold of slot " + std::to_string(s);
        return false;
      }
      maps_[s].plus_jacobian = plus_[s].data();
      // Of the kind that solvers find, for families go by it.
      selections_[s].resize(NumColumns(s));
      ClassifyTangentMap(&maps_[s], selections_[s].data());
    }
    parameters_[s] = point_[s].values;
    map_pointers_[s] = &maps_[s];
    jacobians_[s].assign(num_rows_ * NumColumns(s), 0.0);
    // A factor stride of 0: the view is of this factor alone.
    views_[s] = {jacobians_[s].data(), 0, maps_[s].tangent_size};
  }
  failure_ = Evaluate(/*jacobians=*/true);
  // The scale of each row, over all slots.
  largest_.assign(num_rows_, 0.0);
  for (std::size_t s = 0; s < num_slots_ && !failure_.failed(); ++s) {
    for (std::size_t k = 0; k < jacobians_[s].size(); ++k) {
      double& largest = largest_[k / NumColumns(s)];
      largest = std::max(largest, std::fabs(jacobians_[s][k]));
    }
  }
  return !failure_.failed();
}

// The residuals with one variable moved.
// By Plus, not by M: the numeric derivative knows nothing of the plus-Jacobian.
bool FamilyCheck::EvaluateAt(std::size_t slot, const std::vector<double>& delta,
                             double* residuals) {
  const int size = family_.slot(static_cast<int>(slot)).ambient_size;
  std::vector<double> moved(point_[slot].values, point_[slot].values + size);
  if (point_[slot].manifold != nullptr) {
    if (!point_[slot].manifold->Plus(point_[slot].values, delta.data(), moved.data())) {
      return false;
    }
  } else {
    std::transform(moved.begin(), moved.end(), delta.begin(), moved.begin(), std::plus<>());
  }
  // Put back below: the next column moves another variable.
  parameters_[slot] = moved.data();
  const bool evaluated = !Evaluate(/*jacobians=*/false).failed();
  parameters_[slot] = point_[slot].values;
  std::copy(residuals_.begin(), residuals_.end(), residuals);
  // A residual that is not finite is as good as none: the step is made smaller.
  return evaluated && AllFinite(residuals, num_rows_);
}

// The step is relative to the value, where it has one. In a tangent space of a manifold the scalar
// is 0 at the point, and the step absolute.
bool FamilyCheck::CheckColumn(std::size_t slot, std::size_t column) {
  std::vector<double> delta(NumColumns(slot), 0.0);
  double scale = 1.0;
  if (point_[slot].manifold == nullptr) {
    scale = std::max(scale, std::fabs(point_[slot].values[column]));
  }
  NumericDerivative derivative;
  const bool found = DifferentiateByRidders(
      options_.relative_step * scale, num_rows_,
      // Only one entry of delta is ever set; it is overwritten at each step.
      [&](double t, double* residuals) {
        delta[column] = t;
        return EvaluateAt(slot, delta, residuals);
      },
      &derivative);
  if (!found) {
    what_failed_ = "residuals beside the values, along slot " + std::to_string(slot) + ", column " +
                   std::to_string(column);
    return false;
  }
  Judge(slot, column, derivative);
  return true;
}

void FamilyCheck::Judge(std::size_t slot, std::size_t column, const NumericDerivative& derivative) {
  for (std::size_t r = 0; r < num_rows_; ++r) {
    JacobianEntry entry;
    entry.family = id_;
    entry.factor = factor_;
    entry.slot = static_cast<int>(slot);
    entry.row = static_cast<int>(r);
    entry.column = static_cast<int>(column);
    entry.analytic = jacobians_[slot][r * NumColumns(slot) + column];
    entry.numeric = derivative.value[r];
    entry.numeric_error = derivative.error[r];
    // Differences of zero come first: 0 / 0 where a whole row is zero.
    const double difference = std::fabs(entry.analytic - entry.numeric);
    const double scale = std::max(largest_[r], std::fabs(entry.numeric));
    entry.relative_error = difference == 0.0           ? 0.0
                           : std::isfinite(difference) ? difference / scale
                                                       : std::numeric_limits<double>::infinity();
    // Not <=: an entry that is NaN is wrong.
    const bool differs = !(difference <= options_.tolerance * scale);
    // Further off than the numeric derivative may err: otherwise nothing is proven.
    const bool wrong = differs && !(difference <= entry.numeric_error);
    ++report_.num_entries;
    report_.num_uncertain += differs && !wrong ? 1 : 0;
    const bool first_wrong = wrong && report_.num_wrong == 0;
    report_.num_wrong += wrong ? 1 : 0;
    // As long as none is wrong the worst of all entries is told; from the first wrong one on, the
    // worst of the wrong ones. The error of an entry that is not finite is infinite.
    const bool counts = wrong || report_.num_wrong == 0;
    if (report_.worst.factor < 0 || first_wrong ||
        (counts && !(entry.relative_error <= report_.worst.relative_error))) {
      report_.worst = entry;
    }
  }
}

bool FamilyCheck::Check(int factor, const std::vector<SlotPoint>& point) {
  factor_ = factor;
  point_ = point;
  if (!WriteAnalytic()) {
    return false;
  }
  // The first failure ends the factor: what_failed_ tells where.
  for (std::size_t s = 0; s < num_slots_; ++s) {
    for (std::size_t c = 0; c < NumColumns(s); ++c) {
      if (!CheckColumn(s, c)) {
        return false;
      }
    }
  }
  ++report_.num_factors;
  return true;
}

}  // namespace inceres::internal
