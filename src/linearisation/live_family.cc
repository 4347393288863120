#include "linearisation/live_family.h"

#include <cmath>

#include "linearisation/robustify.h"

namespace inceres::internal {
namespace {

// Below this √w the linearisation says nothing about the residual any more.
constexpr double kNoWeight = 1e-12;

}  // namespace

LiveFamily::LiveFamily(const FactorGraph& graph, FamilyId id)
    : graph_(&graph),
      family_(&graph.family(id)),
      id_(id),
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

void LiveFamily::Grow(LiveValues* values, const LiveTangents& tangents) {
  const int old_count = num_factors_;
  num_factors_ = graph_->NumFactors(id_);
  const auto n = static_cast<std::size_t>(num_factors_);
  for (int s = 0; s < num_slots_; ++s) {
    jacobians_[s].resize(n * slots_[s].factor_stride);
    slots_[s].data = jacobians_[s].data();
    views_[s] = {slots_[s].data, slots_[s].factor_stride, slots_[s].row_stride};
  }
  for (std::vector<double>* residuals : {&f_, &candidate_f_, &predicted_f_, &J_step_, &q_}) {
    residuals->resize(n * residual_size_);
  }
  for (std::vector<double>* scalars : {&sqrt_w_, &current_w_, &cost_, &candidate_cost_}) {
    scalars->resize(n);
  }
  y_targets_.resize(n * num_slots_, -1);
  for (int i = old_count; i < num_factors_; ++i) {
    for (int s = 0; s < num_slots_; ++s) {
      const VariableId id = variables(i)[s];
      parameters_.push_back(values->current(id));
      candidate_parameters_.push_back(values->candidate(id));
      maps_.push_back(&tangents.map(id));
      step_quads_.push_back(tangents.quad(id));
    }
  }
}

template <typename Evaluate>
EvaluationFailure LiveFamily::ForRuns(const std::vector<std::int32_t>& factors, Evaluate&& evaluate) {
  for (std::size_t k = 0; k < factors.size();) {
    std::size_t end = k + 1;
    while (end < factors.size() && factors[end] == factors[end - 1] + 1) {
      ++end;
    }
    const EvaluationFailure failure = evaluate(factors[k], factors[end - 1] + 1);
    if (failure.failed()) {
      return failure;
    }
    k = end;
  }
  return {};
}

EvaluationFailure LiveFamily::EvaluateCandidate(const std::vector<std::int32_t>& factors) {
  return ForRuns(factors, [&](int begin, int end) {
    FactorBatch batch;
    batch.begin = begin;
    batch.end = end;
    batch.parameters = candidate_parameters_.data();
    batch.residuals = candidate_f_.data();
    const EvaluationFailure failure = family_->Evaluate(batch);
    for (int i = begin; i < end && !failure.failed(); ++i) {
      candidate_cost_[i] =
          RobustCost(graph_->loss(id_, i), candidate_f_.data() + static_cast<std::ptrdiff_t>(i) * residual_size_, residual_size_);
    }
    return failure;
  });
}

EvaluationFailure LiveFamily::Linearise(const std::vector<std::int32_t>& factors) {
  return ForRuns(factors, [&](int begin, int end) {
    FactorBatch batch;
    batch.begin = begin;
    batch.end = end;
    batch.parameters = parameters_.data();
    batch.tangent_maps = maps_.data();
    batch.residuals = f_.data();
    batch.jacobians = views_.data();
    const EvaluationFailure failure = family_->Evaluate(batch);
    for (int i = begin; i < end && !failure.failed(); ++i) {
      Weigh(i);
    }
    return failure;
  });
}

// ρ, ρ' and ρ'' at the residual now.
void LiveFamily::EvaluateLoss(int factor, double rho[3]) const {
  const double* f = f_.data() + static_cast<std::ptrdiff_t>(factor) * residual_size_;
  double s = 0.0;
  for (int r = 0; r < residual_size_; ++r) {
    s += f[r] * f[r];
  }
  rho[0] = s;
  rho[1] = 1.0;
  rho[2] = 0.0;
  if (const Loss* loss = graph_->loss(id_, factor)) {
    loss->Evaluate(s, rho);
  }
}

// w = ρ'(‖f‖²) now: J := √w J, q := √w f.
void LiveFamily::Weigh(int factor) {
  const std::ptrdiff_t first = static_cast<std::ptrdiff_t>(factor) * residual_size_;
  for (int r = 0; r < residual_size_; ++r) {
    predicted_f_[first + r] = f_[first + r];
  }
  double rho[3];
  EvaluateLoss(factor, rho);
  const double sqrt_w = std::sqrt(rho[1]);
  sqrt_w_[factor] = sqrt_w;
  current_w_[factor] = rho[1];
  cost_[factor] = 0.5 * rho[0];
  for (int r = 0; r < residual_size_; ++r) {
    q_[first + r] = sqrt_w * f_[first + r];
  }
  if (sqrt_w == 1.0) {
    return;
  }
  for (int slot = 0; slot < num_slots_; ++slot) {
    double* J = slots_[slot].data + factor * slots_[slot].factor_stride;
    for (std::ptrdiff_t k = 0; k < slots_[slot].factor_stride; ++k) {
      J[k] *= sqrt_w;
    }
  }
}

double LiveFamily::PredictDecrease(int factor, const double* padded_step) {
  const std::ptrdiff_t first = static_cast<std::ptrdiff_t>(factor) * residual_size_;
  const std::int32_t* quads = step_quads_.data() + static_cast<std::ptrdiff_t>(factor) * num_slots_;
  double decrease = 0.0;
  for (int r = 0; r < residual_size_; ++r) {
    double sum = 0.0;
    for (int s = 0; s < num_slots_; ++s) {
      if (quads[s] < 0) {
        continue;
      }
      const double* row = Jacobian(factor, s) + static_cast<std::ptrdiff_t>(r) * slots_[s].row_stride;
      const double* step = padded_step + static_cast<std::ptrdiff_t>(quads[s]) * kQuad;
      for (int k = 0; k < slots_[s].columns; ++k) {
        sum += row[k] * step[k];
      }
    }
    J_step_[first + r] = sum;
    decrease -= sum * (q_[first + r] + 0.5 * sum);
  }
  return decrease;
}

void LiveFamily::Accept(int factor, double* q_change) {
  const std::ptrdiff_t first = static_cast<std::ptrdiff_t>(factor) * residual_size_;
  const double sqrt_w = sqrt_w_[factor];
  for (int r = 0; r < residual_size_; ++r) {
    predicted_f_[first + r] += sqrt_w > kNoWeight ? J_step_[first + r] / sqrt_w : 0.0;
    f_[first + r] = candidate_f_[first + r];
  }
  double rho[3];
  EvaluateLoss(factor, rho);
  cost_[factor] = 0.5 * rho[0];
  current_w_[factor] = rho[1];
  const double scale = sqrt_w > kNoWeight ? rho[1] / sqrt_w : 0.0;
  for (int r = 0; r < residual_size_; ++r) {
    const double new_q = scale * f_[first + r];
    q_change[r] = new_q - q_[first + r];
    q_[first + r] = new_q;
  }
}

double LiveFamily::SquaredError(int factor) const {
  const std::ptrdiff_t first = static_cast<std::ptrdiff_t>(factor) * residual_size_;
  double error = 0.0;
  for (int r = 0; r < residual_size_; ++r) {
    const double difference = f_[first + r] - predicted_f_[first + r];
    error += difference * difference;
  }
  return current_w_[factor] * error;
}

double LiveFamily::WeightRatio(int factor) const {
  const double w = sqrt_w_[factor] * sqrt_w_[factor];
  return w > kNoWeight * kNoWeight ? current_w_[factor] / w : (current_w_[factor] > 0.0 ? HUGE_VAL : 1.0);
}

}  // namespace inceres::internal
