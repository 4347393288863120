#include "linearize/incremental_family.h"

#include <algorithm>
#include <cmath>

#include "linearize/robustify.h"

namespace inceres::internal {

// The cached linearizations of one family in incremental mode (docs/algorithms.md, "Linearization"
// and "Robust losses"). Per factor there are the corrected Jacobian J := √w (I − α n nᵀ) J, the
// residual f now, the residual f̂ that the cached J predicts, and q, with which Jᵀq is the robust
// gradient at the present f:
//
//     q = w' (I + β n nᵀ) f / √w,    β = α / (1 − α),    (I − α n nᵀ)⁻¹ = I + β n nᵀ,
//
// where w, n and α are those of the linearization and w' = ρ' now. The correction is kept as
// m = √β n, so that I + m mᵀ undoes it for q and for predictions.
//
// A step goes through EvaluateCandidate (f, cost, w' and q at the candidate), TryStep (J δ is kept)
// and Accept (the candidate becomes the present, and f̂ follows by (I + m mᵀ) J δ / √w). A step
// that is refused leaves only values of the candidate behind, which the next one overwrites.
//
// Where √w is next to zero, J and q say nothing of f any more; inverse_sqrt_w is 0 then, which
// keeps divisions out of all formulas.
//
// Each factor writes its own places, so evaluation may run on threads; sums over factors are taken
// by the calling thread, in the order of the list.

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

// Capacity doubles, so that a factor costs constant time on average; all arrays by place grow
// together.
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

// A place that is used again begins like a new one: no linearization, no steadiness, no blocks of
// Y. Pointers into the variable store are looked up here, once.
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
    // A variable that is constant is not linearized and needs no pin.
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
  // Weights are taken run by run, while the residuals are in the cache.
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
  // Before the threads start: the parked Jacobians are one table for all factors.
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
// The gradient of the candidate in the coordinates of the old J: J is not evaluated for it.
template <int kSize>
void IncrementalFamily::WeighCandidatesSized(int begin, int end) {
  // Most residuals are of size 1 or 2, known at compile time there: no loop.
  const int size = kSize > 0 ? kSize : residual_size();
  const bool has_losses = factors_.graph->HasLosses(id());
  const double* f = factors_.candidate_residuals.data() + First(begin);
  double* q = candidate_q_.data() + First(begin);
  for (int i = begin; i < end; ++i, f += size, q += size) {
    const LossValue value(has_losses ? loss(i) : nullptr, f, size);
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
    case 3:
      return WeighCandidatesSized<3>(begin, end);
    case 6:
      return WeighCandidatesSized<6>(begin, end);
    default:
      return WeighCandidatesSized<0>(begin, end);
  }
}

// w = ρ'(‖f‖²) now: J := √w (I − α n nᵀ) J, q := √w f / (1 − α).
// f / (1 − α) is (I + β n nᵀ) f, since f is along n. f̂ begins as f, so all errors are zero.
void IncrementalFamily::Weigh(int factor) {
  const double* f = residual(factor);
  const LossValue value(loss(factor), f, residual_size());
  // The second-order term is taken only for factors whose last step changed f little: elsewhere the
  // curvature at one point misleads.
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
    // α < 0 does not occur here, for kNegative makes 1 − α at most 1; so β has a root.
    if (corrected) {
      correction_[First(factor) + r] = sqrt_beta * f[r] / std::sqrt(value.s);
    }
  }
  if (!scale.is_one()) {
    scale.Apply(f, residual_size(), num_slots(), slots(), factor,
                factors_.tangent_offsets.data() + factors_.Entry(factor));
  }
}

// −Σ (Jδ)ᵀ (q + ½ Jδ), the model decrease. ηᵀδ − ½ δᵀHδ would be a difference of numbers that
// become equal near the minimum.
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

// Actual change less the predicted change qᵀJδ + ½ ‖Jδ‖².
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

// One pass over the Jacobians for both products. If the step is refused, padded_rhs is the caller's
// to throw away.
double IncrementalFamily::TryStep(const std::vector<std::int32_t>& factors,
                                  const double* padded_step, double* padded_rhs) {
  FactorRows rows = factors_.Rows(0, 0);
  rows.residuals = q_.data();
  return kernels_->try_rows(rows, factors.data(), static_cast<int>(factors.size()), padded_step,
                            candidate_q_.data(), J_step_.data(), padded_rhs);
}

// f := candidate, f̂ := f̂ + (I + m mᵀ) J δ / √w. Then ‖f − f̂‖ is how far the cached J has been
// wrong along all steps since it was made.
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
      // A constant J makes no error; what rounding would leave of f − f̂ must not add up.
      const double predicted = constant_jacobian_ ? f : predicted_f_[k] + foreseen;
      predicted_f_[k] = predicted;
      f_now[k] = f;
      q_[k] = candidate_q_[k];
      error += (f - predicted) * (f - predicted);
      squared_norm += f * f;
      squared_change += foreseen * foreseen;
    }
    // Whether the curvature of the loss counts in the next linearization: the predicted change is
    // compared with f, and a factor that has not moved at all is not steady but unknown.
    steady_[factor] =
        squared_change > 0.0 && squared_change <= kSteadyShare * kSteadyShare * squared_norm ? 1
                                                                                             : 0;
    change += state.candidate_cost - state.cost;
    state.cost = state.candidate_cost;
    state.w = state.candidate_w;
    // With the weight of now, in units of the cost.
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
    case 3:
      return AcceptSized<3>(factors);
    case 6:
      return AcceptSized<6>(factors);
    default:
      return AcceptSized<0>(factors);
  }
}

// Five arrays are as long as q; per entry there are three pointers and two offsets.
std::int64_t IncrementalFamily::Bytes() const {
  const std::size_t doubles = factors_.residuals.size() + factors_.candidate_residuals.size() +
                              factors_.jacobian_values.size() + 5 * q_.capacity() +
                              sizeof(State) / sizeof(double) * states_.capacity();
  return static_cast<std::int64_t>(
      doubles * sizeof(double) + parked_.Bytes() + linearized_.capacity() + steady_.capacity() +
      factors_.parameters.capacity() * (3 * sizeof(void*) + 2 * sizeof(std::int32_t)));
}

}  // namespace inceres::internal
