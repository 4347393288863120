#include "linearize/incremental_family.h"

#include <algorithm>
#include <cmath>

#include "base/lowest_index.h"
#include "linearize/moved_factors.h"
#include "linearize/robustify.h"

namespace inceres::internal {
namespace {

// Below this √w the linearization says nothing about the residual any more.
constexpr double kNoWeight = 1e-12;

// A residual that changes by less than this share of itself is steady enough for the curvature of its loss to count.
constexpr double kSteadyShare = 1.0 / 3.0;

// Factors a task; a smaller list stays on the calling thread.
constexpr int kGrain = 512;

double Dot(const double* a, const double* b, int size) {
  double sum = 0.0;
  for (int r = 0; r < size; ++r) {
    sum += a[r] * b[r];
  }
  return sum;
}

}  // namespace

IncrementalFamily::IncrementalFamily(const FactorGraph& graph, FamilyId id)
    : graph_(&graph),
      family_(&graph.family(id)),
      kernels_(&BestKernels()),
      id_(id),
      constant_jacobian_(family_->HasConstantJacobian()),
      residual_size_(family_->residual_size()),
      num_slots_(family_->num_slots()),
      jacobians_(num_slots_),
      slots_(num_slots_),
      views_(num_slots_) {
  for (int s = 0; s < num_slots_; ++s) {
    const int row_stride = PadToQuad(family_->slot(s).tangent_size);
    slots_[s] = {nullptr, static_cast<std::ptrdiff_t>(residual_size_) * row_stride, row_stride, family_->slot(s).tangent_size};
  }
}

void IncrementalFamily::Grow(int num_places) {
  num_places_ = num_places;
  const auto n = static_cast<std::size_t>(num_places);
  const std::size_t room = n > states_.capacity() ? 2 * n : n;  // the arrays grow in step
  for (int s = 0; s < num_slots_; ++s) {
    jacobians_[s].reserve(room * slots_[s].factor_stride);
    jacobians_[s].resize(n * slots_[s].factor_stride);
    slots_[s].data = jacobians_[s].data();
    views_[s] = {slots_[s].data, slots_[s].factor_stride, slots_[s].row_stride};
  }
  for (std::vector<double>* residuals : {&f_, &candidate_f_, &predicted_f_, &J_step_, &q_, &candidate_q_, &correction_}) {
    residuals->reserve(room * residual_size_);
    residuals->resize(n * residual_size_);
  }
  states_.reserve(room);
  states_.resize(n);
  linearized_.resize(n, Linearized::kNot);
  parameters_.resize(n * num_slots_);
  jacobian_parameters_.resize(n * num_slots_);
  pinned_.resize(n, 0);
  steady_.resize(n, 0);
  candidate_parameters_.resize(n * num_slots_);
  maps_.resize(n * num_slots_);
  step_quads_.resize(n * num_slots_, -1);
  y_targets_.resize(n * num_slots_, -1);
}

void IncrementalFamily::Connect(int factor, IncrementalValues* values, const IncrementalTangents& tangents) {
  if (factor >= num_places_) {
    Grow(factor + 1);
  }
  linearized_[factor] = Linearized::kNot;
  pinned_[factor] = 0;
  steady_[factor] = 0;
  for (int s = 0; s < num_slots_; ++s) {
    const VariableId id = variables(factor)[s];
    const auto at = static_cast<std::size_t>(factor) * num_slots_ + s;
    parameters_[at] = jacobian_parameters_[at] = values->current(id);
    const double* pinned = graph_->HasPins() && tangents.map(id).wanted() ? graph_->PinnedValues(id) : nullptr;
    if (pinned != nullptr) {
      jacobian_parameters_[at] = pinned;
      pinned_[factor] = 1;
    }
    candidate_parameters_[at] = values->candidate(id);
    maps_[at] = &tangents.map(id);
    step_quads_[at] = tangents.quad(id);
    y_targets_[at] = -1;
  }
}

// One virtual call for each run of neighbors, cut at the tasks' borders. A failure found by any task is the first factor's.
template <typename Evaluate>
EvaluationFailure IncrementalFamily::ForRuns(const std::vector<std::int32_t>& factors, const Executor& executor,
                                             Evaluate&& evaluate) {
  const auto run = [&](int begin, int end) -> EvaluationFailure {
    for (int k = begin; k < end;) {
      int next = k + 1;
      while (next < end && factors[next] == factors[next - 1] + 1) {
        ++next;
      }
      const EvaluationFailure failure = evaluate(factors[k], factors[next - 1] + 1);
      if (failure.failed()) {
        return failure;
      }
      k = next;
    }
    return {};
  };
  const int count = static_cast<int>(factors.size());
  const int grain = std::clamp(family_->TaskSize(), 1, kGrain);
  if (executor.num_threads() == 1 || count <= grain) {
    return run(0, count);
  }
  failures_.assign((count + grain - 1) / grain, EvaluationFailure());
  LowestIndex first_failed(static_cast<int>(failures_.size()));  // what lies behind it is left out
  executor.For(static_cast<int>(failures_.size()), 1, [&](int begin, int end) {
    for (int task = begin; task < end; ++task) {
      if (task < first_failed.get()) {
        failures_[task] = run(task * grain, std::min(count, (task + 1) * grain));
      }
      if (failures_[task].failed()) {
        first_failed.Note(task);
      }
    }
  });
  const auto first = std::find_if(failures_.begin(), failures_.end(), [](const auto& failure) { return failure.failed(); });
  return first == failures_.end() ? EvaluationFailure() : *first;
}

EvaluationFailure IncrementalFamily::EvaluateCandidate(const std::vector<std::int32_t>& factors, const Executor& executor) {
  return ForRuns(factors, executor, [this](int begin, int end) {
    FactorBatch batch;
    batch.begin = begin;
    batch.end = end;
    batch.parameters = candidate_parameters_.data();
    batch.residuals = candidate_f_.data();
    const EvaluationFailure failure = family_->Evaluate(batch);
    if (!failure.failed()) {
      WeighCandidates(begin, end);
    }
    return failure;
  });
}

EvaluationFailure IncrementalFamily::Linearize(const std::vector<std::int32_t>& factors, const Executor& executor) {
  return ForRuns(factors, executor, [this](int begin, int end) {
    FactorBatch batch;
    batch.begin = begin;
    batch.end = end;
    batch.parameters = jacobian_parameters_.data();
    batch.tangent_maps = maps_.data();
    batch.residuals = f_.data();
    batch.jacobians = views_.data();
    EvaluationFailure failure = family_->Evaluate(batch);
    if (!failure.failed()) {
      failure = EvaluateMoved(*family_, batch, parameters_.data(), [this](int i) { return pinned_[i] != 0; });
    }
    for (int i = begin; i < end && !failure.failed(); ++i) {
      Weigh(i);
    }
    return failure;
  });
}

// ρ, ρ' and ρ'' at a residual, and its squared norm.
double IncrementalFamily::EvaluateLoss(int factor, const double* f, double* rho) const {
  const double s = Dot(f, f, residual_size_);
  rho[0] = s;
  rho[1] = 1.0;
  rho[2] = 0.0;
  if (const Loss* loss = graph_->loss(id_, factor)) {
    loss->Evaluate(s, rho);
  }
  return s;
}

// q at the candidate, with the w, n and β of the Jacobian.
template <int kSize>
void IncrementalFamily::WeighCandidatesSized(int begin, int end) {
  const int size = kSize > 0 ? kSize : residual_size_;
  const bool has_losses = graph_->HasLosses(id_);
  const double* f = candidate_f_.data() + First(begin);
  double* q = candidate_q_.data() + First(begin);
  for (int i = begin; i < end; ++i, f += size, q += size) {
    double s = 0.0;
    for (int r = 0; r < size; ++r) {
      s += f[r] * f[r];
    }
    double rho[3] = {s, 1.0, 0.0};
    if (const Loss* loss = has_losses ? graph_->loss(id_, i) : nullptr) {
      loss->Evaluate(s, rho);
    }
    State& state = states_[i];
    state.candidate_cost = 0.5 * rho[0];
    state.candidate_w = rho[1];
    const double scale = rho[1] * state.inverse_sqrt_w;
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
  switch (residual_size_) {
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
  const double* f = f_.data() + First(factor);
  double rho[3];
  const double s = EvaluateLoss(factor, f, rho);
  const double root = steady_[factor] != 0 ? RootOfCurvature(s, rho) : 1.0;  // 1 − α
  const bool corrected = root < 1.0;
  const double sqrt_w = std::sqrt(rho[1]);
  State& state = states_[factor];
  state.cost = 0.5 * rho[0];
  state.w = state.linearized_w = rho[1];
  state.inverse_sqrt_w = sqrt_w > kNoWeight ? 1.0 / sqrt_w : 0.0;
  state.error = state.squared_gradient_error = 0.0;
  linearized_[factor] = corrected ? Linearized::kCorrected : Linearized::kPlainly;
  const double sqrt_beta = std::sqrt(1.0 / root - 1.0);
  for (int r = 0; r < residual_size_; ++r) {
    predicted_f_[First(factor) + r] = f[r];
    q_[First(factor) + r] = sqrt_w / root * f[r];
    if (corrected) {
      correction_[First(factor) + r] = sqrt_beta * f[r] / std::sqrt(s);
    }
  }
  if (sqrt_w != 1.0 || corrected) {
    CorrectJacobians(sqrt_w, corrected ? (1.0 - root) / s : 0.0, f, residual_size_, num_slots_, slots_.data(), factor,
                     step_quads_.data() + static_cast<std::ptrdiff_t>(factor) * num_slots_);
  }
}

FactorRows IncrementalFamily::Rows() const {
  FactorRows rows;
  rows.residual_size = residual_size_;
  rows.num_slots = num_slots_;
  rows.jacobians = slots_.data();
  rows.tangent_offsets = step_quads_.data();
  return rows;
}

double IncrementalFamily::PredictDecrease(const std::vector<std::int32_t>& factors, const double* padded_step) {
  kernels_->multiply_rows(Rows(), factors.data(), static_cast<int>(factors.size()), padded_step, J_step_.data());
  double decrease = 0.0;
  for (const std::int32_t factor : factors) {
    for (std::ptrdiff_t k = First(factor); k < First(factor) + residual_size_; ++k) {
      decrease -= J_step_[k] * (q_[k] + 0.5 * J_step_[k]);
    }
  }
  return decrease;
}

void IncrementalFamily::Slope(int factor, double* slope, double* curvature) const {
  *slope = *curvature = 0.0;
  for (std::ptrdiff_t k = First(factor); k < First(factor) + residual_size_; ++k) {
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

void IncrementalFamily::SubtractGradient(const std::vector<std::int32_t>& factors, double* padded_rhs) const {
  kernels_->subtract_transposed(Rows(), factors.data(), static_cast<int>(factors.size()), q_.data(), padded_rhs);
}

double IncrementalFamily::CandidateChange(const std::vector<std::int32_t>& factors) const {
  double change = 0.0;
  for (const std::int32_t factor : factors) {
    change += states_[factor].candidate_cost - states_[factor].cost;
  }
  return change;
}

bool IncrementalFamily::HasCurvedLoss(int factor) const {
  double rho[3];
  EvaluateLoss(factor, f_.data() + First(factor), rho);
  return rho[2] > 0.0;
}

double IncrementalFamily::TryStep(const std::vector<std::int32_t>& factors, const double* padded_step, double* padded_rhs) {
  FactorRows rows = Rows();
  rows.residuals = q_.data();
  return kernels_->try_rows(rows, factors.data(), static_cast<int>(factors.size()), padded_step, candidate_q_.data(),
                            J_step_.data(), padded_rhs);
}

template <int kSize>
double IncrementalFamily::AcceptSized(const std::vector<std::int32_t>& factors) {
  const int size = kSize > 0 ? kSize : residual_size_;
  double change = 0.0;
  for (const std::int32_t factor : factors) {
    State& state = states_[factor];
    double error = 0.0;
    double squared_norm = 0.0;
    double squared_change = 0.0;
    const std::ptrdiff_t first = static_cast<std::ptrdiff_t>(factor) * size;
    const bool corrected = IsCorrected(factor);
    const double along = corrected ? Dot(correction_.data() + first, J_step_.data() + first, size) : 0.0;
    for (std::ptrdiff_t k = first; k < first + size; ++k) {
      const double f = candidate_f_[k];
      const double foreseen = state.inverse_sqrt_w * (J_step_[k] + (corrected ? along * correction_[k] : 0.0));
      const double predicted = constant_jacobian_ ? f : predicted_f_[k] + foreseen;
      predicted_f_[k] = predicted;
      f_[k] = f;
      q_[k] = candidate_q_[k];
      error += (f - predicted) * (f - predicted);
      squared_norm += f * f;
      squared_change += foreseen * foreseen;
    }
    steady_[factor] = squared_change > 0.0 && squared_change <= kSteadyShare * kSteadyShare * squared_norm ? 1 : 0;
    change += state.candidate_cost - state.cost;
    state.cost = state.candidate_cost;
    state.w = state.candidate_w;
    state.error = state.w * error;
    state.squared_gradient_error = state.w * state.error * squared_norm;
  }
  return change;
}

double IncrementalFamily::Accept(const std::vector<std::int32_t>& factors) {
  switch (residual_size_) {
    case 1:
      return AcceptSized<1>(factors);
    case 2:
      return AcceptSized<2>(factors);
    default:
      return AcceptSized<0>(factors);
  }
}

std::int64_t IncrementalFamily::Bytes() const {
  std::size_t doubles = 7 * f_.capacity() + sizeof(State) / sizeof(double) * states_.capacity();
  for (const AlignedVector<double>& J : jacobians_) {
    doubles += J.capacity();
  }
  return static_cast<std::int64_t>(doubles * sizeof(double) + linearized_.capacity() + steady_.capacity() +
                                   parameters_.capacity() * (4 * sizeof(void*) + 2 * sizeof(std::int32_t)));
}

}  // namespace inceres::internal
