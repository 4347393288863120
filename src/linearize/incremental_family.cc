#include "linearize/incremental_family.h"

#include <algorithm>
#include <cmath>

#include "linearize/robustify.h"

namespace inceres::internal {
namespace {

// A residual that changes by less than this share of itself is steady enough for the curvature of
// its loss to count.
constexpr double kSteadyShare = 1.0 / 3.0;

double Dot(const double* a, const double* b, int size) {
  double sum = 0.0;
  for (int r = 0; r < size; ++r) {
    sum += a[r] * b[r];
  }
  return sum;
}

}  // namespace

IncrementalFamily::IncrementalFamily(const FactorGraph& graph, FamilyId id)
    : factors_(graph, id),
      kernels_(&BestKernels()),
      constant_jacobian_(factors_.family->HasConstantJacobian()) {
}

void IncrementalFamily::Grow(int num_places) {
  const int capacity = num_places > factors_.capacity
                           ? 2 * num_places
                           : factors_.capacity;  // the columns grow in step
  factors_.Grow(num_places, capacity);
  factors_.candidate_parameters.resize(factors_.parameters.size());
  const auto n = static_cast<std::size_t>(num_places);
  for (std::vector<double>* residuals :
       {&predicted_f_, &J_step_, &q_, &candidate_q_, &correction_}) {
    residuals->reserve(First(capacity));
    residuals->resize(First(num_places));
  }
  states_.reserve(capacity);
  states_.resize(n);
  linearized_.resize(n, Linearized::kNot);
  steady_.resize(n, 0);
  y_targets_.resize(factors_.parameters.size(), -1);
}

void IncrementalFamily::Connect(int factor, VariableStore* variable_store) {
  if (factor >= num_places()) {
    Grow(factor + 1);
  }
  Forget(factor);
  Unsettle(factor);
  const FactorGraph& graph = *factors_.graph;
  for (int s = 0; s < num_slots(); ++s) {
    const VariableId id = variables(factor)[s];
    const TangentMap& map = variable_store->map(id);
    const auto at = static_cast<std::size_t>(factors_.Entry(factor)) + s;
    factors_.Connect(at, variable_store->current(id),
                     graph.HasPins() && map.wanted() ? graph.PinnedValues(id) : nullptr, map);
    factors_.candidate_parameters[at] = variable_store->candidate(id);
    factors_.tangent_offsets[at] = variable_store->quad(id);
    y_targets_[at] = -1;
  }
}

EvaluationFailure IncrementalFamily::EvaluateCandidate(const std::vector<std::int32_t>& factors,
                                                       const Executor& executor) {
  const EvaluationFailure unprepared = factors_.Prepare(/*jacobians=*/false, factors);
  if (unprepared.failed()) {
    return unprepared;
  }
  return factors_.ForRuns(factors, executor, [this](int begin, int end) {
    const EvaluationFailure failure = factors_.EvaluateCandidate(begin, end);
    if (!failure.failed()) {
      WeighCandidates(begin, end);
    }
    return failure;
  });
}

EvaluationFailure IncrementalFamily::Linearize(const std::vector<std::int32_t>& factors,
                                               const Executor& executor) {
  const EvaluationFailure unprepared = factors_.Prepare(/*jacobians=*/true, factors);
  if (unprepared.failed()) {
    return unprepared;
  }
  for (const std::int32_t factor : factors) {
    parked_.Drop(factor);
  }
  return factors_.ForRuns(factors, executor, [this](int begin, int end) {
    const EvaluationFailure failure = factors_.Linearize(begin, end);
    for (int i = begin; i < end && !failure.failed(); ++i) {
      Weigh(i);
    }
    return failure;
  });
}

// q at the candidate, with the w, n and β of the Jacobian.
template <int kSize>
void IncrementalFamily::WeighCandidatesSized(int begin, int end) {
  const int size = kSize > 0 ? kSize : residual_size();
  const FactorGraph& graph = *factors_.graph;
  const bool has_losses = graph.HasLosses(id());
  const double* f = factors_.candidate_residuals.data() + First(begin);
  double* q = candidate_q_.data() + First(begin);
  for (int i = begin; i < end; ++i, f += size, q += size) {
    const LossValue value(has_losses ? graph.loss(id(), i) : nullptr, f, size);
    State& state = states_[i];
    state.candidate_cost = value.cost();
    state.candidate_w = value.weight();
    const double scale = value.weight() * state.inverse_sqrt_w;
    for (int r = 0; r < size; ++r) {
      q[r] = scale * f[r];
    }
    if (IsCorrected(i)) {
      const double* m = correction_.data() + First(i);
      const double along = Dot(m, q, size);
      for (int r = 0; r < size; ++r) {
        q[r] += along * m[r];
      }
    }
  }
}

void IncrementalFamily::WeighCandidates(int begin, int end) {
  switch (residual_size()) {
    case 1:
      return WeighCandidatesSized<1>(begin, end);
    case 2:
      return WeighCandidatesSized<2>(begin, end);
    default:
      return WeighCandidatesSized<0>(begin, end);
  }
}

// w = ρ'(‖f‖²) now: J := √w (I − α n nᵀ) J, q := √w f / (1 − α).
void IncrementalFamily::Weigh(int factor) {
  const double* f = residual(factor);
  const LossValue value(factors_.graph->loss(id(), factor), f, residual_size());
  const RobustScale scale(value,
                          steady_[factor] != 0 ? LossCurvature::kNegative : LossCurvature::kNone);
  const bool corrected = scale.is_corrected();
  State& state = states_[factor];
  state.cost = value.cost();
  state.w = state.linearized_w = value.weight();
  state.inverse_sqrt_w = scale.sqrt_weight > kNoWeight ? 1.0 / scale.sqrt_weight : 0.0;
  state.error = state.squared_gradient_error = 0.0;
  linearized_[factor] = corrected ? Linearized::kCorrected : Linearized::kPlainly;
  const double residual_scale = scale.residual();
  const double sqrt_beta = std::sqrt(1.0 / scale.root - 1.0);
  for (int r = 0; r < residual_size(); ++r) {
    predicted_f_[First(factor) + r] = f[r];
    q_[First(factor) + r] = residual_scale * f[r];
    if (corrected) {
      correction_[First(factor) + r] = sqrt_beta * f[r] / std::sqrt(value.s);
    }
  }
  if (!scale.is_one()) {
    scale.Apply(f, residual_size(), num_slots(), slots(), factor,
                factors_.tangent_offsets.data() + factors_.Entry(factor));
  }
}

double IncrementalFamily::PredictDecrease(const std::vector<std::int32_t>& factors,
                                          const double* padded_step) {
  kernels_->multiply_rows(factors_.Rows(0, 0), factors.data(), static_cast<int>(factors.size()),
                          padded_step, J_step_.data());
  double decrease = 0.0;
  for (const std::int32_t factor : factors) {
    for (std::ptrdiff_t k = First(factor); k < First(factor) + residual_size(); ++k) {
      decrease -= J_step_[k] * (q_[k] + 0.5 * J_step_[k]);
    }
  }
  return decrease;
}

void IncrementalFamily::Slope(int factor, double* slope, double* curvature) const {
  *slope = *curvature = 0.0;
  for (std::ptrdiff_t k = First(factor); k < First(factor) + residual_size(); ++k) {
    *slope -= J_step_[k] * q_[k];
    *curvature += J_step_[k] * J_step_[k];
  }
}

double IncrementalFamily::UnforeseenCost(int factor) const {
  double slope = 0.0;
  double curvature = 0.0;
  Slope(factor, &slope, &curvature);
  return states_[factor].candidate_cost - states_[factor].cost + slope - 0.5 * curvature;
}

void IncrementalFamily::SubtractGradient(const std::vector<std::int32_t>& factors,
                                         double* padded_rhs) const {
  kernels_->subtract_transposed(factors_.Rows(0, 0), factors.data(),
                                static_cast<int>(factors.size()), q_.data(), padded_rhs);
}

double IncrementalFamily::CandidateChange(const std::vector<std::int32_t>& factors) const {
  double change = 0.0;
  for (const std::int32_t factor : factors) {
    change += states_[factor].candidate_cost - states_[factor].cost;
  }
  return change;
}

bool IncrementalFamily::HasCurvedLoss(int factor) const {
  return LossValue(factors_.graph->loss(id(), factor), residual(factor), residual_size()).rho[2] >
         0.0;
}

double IncrementalFamily::TryStep(const std::vector<std::int32_t>& factors,
                                  const double* padded_step, double* padded_rhs) {
  FactorRows rows = factors_.Rows(0, 0);
  rows.residuals = q_.data();
  return kernels_->try_rows(rows, factors.data(), static_cast<int>(factors.size()), padded_step,
                            candidate_q_.data(), J_step_.data(), padded_rhs);
}

template <int kSize>
double IncrementalFamily::AcceptSized(const std::vector<std::int32_t>& factors) {
  const int size = kSize > 0 ? kSize : residual_size();
  double* const f_now = factors_.residuals.data();
  const double* const candidate_f = factors_.candidate_residuals.data();
  double change = 0.0;
  for (const std::int32_t factor : factors) {
    State& state = states_[factor];
    double error = 0.0;
    double squared_norm = 0.0;
    double squared_change = 0.0;
    const std::ptrdiff_t first = static_cast<std::ptrdiff_t>(factor) * size;
    const bool corrected = IsCorrected(factor);
    const double along =
        corrected ? Dot(correction_.data() + first, J_step_.data() + first, size) : 0.0;
    for (std::ptrdiff_t k = first; k < first + size; ++k) {
      const double f = candidate_f[k];
      const double foreseen =
          state.inverse_sqrt_w * (J_step_[k] + (corrected ? along * correction_[k] : 0.0));
      const double predicted = constant_jacobian_ ? f : predicted_f_[k] + foreseen;
      predicted_f_[k] = predicted;
      f_now[k] = f;
      q_[k] = candidate_q_[k];
      error += (f - predicted) * (f - predicted);
      squared_norm += f * f;
      squared_change += foreseen * foreseen;
    }
    steady_[factor] =
        squared_change > 0.0 && squared_change <= kSteadyShare * kSteadyShare * squared_norm ? 1
                                                                                             : 0;
    change += state.candidate_cost - state.cost;
    state.cost = state.candidate_cost;
    state.w = state.candidate_w;
    state.error = state.w * error;
    state.squared_gradient_error = state.w * state.error * squared_norm;
  }
  return change;
}

double IncrementalFamily::Accept(const std::vector<std::int32_t>& factors) {
  switch (residual_size()) {
    case 1:
      return AcceptSized<1>(factors);
    case 2:
      return AcceptSized<2>(factors);
    default:
      return AcceptSized<0>(factors);
  }
}

std::int64_t IncrementalFamily::Bytes() const {
  const std::size_t doubles = factors_.residuals.size() + factors_.candidate_residuals.size() +
                              factors_.jacobian_values.size() + 5 * q_.capacity() +
                              sizeof(State) / sizeof(double) * states_.capacity();
  return static_cast<std::int64_t>(
      doubles * sizeof(double) + parked_.Bytes() + linearized_.capacity() + steady_.capacity() +
      factors_.parameters.capacity() * (3 * sizeof(void*) + 2 * sizeof(std::int32_t)));
}

}  // namespace inceres::internal
