#include "adapters/ceres/session/remembering_family.h"

#include <algorithm>
#include <cmath>
#include <cstring>

#include "adapters/ceres/read/index.h"

namespace inceres::internal {
namespace {

// How far, relative, the residuals of a cost-only and of a Jacobian call may lie apart and still be one function's: rounding,
// cancellation between prediction and measurement included.
constexpr double kRounding = 1e-6;

}  // namespace

RememberingFamily::RememberingFamily(int num_residuals, std::vector<Slot> slots, bool remembers)
    : AmbientFamily<RememberingFamily>(num_residuals, std::move(slots)), remembers_(remembers) {
  for (int s = 0; s < num_slots(); ++s) {
    num_values_ += At(slot(s).ambient_size);
  }
  stride_ = num_values_ + At(num_residuals);
  residual_.resize(At(num_residuals));
  pointers_.resize(At(num_slots()));
}

bool RememberingFamily::EvaluateOne(int i, const double* const* parameters, double* residuals, double** jacobians) const {
  const bool evaluated = costs_[At(i)]->Evaluate(parameters, residuals, jacobians);
  if (remembers_ && jacobians != nullptr) {
    memory_[At(i)] = evaluated ? Memory::kLinearized : Memory::kNone;
    double* values = Values(i);
    for (int s = 0; s < num_slots(); ++s) {
      values = std::copy_n(parameters[s], slot(s).ambient_size, values);
    }
    std::copy_n(residuals, residual_size(), values);
  }
  return evaluated;
}

std::string RememberingFamily::Describe(int i) const {
  return DescribeObject("cost function", costs_[At(i)]);
}

void RememberingFamily::Place(int i, const ceres::CostFunction* cost) {
  if (i >= size()) {
    costs_.resize(At(i) + 1, nullptr);
    if (remembers_) {
      memory_.resize(At(i) + 1, Memory::kNone);
      records_.resize((At(i) + 1) * stride_);
    }
  }
  costs_[At(i)] = cost;
  if (remembers_) {
    memory_[At(i)] = Memory::kNone;
  }
}

void RememberingFamily::Remember() {
  for (int i = 0; remembers_ && i < size(); ++i) {
    if (memory_[At(i)] != Memory::kLinearized || costs_[At(i)] == nullptr) {
      continue;
    }
    const bool proves = EvaluateCostOnly(*costs_[At(i)], Values(i)) && Proves(Residual(i));
    memory_[At(i)] = proves ? Memory::kProof : Memory::kNone;
    std::copy(residual_.begin(), residual_.end(), Residual(i));
  }
}

bool RememberingFamily::Recognize(int i, const ceres::CostFunction* cost) {
  return remembers_ && memory_[At(i)] == Memory::kProof && EvaluateCostOnly(*cost, Values(i)) &&
         std::memcmp(residual_.data(), Residual(i), residual_.size() * sizeof(double)) == 0;
}

// The result is in residual_.
bool RememberingFamily::EvaluateCostOnly(const ceres::CostFunction& cost, const double* values) {
  for (int s = 0; s < num_slots(); ++s) {
    pointers_[At(s)] = values;
    values += slot(s).ambient_size;
  }
  MarkUnwritten(residual_.data(), static_cast<int>(residual_.size()));
  return cost.Evaluate(pointers_.data(), residual_.data(), nullptr);
}

// Whether residual_, of a cost-only call, says something, and the same as the Jacobian call. A NaN says nothing.
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
