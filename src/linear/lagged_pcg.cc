#include "linear/lagged_pcg.h"

#include <algorithm>
#include <cstddef>
#include <numeric>
#include <utility>

#include "linear/select_solver.h"

namespace inceres::internal {
namespace {

double Dot(const std::vector<double>& a, const std::vector<double>& b) {
  return std::inner_product(a.begin(), a.end(), b.begin(), 0.0);
}

}  // namespace

LaggedPcg::LaggedPcg(const Executor& executor, const BlockPattern& pattern, std::unique_ptr<ReducedSolver> factor)
    : executor_(executor), factor_(std::move(factor)) {
  Prepare(pattern);
}

void LaggedPcg::Prepare(const BlockPattern& pattern) {
  pattern_ = &pattern;
  factored_ = false;
  num_iterations_ = num_factorizations_ = 0;
  values_.resize(pattern.value_begin.back());
  diagonal_.resize(pattern.size());
  for (std::vector<double>* vector : {&r_, &z_, &p_, &q_}) {
    vector->resize(pattern.size());
  }
}

Status LaggedPcg::Analyze(const BlockPattern& pattern) {
  Prepare(pattern);
  Status status;
  factor_ = MakeReducedSolver(ReducedSolverKind::kAutomatic, nullptr, pattern, executor_, &status);
  return status;
}

Status LaggedPcg::Factorize(const double* values, const double* diagonal) {
  std::copy_n(values, values_.size(), values_.begin());
  std::copy_n(diagonal, diagonal_.size(), diagonal_.begin());
  return factored_ && num_iterations_ <= kRenewAfter ? Status::Ok() : Renew();
}

Status LaggedPcg::Renew() {
  ++num_factorizations_;
  const Status status = factor_->Factorize(values_.data(), diagonal_.data());
  factored_ = status.ok();
  num_iterations_ = 0;
  return status;
}

Status LaggedPcg::Solve(const double* b, double* x) {
  if (!factored_) {
    return Status::Error(StatusCode::kSingular, "the reduced system is not factored");
  }
  if (!Iterate(b, x)) {
    const Status status = Renew();
    return status.ok() ? factor_->Solve(b, x) : status;
  }
  return Status::Ok();
}

bool LaggedPcg::Iterate(const double* b, double* x) {
  std::copy_n(b, r_.size(), r_.begin());
  std::fill_n(x, r_.size(), 0.0);
  num_iterations_ = 0;
  if (!factor_->Solve(r_.data(), z_.data()).ok()) {
    return false;
  }
  p_ = z_;
  double rz = Dot(r_, z_);
  const double enough = kTolerance * kTolerance * rz;
  while (rz > enough) {
    if (num_iterations_ == kMaxIterations) {
      return false;
    }
    ++num_iterations_;
    Multiply(p_.data(), q_.data());
    const double curvature = Dot(p_, q_);
    if (!(curvature > 0.0)) {
      return false;
    }
    const double alpha = rz / curvature;
    for (std::size_t k = 0; k < r_.size(); ++k) {
      x[k] += alpha * p_[k];
      r_[k] -= alpha * q_[k];
    }
    if (!factor_->Solve(r_.data(), z_.data()).ok()) {
      return false;
    }
    const double next_rz = Dot(r_, z_);
    const double beta = next_rz / rz;
    for (std::size_t k = 0; k < p_.size(); ++k) {
      p_[k] = z_[k] + beta * p_[k];
    }
    rz = next_rz;
  }
  return rz >= 0.0;  // not NaN, and M was positive definite
}

void LaggedPcg::Multiply(const double* v, double* y) const {
  for (int k = 0; k < pattern_->size(); ++k) {
    y[k] = diagonal_[k] * v[k];
  }
  for (int i = 0; i < pattern_->num_blocks(); ++i) {
    const int top = pattern_->offsets[i];
    for (int k = pattern_->row_begin[i]; k < pattern_->row_begin[i + 1]; ++k) {
      const int j = pattern_->columns[k];
      const int left = pattern_->offsets[j], columns = pattern_->block_size(j);
      const double* row = values_.data() + pattern_->value_begin[k];
      for (int r = 0; r < pattern_->block_size(i); ++r, row += columns) {
        // Of a diagonal block the lower triangle counts, its diagonal once.
        const int count = i == j ? r : columns;
        double sum = i == j ? row[r] * v[top + r] : 0.0;
        for (int c = 0; c < count; ++c) {
          sum += row[c] * v[left + c];
          y[left + c] += row[c] * v[top + r];
        }
        y[top + r] += sum;
      }
    }
  }
}

}  // namespace inceres::internal
