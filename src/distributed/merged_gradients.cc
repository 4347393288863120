#include "distributed/merged_gradients.h"

#include <cmath>
#include <numeric>

namespace inceres::internal {
namespace {

constexpr int kResidualResetPeriod = 10;  // Ceres's

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
bool MergedGradients::ReduceDots(const std::vector<double>& r) {
  double dots[3] = {Dot(r, z_), Dot(z_, w_), Dot(z_, s_)};
  ranks_.SumAll(3, dots);
  rz_ = dots[0];
  zaz_ = dots[1];
  zap_ = dots[2];
  return !std::isnan(rz_) && !std::isnan(zaz_) && !std::isnan(zap_);
}

MergedGradients::End MergedGradients::Solve(const Limits& limits, const std::vector<double>& b,
                                            System* system, std::vector<double>* x) {
  const std::size_t size = b.size();
  x->assign(size, 0.0);
  r_ = b;
  for (std::vector<double>* vector : {&z_, &w_, &p_, &s_}) {
    vector->assign(size, 0.0);
  }
  double decrease = 0.0;
  double curvature = 0.0;
  double last_rz = 0.0;
  for (num_iterations_ = 0; num_iterations_ < limits.max_iterations;) {
    system->Precondition(r_.data(), z_.data());
    system->Multiply(z_.data(), w_.data());
    if (!ReduceDots(r_)) {
      ++num_iterations_;
      return End::kBreakdown;
    }
    if (rz_ == 0.0) {
      return End::kConverged;
    }
    const double beta = num_iterations_ == 0 ? 0.0 : rz_ / last_rz;
    curvature = zaz_ + 2.0 * beta * zap_ + beta * beta * curvature;
    if (std::isnan(curvature)) {
      ++num_iterations_;
      return End::kBreakdown;
    }
    if (curvature <= 0.0 || std::isinf(curvature)) {
      ++num_iterations_;
      return End::kNotPositiveDefinite;
    }
    ScaleAndAdd(z_, beta, &p_);
    ScaleAndAdd(w_, beta, &s_);
    const double alpha = rz_ / curvature;
    const double gain = 0.5 * alpha * rz_;
    Add(alpha, p_, x);
    last_rz = rz_;
    decrease += gain;
    ++num_iterations_;
    if (num_iterations_ >= limits.min_iterations &&
        num_iterations_ * gain / decrease < limits.eta) {
      return decrease > 0.0 ? End::kConverged : End::kBreakdown;
    }
    if (num_iterations_ % kResidualResetPeriod == 0) {
      system->Multiply(x->data(), w_.data());
      for (std::size_t k = 0; k < size; ++k) {
        r_[k] = b[k] - w_[k];
      }
    } else {
      Add(-alpha, s_, &r_);
    }
  }
  return End::kTooLong;
}

}  // namespace inceres::internal
