#include "linear/conjugate_gradients.h"

#include <algorithm>
#include <cmath>

#include "simd/kernels.h"

namespace inceres::internal {

// Preconditioned conjugate gradients (Golub & Van Loan, section 11.5). Beside x the loop keeps the
// residual r = b − A x, z = M⁻¹r and the direction p. With α = rᵀz / pᵀAp a step x += α p raises
// the decrease bᵀx − ½xᵀAx by ½ α rᵀz. These gains tell callers when to stop (Hestenes & Stiefel
// 1952, theorem 6:1) without a look at the residual's norm.
//
// Vectors come in whole quads with zeros behind: sums may run over the padding. Products are told
// to subtract, since the kernels do; so −A p is what is computed, and r += α (−A p).
//
// A direction without curvature ends the iteration before x takes it, so that x remains what the
// directions before it have made of it. What is not a number is told apart from that: it says
// nothing about A.

namespace {

// Four sums, so that the compiler can keep them in one register: it may not reorder a sum by
// itself.
double Dot(const AlignedVector<double>& a, const AlignedVector<double>& b) {
  double sum[kQuad] = {};
  for (std::size_t k = 0; k < a.size(); k += kQuad) {
    for (int lane = 0; lane < kQuad; ++lane) {
      sum[lane] += a[k + lane] * b[k + lane];
    }
  }
  return (sum[0] + sum[1]) + (sum[2] + sum[3]);
}

// y += scale · x.
void Add(double scale, const AlignedVector<double>& x, AlignedVector<double>* y) {
  for (std::size_t k = 0; k < x.size(); ++k) {
    (*y)[k] += scale * x[k];
  }
}

}  // namespace

void ConjugateGradients::Resize(std::size_t size) {
  for (AlignedVector<double>* vector : {&b_, &x_, &r_, &z_, &p_, &minus_product_}) {
    vector->resize(size);
  }
}

void ConjugateGradients::StartFromZero() {
  std::fill(x_.begin(), x_.end(), 0.0);
  r_ = b_;
  decrease_ = 0.0;
}

void ConjugateGradients::StartFromX(const System& system) {
  r_ = b_;
  system.SubtractProduct(x_.data(), r_.data());
  // With r = b − A x this is bᵀx − ½xᵀAx, without another product.
  decrease_ = 0.5 * (Dot(b_, x_) + Dot(r_, x_));
  // An x that promises nothing, or is NaN, is worse than zero.
  if (!(decrease_ > 0.0)) {
    StartFromZero();
  }
}

// To the best x along p, and r there; or why x has not been changed.
std::optional<ConjugateGradients::End> ConjugateGradients::Step(const System& system,
                                                                int reset_period) {
  std::fill(minus_product_.begin(), minus_product_.end(), 0.0);
  system.SubtractProduct(p_.data(), minus_product_.data());
  // A NaN is neither below zero nor infinite and would go into x.
  curvature_ = -Dot(p_, minus_product_);
  if (std::isnan(curvature_) || std::isnan(rz_)) {
    return End::kBreakdown;
  }
  if (curvature_ <= 0.0 || std::isinf(curvature_)) {
    return End::kNotPositiveDefinite;
  }
  const double alpha = rz_ / curvature_;
  Add(alpha, p_, &x_);
  gains_.push_back(0.5 * alpha * rz_);
  // Ceres's habit: r computed from x, which costs another product, rids it of the rounding that
  // the recurrence has gathered.
  if (reset_period > 0 && static_cast<int>(gains_.size()) % reset_period == 0) {
    r_ = b_;
    system.SubtractProduct(x_.data(), r_.data());
  } else {
    Add(alpha, minus_product_, &r_);
  }
  decrease_ += gains_.back();
  return std::nullopt;
}

ConjugateGradients::End ConjugateGradients::Iterate(System* system, int max_iterations,
                                                    int reset_period) {
  gains_.clear();
  if (!system->Precondition(r_.data(), z_.data())) {
    return End::kNoPreconditioner;
  }
  p_ = z_;
  first_rz_ = rz_ = Dot(r_, z_);
  // b = 0, or x solves the system: the first α would be 0/0.
  bool converged = rz_ == 0.0;
  while (!converged) {
    if (static_cast<int>(gains_.size()) >= max_iterations) {
      return End::kTooLong;
    }
    const std::optional<End> end = Step(*system, reset_period);
    if (end) {
      return *end;
    }
    if (!system->Precondition(r_.data(), z_.data())) {
      return End::kNoPreconditioner;
    }
    const double last_rz = rz_;
    rz_ = Dot(r_, z_);
    // The decrease, the gains and rᵀz that the system looks at are those after this step.
    converged = rz_ == 0.0 || system->IsGoodEnough(*this);
    // Fletcher and Reeves's form: M is the same throughout, so zᵀ(r − r_last) is not needed.
    const double beta = rz_ / last_rz;
    for (std::size_t k = 0; k < p_.size(); ++k) {
      p_[k] = z_[k] + beta * p_[k];
    }
  }
  return End::kConverged;
}

std::size_t ConjugateGradients::Bytes() const {
  return (6 * x_.capacity() + gains_.capacity()) * sizeof(double);
}

}  // namespace inceres::internal
