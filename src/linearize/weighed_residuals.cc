#include "linearize/weighed_residuals.h"

#include <cmath>
#include <limits>

#include "inceres/problem/constant_size.h"

// Per factor there are the corrected Jacobian J := √w (I − α n nᵀ) J, which its user keeps, the
// residual f now, the residual f̂ that the cached J predicts, and q. The correction is kept as
// m = √β n, so that I + m mᵀ undoes it for q and for predictions.
//
// Where √w is next to zero, J and q say nothing of f any more; inverse_sqrt_w is 0 then, which
// keeps divisions out of all formulas.
//
// Each factor writes its own places, so weighing may run on threads; sums over factors are taken
// in the order of the list.

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

// All arrays by place grow together.
void WeighedResiduals::Grow(int num_places, int capacity) {
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
}

// q at the candidate, with the w, n and β of the Jacobian.
// The gradient of the candidate in the coordinates of the old J: J is not evaluated for it.
template <typename Size>
void WeighedResiduals::WeighCandidatesSized(Size size, const Linearization& factors, int begin,
                                            int end) {
  const FactorGraph& graph = *factors.graph;
  const bool has_losses = graph.HasLosses(factors.id);
  const double* f = factors.candidate_residuals.data() + First(begin);
  double* q = candidate_q_.data() + First(begin);
  for (int i = begin; i < end; ++i, f += size, q += size) {
    const LossValue value(has_losses ? graph.loss(factors.id, i) : nullptr, f, size);
    State& state = states_[i];
    // Without a weight there is no Jacobian at the candidate: it is refused as one without a cost.
    state.candidate_cost =
        value.HasWeight() ? value.cost() : std::numeric_limits<double>::quiet_NaN();
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

void WeighedResiduals::WeighCandidates(const Linearization& factors, int begin, int end) {
  WithConstantSize(size_, [&](auto size) { WeighCandidatesSized(size, factors, begin, end); });
}

// w = ρ'(‖f‖²) now: J := √w (I − α n nᵀ) J, q := √w f / (1 − α).
// f / (1 − α) is (I + β n nᵀ) f, since f is along n. f̂ begins as f, so all errors are zero.
RobustScale WeighedResiduals::Weigh(const Linearization& factors, int factor) {
  const double* f = factors.residuals.data() + First(factor);
  const LossValue value(factors.graph->loss(factors.id, factor), f, size_);
  // The second-order term is taken only for factors whose last step changed f little: elsewhere the
  // curvature at one point misleads.
  const RobustScale scale(value,
                          steady_[factor] != 0 ? LossCurvature::kNegative : LossCurvature::kNone);
  const bool corrected = scale.is_corrected();
  State& state = states_[factor];
  state.cost = value.cost();
  state.w = state.linearized_w = value.weight();
  state.inverse_sqrt_w = IsNoWeight(scale.sqrt_weight) ? 0.0 : 1.0 / scale.sqrt_weight;
  state.error = state.squared_gradient_error = 0.0;
  linearized_[factor] = corrected ? Linearized::kCorrected : Linearized::kPlainly;
  const double residual_scale = scale.residual();
  double* const predicted_f = predicted_f_.data() + First(factor);
  double* const q = q_.data() + First(factor);
  for (int r = 0; r < size_; ++r) {
    predicted_f[r] = f[r];
    q[r] = residual_scale * f[r];
  }
  if (corrected) {
    // α < 0 does not occur here, for kNegative makes 1 − α at most 1; so β has a root.
    const double sqrt_beta = std::sqrt(1.0 / scale.root - 1.0);
    for (int r = 0; r < size_; ++r) {
      correction_[First(factor) + r] = sqrt_beta * f[r] / std::sqrt(value.s);
    }
  }
  return scale;
}

// As linearized where it was, with the new w: q := √w f; f̂ stays, so that the error of the old
// linearization is known at the new weight, too.
// α is 0 from here on: n and the curvature belong to another residual.
void WeighedResiduals::Reweigh(int factor, const LossValue& value, const double* f) {
  State& state = states_[factor];
  const double sqrt_w = std::sqrt(value.weight());
  state.cost = value.cost();
  state.w = state.linearized_w = value.weight();
  state.inverse_sqrt_w = IsNoWeight(sqrt_w) ? 0.0 : 1.0 / sqrt_w;
  double error = 0.0;
  for (int r = 0; r < size_; ++r) {
    const double difference = f[r] - predicted_f_[First(factor) + r];
    error += difference * difference;
    q_[First(factor) + r] = sqrt_w * f[r];
  }
  // As Accept would have set them, with the new w.
  state.error = state.w * error;
  state.squared_gradient_error = state.w * state.error * value.s;
  linearized_[factor] = Linearized::kPlainly;
  // The last step was one under another loss.
  Unsettle(factor);
}

// ηᵀδ − ½ δᵀHδ would be a difference of numbers that become equal near the minimum.
double WeighedResiduals::PredictedDecrease(const std::vector<std::int32_t>& list) const {
  double decrease = 0.0;
  for (const std::int32_t factor : list) {
    for (std::ptrdiff_t k = First(factor); k < First(factor) + size_; ++k) {
      decrease -= J_step_[k] * (q_[k] + 0.5 * J_step_[k]);
    }
  }
  return decrease;
}

void WeighedResiduals::Slope(int factor, double* slope, double* curvature) const {
  *slope = *curvature = 0.0;
  for (std::ptrdiff_t k = First(factor); k < First(factor) + size_; ++k) {
    *slope -= J_step_[k] * q_[k];
    *curvature += J_step_[k] * J_step_[k];
  }
}

// Actual change less the predicted change qᵀJδ + ½ ‖Jδ‖².
double WeighedResiduals::UnforeseenCost(int factor) const {
  double slope = 0.0;
  double curvature = 0.0;
  Slope(factor, &slope, &curvature);
  return states_[factor].candidate_cost - states_[factor].cost + slope - 0.5 * curvature;
}

double WeighedResiduals::CandidateChange(const std::vector<std::int32_t>& list) const {
  double change = 0.0;
  for (const std::int32_t factor : list) {
    change += states_[factor].candidate_cost - states_[factor].cost;
  }
  return change;
}

// f := candidate, f̂ := f̂ + (I + m mᵀ) J δ / √w. Then ‖f − f̂‖ is how far the cached J has been
// wrong along all steps since it was made.
template <typename Size>
double WeighedResiduals::AcceptSized(Size size, const std::vector<std::int32_t>& list,
                                     Linearization* factors) {
  double* const f_now = factors->residuals.data();
  const double* const candidate_f = factors->candidate_residuals.data();
  double change = 0.0;
  for (const std::int32_t factor : list) {
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

double WeighedResiduals::Accept(const std::vector<std::int32_t>& list, Linearization* factors) {
  return WithConstantSize(size_, [&](auto size) { return AcceptSized(size, list, factors); });
}

// Five arrays are as long as q.
std::size_t WeighedResiduals::Bytes() const {
  return sizeof(double) * 5 * q_.capacity() + sizeof(State) * states_.capacity() +
         linearized_.capacity() + steady_.capacity();
}

}  // namespace inceres::internal
