#include "trust_region/levenberg_marquardt.h"

#include <algorithm>
#include <cmath>
#include <utility>

namespace inceres::internal {
namespace {

// Damping of exact mode, and Marquardt's rule for one-time solves (docs/algorithms.md, "One-time
// solves and exact windows"; docs/ceres_contract.md, "Levenberg–Marquardt"). In both the radius is
// one over the damping of the scaled columns. J is never scaled: the damping is divided by s²
// instead.

// Marquardt's rule. Where a refusal tells that steps cannot be longer, the radius grows more slowly
// from then on, until so many steps in a row are taken.
constexpr double kTenfold = 10.0;
constexpr double kLeastGrowth = 1.05;
constexpr double kKeptPromise = 0.25;
constexpr int kStepsInRow = 4;

// Doubled by each refusal in a row.
constexpr double kFirstDecrease = 2.0;

// Times the damping of an entry that is held: what is left of its step is rounding.
constexpr double kHolds = 1e30;

}  // namespace

void LevenbergMarquardt::Start(const SolverOptions& options, const std::vector<double>& scale) {
  tenfold_ = options.strategy == TrustRegionStrategyKind::kMarquardt;
  scale_ = &scale;
  radius_ = options.initial_trust_region_radius;
  radius_before_ = 0.0;
  is_new_width_ = false;
  max_radius_ = options.max_trust_region_radius;
  min_diagonal_ = options.min_lm_diagonal;
  max_diagonal_ = options.max_lm_diagonal;
  decrease_factor_ = kFirstDecrease;
  growth_ = kTenfold;
  num_accepted_in_row_ = 0;
  held_.clear();
  damping_.resize(scale.size());
}

// LM damping: Λ_j = clamp(s_j² H_jj) / (r s_j²). The clamp sees the scaled column, as in Ceres; the
// division by s² takes the damping back to the unscaled one.
double LevenbergMarquardt::DampingAt(double s, double H_jj) const {
  const double s2 = s * s;
  return std::clamp(s2 * H_jj, min_diagonal_, max_diagonal_) / (radius_ * s2);
}

Status LevenbergMarquardt::ComputeStep(LinearModel* model, double* step, int* num_solves) {
  const std::vector<double>& H_diagonal = model->Diagonal();
  for (std::size_t j = 0; j < damping_.size(); ++j) {
    damping_[j] = DampingAt((*scale_)[j], H_diagonal[j]);
  }
  for (std::size_t j = 0; j < held_.size(); ++j) {
    damping_[j] *= held_[j] != 0 ? kHolds : 1.0;
  }
  ++*num_solves;
  const Status solved = model->Solve(damping_.data(), step);
  for (std::size_t j = 0; j < held_.size(); ++j) {
    step[j] = held_[j] != 0 ? 0.0 : step[j];
  }
  return solved;
}

// A column whose scale was taken where it was far longer, and which is clamped by that, has more
// damping than a solve that begins here would give it, and would go as many times further.
double LevenbergMarquardt::HeldBack(const LinearModel& model, const std::vector<double>& step) {
  const std::vector<double>& H_diagonal = model.Diagonal();
  damped_step_.resize(step.size());
  for (std::size_t j = 0; j < step.size(); ++j) {
    damped_step_[j] = damping_[j] * step[j];
    if ((*scale_)[j] * (*scale_)[j] * H_diagonal[j] < min_diagonal_) {
      const double anew = DampingAt(1.0 / (1.0 + std::sqrt(H_diagonal[j])), H_diagonal[j]);
      damped_step_[j] *= std::max(1.0, damping_[j] / anew);
    }
  }
  return model.Dot(damped_step_, step);
}

std::vector<double> LevenbergMarquardt::Save() const {
  return {radius_,        decrease_factor_,
          growth_,        static_cast<double>(num_accepted_in_row_),
          radius_before_, is_new_width_ ? 1.0 : 0.0};
}

// All of it: without what Widen changed, a refusal that follows would shrink the wide radius
// instead of taking it back, and a solve that is resumed would not go on as the first one did.
bool LevenbergMarquardt::Restore(const std::vector<double>& saved) {
  if (saved.size() != Save().size()) {
    return false;
  }
  radius_ = saved[0];
  decrease_factor_ = saved[1];
  growth_ = saved[2];
  num_accepted_in_row_ = static_cast<int>(saved[3]);
  radius_before_ = saved[4];
  is_new_width_ = saved[5] != 0.0;
  return true;
}

// The radius before is remembered until two steps were taken: a refusal before that restores it.
void LevenbergMarquardt::Widen(double radius) {
  if (radius > radius_) {
    radius_before_ = radius_;
    radius_ = radius;
    is_new_width_ = true;
  }
}

void LevenbergMarquardt::Restart(double radius) {
  if (radius == 0.0) {
    return;
  }
  radius_ = std::min(radius, max_radius_);
  radius_before_ = 0.0;
  is_new_width_ = false;
  decrease_factor_ = kFirstDecrease;
  growth_ = kTenfold;
  num_accepted_in_row_ = 0;
}

void LevenbergMarquardt::StepAccepted(double quality) {
  if (!std::exchange(is_new_width_, false)) {  // one step does not prove it
    radius_before_ = 0.0;
  }
  double shrinking = 1.0;  // of the damping
  if (!tenfold_) {
    // Nielsen's rule: at best a third of the damping.
    shrinking = std::max(1.0 / 3.0, 1.0 - std::pow(2.0 * quality - 1.0, 3));
  } else if (quality > kKeptPromise) {
    // Growth comes back squared after every few steps in a row, up to tenfold.
    growth_ =
        ++num_accepted_in_row_ % kStepsInRow == 0 ? std::min(kTenfold, growth_ * growth_) : growth_;
    shrinking = 1.0 / growth_;
  }
  radius_ = std::min(max_radius_, radius_ / shrinking);
  decrease_factor_ = kFirstDecrease;
}

// After an invalid step as well.
void LevenbergMarquardt::StepRejected() {
  // Nothing is learned of the old radius.
  if (radius_before_ > 0.0) {
    radius_ = std::exchange(radius_before_, 0.0);
    is_new_width_ = false;
    return;
  }
  if (tenfold_) {
    // The first refusal in a row goes back ten times; one after steps that were taken undoes the
    // last growth.
    radius_ /= num_accepted_in_row_ == 0 ? kTenfold : growth_;
    // The root, once a row: the next growth is slower, so that radii that are refused are not tried
    // again and again.
    if (decrease_factor_ == kFirstDecrease) {
      growth_ = std::max(kLeastGrowth, std::sqrt(growth_));
    }
    num_accepted_in_row_ = 0;
  } else {
    radius_ /= decrease_factor_;
  }
  decrease_factor_ *= 2.0;
}

}  // namespace inceres::internal
