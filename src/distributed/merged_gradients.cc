#include "distributed/merged_gradients.h"

#include <cmath>
#include <numeric>

namespace inceres::internal {

// Preconditioned conjugate gradients on A x = b with one reduction an iteration. The usual form
// needs pᵀAp before the step and rᵀz after it, and each of the two waits for all ranks. Here A is
// applied to z = M⁻¹r instead of p, and the rest follows by recurrences:
//
//     p := z + β p,   s := A z + β s = A p,   β = rᵀz / (rᵀz)_last
//     pᵀA p = zᵀA z + 2 β zᵀA p_last + β² p_lastᵀA p_last
//
// since A is symmetric. rᵀz, zᵀAz and zᵀA p_last = zᵀs need r, z, A z and s only, so they are
// summed together. Chronopoulos & Gear take zᵀA p_last from β and rᵀz, by the orthogonality of
// residuals, which rounding and an r that is computed anew both disturb; here it is a sum of its
// own.
//
// Delicate: s and the curvature are only as good as their recurrences. A curvature that is not
// positive ends the iteration before x takes the direction. All ranks decide by the same bits
// (Communicator::SumAll). The vectors stay allocated between solves, their contents do not matter.

namespace {

constexpr int kResidualResetPeriod = 10;  // Ceres's

// Of the entries owned here, in their order. Each entry is owned once, so the sum over ranks counts
// each once.
double Dot(const std::vector<double>& a, const std::vector<double>& b) {
  return std::inner_product(a.begin(), a.end(), b.begin(), 0.0);
}

// y := x + scale · y.
void ScaleAndAdd(const std::vector<double>& x, double scale, std::vector<double>* y) {
  for (std::size_t k = 0; k < x.size(); ++k) {
    (*y)[k] = x[k] + scale * (*y)[k];
  }
}

// y += scale · x.
void Add(double scale, const std::vector<double>& x, std::vector<double>* y) {
  for (std::size_t k = 0; k < x.size(); ++k) {
    (*y)[k] += scale * x[k];
  }
}

}  // namespace

// False if a number is none.
// The one reduction of an iteration.
bool MergedGradients::ReduceDots(const std::vector<double>& r) {
  double dots[3] = {Dot(r, z_), Dot(z_, w_), Dot(z_, s_)};
  ranks_.SumAll(3, dots);
  rz_ = dots[0];
  zaz_ = dots[1];
  zap_ = dots[2];
  return !std::isnan(rz_) && !std::isnan(zaz_) && !std::isnan(zap_);
}

// The next direction p, with s = A p and its curvature, or why there is none. In exact arithmetic
// the recurrence of the curvature has pᵀA p of the last direction.
std::optional<MergedGradients::End> MergedGradients::Turn(System* system) {
  const double last_rz = rz_;
  system->Precondition(r_.data(), z_.data());
  system->Multiply(z_.data(), w_.data());
  if (!ReduceDots(r_)) {
    return End::kBreakdown;
  }
  // b = 0, or x solves the system: β and α would be 0/0.
  if (rz_ == 0.0) {
    return End::kConverged;
  }
  // Fletcher and Reeves's form; zero makes the first direction z, whatever p and s hold.
  const double beta = num_iterations_ == 0 ? 0.0 : rz_ / last_rz;
  curvature_ = zaz_ + 2.0 * beta * zap_ + beta * beta * curvature_;
  if (std::isnan(curvature_)) {
    return End::kBreakdown;
  }
  // x stays what the directions before have made of it, and the caller takes it as a step.
  if (curvature_ <= 0.0 || std::isinf(curvature_)) {
    return End::kNotPositiveDefinite;
  }
  ScaleAndAdd(z_, beta, &p_);
  ScaleAndAdd(w_, beta, &s_);
  return std::nullopt;
}

// r = b − A x anew, for another product: without it the r of the recurrence drifts away from it. w
// is free until the next product.
void MergedGradients::ComputeResidual(const std::vector<double>& b, const std::vector<double>& x,
                                      System* system) {
  system->Multiply(x.data(), w_.data());
  for (std::size_t k = 0; k < b.size(); ++k) {
    r_[k] = b[k] - w_[k];
  }
}

// What it returns is the same on all ranks; x is the iterate so far, unless the end is a breakdown.
MergedGradients::End MergedGradients::Solve(const Limits& limits, const std::vector<double>& b,
                                            System* system, std::vector<double>* x) {
  const std::size_t size = b.size();
  x->assign(size, 0.0);
  r_ = b;
  for (std::vector<double>* vector : {&z_, &w_, &p_, &s_}) {
    vector->assign(size, 0.0);
  }
  curvature_ = 0.0;
  // Σ ½ α rᵀz: how far bᵀx − ½ xᵀA x has risen, which is what the stopping rule compares.
  double decrease = 0.0;
  for (num_iterations_ = 0; num_iterations_ < limits.max_iterations;) {
    const std::optional<End> end = Turn(system);
    if (end) {
      // Where it has converged there was nothing for another iteration to do.
      num_iterations_ += *end == End::kConverged ? 0 : 1;
      return *end;
    }
    // The step along p raises the decrease by α rᵀz − ½ α² pᵀA p = ½ α rᵀz.
    const double alpha = rz_ / curvature_;
    const double gain = 0.5 * alpha * rz_;
    Add(alpha, p_, x);
    decrease += gain;
    ++num_iterations_;
    // Ceres's rule with Q = −decrease: i (Q_i − Q_{i−1}) / Q_i < η.
    if (num_iterations_ >= limits.min_iterations &&
        num_iterations_ * gain / decrease < limits.eta) {
      return decrease > 0.0 ? End::kConverged : End::kBreakdown;
    }
    if (num_iterations_ % kResidualResetPeriod == 0) {
      ComputeResidual(b, *x, system);
    } else {
      Add(-alpha, s_, &r_);
    }
  }
  return End::kTooLong;
}

}  // namespace inceres::internal
