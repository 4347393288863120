#include "adapters/ceres/session/remembering_family.h"

#include <algorithm>
#include <cmath>
#include <cstring>

#include "adapters/ceres/read/index.h"

namespace inceres::internal {
namespace {

// How far, relative, the residuals of a cost-only and of a Jacobian call may lie apart and still be
// one function's: rounding, cancellation between prediction and measurement included.
constexpr double kRounding = 1e-6;

}  // namespace

RememberingFamily::RememberingFamily(int num_residuals, std::vector<Slot> slots, bool remembers)
    : CeresCostFamily(num_residuals, std::move(slots)), remembers_(remembers) {
  for (int s = 0; s < num_slots(); ++s) {
    num_values_ += At(slot(s).ambient_size);
  }
  stride_ = num_values_ + At(num_residuals);
  residual_.resize(At(num_residuals));
  pointers_.resize(At(num_slots()));
}

EvaluationFailure RememberingFamily::Evaluate(const FactorBatch& batch) const {
  const EvaluationFailure failure = CeresCostFamily::Evaluate(batch);
  if (remembers_) {
    for (int i = batch.begin; i < (failure.failed() ? failure.factor : batch.end); ++i) {
      Record(batch, i);
    }
    if (failure.failed() && batch.jacobians != nullptr) {
      memory_[At(failure.factor)] = Memory::kNone;
    }
  }
  return failure;
}

// Until there is a proof Jacobian calls are recorded, and then what follows it: cost-only calls,
// unless they say nothing. So the proof is of the function as the solver has seen it last:
// evaluated after the solve it would be of what the user has made of it meanwhile.
void RememberingFamily::Record(const FactorBatch& batch, int i) const {
  const double* const residual = batch.residuals + std::ptrdiff_t{i} * residual_size();
  const bool is_proof = memory_[At(i)] == Memory::kProof;
  const bool with_jacobians = batch.jacobians != nullptr;
  if (is_proof == with_jacobians || (is_proof && SaysNothing(residual))) {
    return;
  }
  CopyValues(batch.parameters + std::ptrdiff_t{i} * num_slots(), Values(i));
  std::copy_n(residual, residual_size(), Residual(i));
  memory_[At(i)] = is_proof ? Memory::kProof : Memory::kLinearized;
}

void RememberingFamily::CopyValues(const double* const* parameters, double* values) const {
  for (int s = 0; s < num_slots(); ++s) {
    values = std::copy_n(parameters[s], slot(s).ambient_size, values);
  }
}

void RememberingFamily::PlaceBorrowed(int i, const ceres::CostFunction* cost) {
  Place(i, Borrowed(cost));
  if (remembers_) {
    memory_.resize(At(size()));
    records_.resize(At(size()) * stride_);
    memory_[At(i)] = Memory::kNone;
  }
}

void RememberingFamily::Doubt(int i) {
  if (remembers_) {
    memory_[At(i)] = Memory::kNone;
  }
}

// Whether a cost-only call says the same as the Jacobian call is asked once.
void RememberingFamily::Remember(int i, const double* const* parameters) {
  if (!remembers_ || memory_[At(i)] != Memory::kLinearized) {
    return;
  }
  const bool proves = EvaluateCostOnly(*at(i), Values(i)) && Proves(Residual(i));
  memory_[At(i)] = proves ? Memory::kProof : Memory::kNone;
  std::copy(residual_.begin(), residual_.end(), Residual(i));
  if (proves && !HasValues(i, parameters)) {
    MoveProof(i, *at(i), parameters);
  }
}

// What is there recognized is evaluated here, and that is recorded from then on, unless it would
// prove nothing. False if it cannot be evaluated.
bool RememberingFamily::MoveProof(int i, const ceres::CostFunction& cost,
                                  const double* const* parameters) {
  const bool evaluates = EvaluateCostOnlyAt(cost, parameters) && IsFinite();
  memory_[At(i)] = evaluates ? memory_[At(i)] : Memory::kNone;
  if (evaluates && !SaysNothing(residual_.data())) {
    CopyValues(parameters, Values(i));
    std::copy(residual_.begin(), residual_.end(), Residual(i));
  }
  return evaluates;
}

bool RememberingFamily::HasValues(int i, const double* const* parameters) const {
  const double* values = Values(i);
  for (int s = 0; s < num_slots(); ++s) {
    const auto size = At(slot(s).ambient_size);
    if (std::memcmp(values, parameters[s], size * sizeof(double)) != 0) {
      return false;
    }
    values += size;
  }
  return true;
}

// What is recorded is of other values than those of now where the residual is zero at these. The
// function may have begun to refuse there and nowhere else, as beside a border of what it accepts.
bool RememberingFamily::Recognize(int i, const ceres::CostFunction* cost,
                                  const double* const* parameters) {
  return remembers_ && memory_[At(i)] == Memory::kProof && EvaluateCostOnly(*cost, Values(i)) &&
         std::memcmp(residual_.data(), Residual(i), residual_.size() * sizeof(double)) == 0 &&
         (HasValues(i, parameters) || MoveProof(i, *cost, parameters));
}

// The result is in residual_.
bool RememberingFamily::EvaluateCostOnly(const ceres::CostFunction& cost, const double* values) {
  for (int s = 0; s < num_slots(); ++s) {
    pointers_[At(s)] = values;
    values += slot(s).ambient_size;
  }
  return EvaluateCostOnlyAt(cost, pointers_.data());
}

bool RememberingFamily::EvaluateCostOnlyAt(const ceres::CostFunction& cost,
                                           const double* const* parameters) {
  MarkUnwritten(residual_.data(), static_cast<int>(residual_.size()));
  return cost.Evaluate(parameters, residual_.data(), nullptr);
}

// A NaN says no more than zero does.
bool RememberingFamily::SaysNothing(const double* residual) const {
  return !std::any_of(residual, residual + residual_size(),
                      [](double r) { return std::fabs(r) > 0.0; });
}

bool RememberingFamily::IsFinite() const {
  return std::all_of(residual_.begin(), residual_.end(), [](double r) { return std::isfinite(r); });
}

// Whether residual_, of a cost-only call, says something, and the same as the Jacobian call. A NaN
// says nothing.
bool RememberingFamily::Proves(const double* with_jacobians) const {
  double squared_norm = 0.0;
  double squared_difference = 0.0;
  for (std::size_t r = 0; r < residual_.size(); ++r) {
    squared_norm += residual_[r] * residual_[r];
    squared_difference += (residual_[r] - with_jacobians[r]) * (residual_[r] - with_jacobians[r]);
  }
  return squared_norm > 0.0 && squared_difference <= kRounding * kRounding * squared_norm;
}

}  // namespace inceres::internal
