#include "trust_region/dogleg.h"

#include <algorithm>
#include <cmath>

namespace inceres::internal {

// Powell's dog-leg as in Ceres 2.1's DoglegStrategy (docs/algorithms.md, "Dog-leg", and
// docs/ceres_contract.md, "Dog-Leg"), in unscaled variables with the metric w = D/s. After a
// rejected step only the radius changes: gradient, Gauss–Newton step and plane are kept (reuse_),
// and the next step costs no linear solve. μ regularizes the Gauss–Newton system and has nothing
// to do with the radius.

namespace {

constexpr double kMinMu = 1e-8;
constexpr double kMaxMu = 1.0;
constexpr double kMuIncrease = 10.0;
constexpr double kShrinkBelow = 0.25;
constexpr double kGrowAbove = 0.75;

double Norm(const LinearModel& model, const std::vector<double>& a) {
  return std::sqrt(model.Dot(a, a));
}

}  // namespace

// Memory of an earlier solve is kept, its numbers are not.
void Dogleg::Start(const SolverOptions& options, const std::vector<double>& scale) {
  scale_ = &scale;
  radius_ = options.initial_trust_region_radius;
  min_diagonal_ = options.min_lm_diagonal;
  max_diagonal_ = options.max_lm_diagonal;
  mu_ = kMinMu;
  reuse_ = false;
  // Taken over with their memory; values are written before they are read.
  for (std::vector<double>* vector : {&w_, &gradient_, &gauss_newton_, &scratch_, &p_}) {
    vector->resize(scale.size());
  }
  subspace_.reset();
  if (options.strategy == TrustRegionStrategyKind::kSubspaceDogleg) {
    subspace_.emplace();
  }
}

// The work of a point is done once; what remains is to choose a point within the radius.
Status Dogleg::ComputeStep(LinearModel* model, double* step, int* num_solves) {
  if (!reuse_) {
    reuse_ = true;
    const std::vector<double>& H_diagonal = model->Diagonal();
    const std::vector<double>& scale = *scale_;
    // w_j² = clamp(s_j² H_jj) / s_j².
    for (std::size_t j = 0; j < w_.size(); ++j) {
      w_[j] =
          std::sqrt(std::clamp(scale[j] * scale[j] * H_diagonal[j], min_diagonal_, max_diagonal_)) /
          scale[j];
    }
    ComputeGradient(*model);
    const Status solved = ComputeGaussNewtonStep(model, num_solves);
    if (!solved.ok()) {
      return solved;
    }
    // Three more passes over J, in the subspace variant only.
    if (subspace_ && !subspace_->Build(w_, gradient_, gauss_newton_, model)) {
      return Status::Error(StatusCode::kSingular,
                           "both the gradient and the Gauss-Newton step are zero");
    }
  }
  ChooseWithinRadius(model, step);
  return Status::Ok();
}

// g̃ = g/w; a new point has another Cauchy step.
void Dogleg::ComputeGradient(const LinearModel& model) {
  const std::vector<double>& g = model.Gradient();
  std::transform(g.begin(), g.end(), w_.begin(), gradient_.begin(), std::divides<>());
  alpha_.reset();
}

// Of a Gauss–Newton step inside the radius nobody asks for it, and it takes a pass over the
// Jacobians.
double Dogleg::CauchyStep(LinearModel* model) {
  if (!alpha_) {
    std::transform(gradient_.begin(), gradient_.end(), w_.begin(), scratch_.begin(),
                   std::divides<>());
    // α = ‖g̃‖² / ‖J w⁻¹ g̃‖²: the minimum of the model along −g̃.
    alpha_ = model->Dot(gradient_, gradient_) / model->Quadratic(scratch_.data());
  }
  return *alpha_;
}

// (H + μ w²) δ_gn = −g; μ grows tenfold until there is a factor and a finite step, and stays there
// until a step is accepted.
Status Dogleg::ComputeGaussNewtonStep(LinearModel* model, int* num_solves) {
  // Invalid steps before have raised it that far.
  if (mu_ >= kMaxMu) {
    return Status::Error(StatusCode::kSingular,
                         "the Gauss-Newton system stays singular up to the largest regularization");
  }
  Status solved;
  while (mu_ < kMaxMu) {
    for (std::size_t j = 0; j < w_.size(); ++j) {
      scratch_[j] = mu_ * w_[j] * w_[j];
    }
    ++*num_solves;
    solved = model->Solve(scratch_.data(), gauss_newton_.data());
    if (solved.ok() && model->IsFinite(gauss_newton_)) {
      for (std::size_t j = 0; j < w_.size(); ++j) {
        // In the metric from here on: w δ_gn.
        gauss_newton_[j] *= w_[j];
      }
      return solved;
    }
    // Anything but a singular system is no matter of regularization.
    if (!solved.ok() && solved.code != StatusCode::kSingular) {
      return solved;
    }
    mu_ *= kMuIncrease;
  }
  if (solved.ok()) {
    solved = Status::Error(StatusCode::kSingular, "the Gauss-Newton step is not finite");
  }
  return solved;
}

// Inside the radius the Gauss–Newton step; else the minimum in the plane on the sphere, if there
// is one; else the traditional path.
void Dogleg::ChooseWithinRadius(LinearModel* model, double* step) {
  gauss_newton_norm_ = Norm(*model, gauss_newton_);
  step_norm_ = gauss_newton_norm_;
  // Inside: no path is needed, and nothing of the Cauchy point.
  if (step_norm_ <= radius_) {
    p_ = gauss_newton_;
  } else if (subspace_ && subspace_->MinimizeOnBoundary(radius_, gradient_, p_.data())) {
    // The root may be off the sphere a little; the radius is what Ceres takes for its length.
    step_norm_ = radius_;
  } else {
    FollowTraditionalPath(CauchyStep(model), *model);
  }
  // δ = p/w.
  std::transform(p_.begin(), p_.end(), w_.begin(), step, std::divides<>());
}

// The dog-leg point: from zero to the Cauchy point a, on toward the Gauss–Newton point b, which
// lies outside, up to where this path leaves the sphere.
void Dogleg::FollowTraditionalPath(double alpha, const LinearModel& model) {
  const double gradient_norm = Norm(model, gradient_);
  // The Cauchy point lies on the sphere or outside: the gradient's direction, cut.
  if (gradient_norm * alpha >= radius_) {
    std::transform(gradient_.begin(), gradient_.end(), p_.begin(),
                   [&](double g) { return -radius_ / gradient_norm * g; });
    step_norm_ = radius_;
    return;
  }
  // aᵀb with a = −α g̃, and ‖b − a‖² from norms that are known.
  const double b_dot_a = -alpha * model.Dot(gradient_, gauss_newton_);
  const double a2 = std::pow(alpha * gradient_norm, 2);
  const double b_minus_a2 = a2 - 2.0 * b_dot_a + gauss_newton_norm_ * gauss_newton_norm_;
  const double beta = DoglegShare(radius_ * radius_, a2, b_dot_a - a2, b_minus_a2);
  for (std::size_t j = 0; j < p_.size(); ++j) {
    // (1 − β) a + β b.
    p_[j] = -alpha * (1.0 - beta) * gradient_[j] + beta * gauss_newton_[j];
  }
  step_norm_ = Norm(model, p_);
}

// The regularization of the Gauss–Newton system, in the metric.
double Dogleg::HeldBack(const LinearModel& /*model*/, const std::vector<double>& /*step*/) {
  return gauss_newton_norm_ <= radius_ ? mu_ * gauss_newton_norm_ * gauss_newton_norm_ : HUGE_VAL;
}

// A Gauss–Newton step that could be used again is found again.
bool Dogleg::Restore(const std::vector<double>& saved) {
  if (saved.size() != Save().size()) {
    return false;
  }
  radius_ = saved[0];
  mu_ = saved[1];
  reuse_ = false;
  return true;
}

// As Ceres dumps it: the Gauss–Newton step with its sign turned.
void Dogleg::GetLastSolve(std::vector<double>* damping, std::vector<double>* solution) const {
  damping->resize(w_.size());
  for (std::size_t j = 0; j < w_.size(); ++j) {
    (*damping)[j] = mu_ * w_[j] * w_[j];
    (*solution)[j] = -gauss_newton_[j] / w_[j];
  }
}

void Dogleg::StepAccepted(double quality) {
  // Between the two the radius stays.
  if (quality < kShrinkBelow) {
    radius_ *= 0.5;
  }
  if (quality > kGrowAbove) {
    radius_ = std::max(radius_, 3.0 * step_norm_);
  }
  // Divided by 5, as in Ceres.
  mu_ = std::max(kMinMu, 2.0 * mu_ / kMuIncrease);
  reuse_ = false;
}

// The same point again: reuse_ spares the linear solve.
void Dogleg::StepRejected() {
  radius_ *= 0.5;
  reuse_ = true;
}

// The same radius and more regularization, and everything anew.
void Dogleg::StepIsInvalid() {
  mu_ *= kMuIncrease;
  reuse_ = false;
}

}  // namespace inceres::internal
