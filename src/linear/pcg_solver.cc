#include "linear/pcg_solver.h"

#include <algorithm>
#include <limits>
#include <numeric>
#include <sstream>

namespace inceres::internal {
namespace {

constexpr int kMinWindow = 6;          // iterations the estimate of the error looks back
constexpr double kWindowShare = 0.25;  // or this share of the iterations so far: slow convergence has long plateaus

// Four sums, so that the compiler can keep them in one register: it may not reorder a sum by itself.
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

Status PcgSolver::Factorize(const SymmetricBlockRows& S, const double* damping, const char* held, const Change& change) {
  S_ = &S;
  work_ = Work();
  factored_ = preconditioner_.Update(S, damping, held, change);
  work_.factored_rows = preconditioner_.num_inverted();
  return factored_;
}

Status PcgSolver::Solve(const double* b, const Rows& /*changed_b*/, const Truncation& /*truncation*/, double* x) {
  if (!factored_.ok()) {
    return factored_;
  }
  const auto size = static_cast<std::size_t>(preconditioner_.padded_offsets().back());
  for (AlignedVector<double>* vector : {&r_, &z_, &minus_product_}) {
    vector->resize(size);
  }
  PadFree(b, &b_);
  PadFree(x, &x_);
  Start();
  const Status status = Iterate();
  if (status.ok()) {
    Unpad(x);
  }
  work_.iterations = static_cast<int>(gains_.size());
  work_.solved_rows = preconditioner_.num_rows();
  return status;
}

// From the given x if it promises a decrease, else from zero.
void PcgSolver::Start() {
  r_ = b_;
  SubtractProduct(x_.data(), r_.data());
  decrease_ = 0.5 * (Dot(b_, x_) + Dot(r_, x_));
  if (!(decrease_ > 0.0)) {
    std::fill(x_.begin(), x_.end(), 0.0);
    r_ = b_;
    decrease_ = 0.0;
  }
  gains_.clear();
}

Status PcgSolver::Iterate() {
  preconditioner_.Apply(r_.data(), z_.data());
  p_ = z_;
  double rz = Dot(r_, z_);
  work_.converged = rz == 0.0;
  while (!work_.converged && static_cast<int>(gains_.size()) < options_.max_iterations) {
    std::fill(minus_product_.begin(), minus_product_.end(), 0.0);
    SubtractProduct(p_.data(), minus_product_.data());
    const double curvature = -Dot(p_, minus_product_);
    if (!(curvature > 0.0)) {
      std::ostringstream text;
      text << "the reduced system is not positive definite: PCG met the curvature " << curvature << " at iteration "
           << gains_.size();
      return Status::Error(StatusCode::kSingular, text.str());
    }
    const double alpha = rz / curvature;
    Add(alpha, p_, &x_);
    Add(alpha, minus_product_, &r_);
    gains_.push_back(0.5 * alpha * rz);
    decrease_ += gains_.back();
    preconditioner_.Apply(r_.data(), z_.data());
    const double next_rz = Dot(r_, z_);
    work_.converged = next_rz == 0.0 || HasConverged();
    const double beta = next_rz / rz;
    for (std::size_t k = 0; k < p_.size(); ++k) {
      p_[k] = z_[k] + beta * p_[k];
    }
    rz = next_rz;
  }
  return Status::Ok();
}

bool PcgSolver::HasConverged() const {
  const auto count = static_cast<int>(gains_.size());
  const int window = std::max(kMinWindow, static_cast<int>(kWindowShare * count));
  const double recent = std::accumulate(gains_.end() - std::min(count, window), gains_.end(), 0.0);
  return count >= window && recent <= options_.relative_tolerance * options_.relative_tolerance * decrease_;
}

// y −= A v.
void PcgSolver::SubtractProduct(const double* v, double* y) const {
  const Kernels& kernels = BestKernels();
  const std::vector<int>& offsets = preconditioner_.padded_offsets();
  preconditioner_.SubtractProduct(v, y);
  for (int i = 0; i < S_->num_rows(); ++i) {
    if (!preconditioner_.IsFree(i)) {
      continue;
    }
    const int size = S_->size_of(i);
    for (const SymmetricBlockRows::Entry& entry : S_->row(i)) {
      const int j = entry.column;
      if (j == i || !preconditioner_.IsFree(j)) {
        continue;
      }
      // Stored by rows the block is its transpose stored by columns.
      const double* block = S_->values(entry.offset);
      const int stride = PadToQuad(S_->size_of(j));
      kernels.subtract_row_dots(size, 1, stride, block, stride, v + offsets[j], stride, y + offsets[i], 1);
      kernels.subtract_outer(stride, 1, size, block, stride, v + offsets[i], 1, y + offsets[j], stride);
    }
  }
}

void PcgSolver::PadFree(const double* packed, AlignedVector<double>* padded) const {
  const std::vector<int>& from = preconditioner_.packed_offsets();
  const std::vector<int>& to = preconditioner_.padded_offsets();
  padded->assign(to.back(), 0.0);
  for (int i = 0; i < preconditioner_.num_rows(); ++i) {
    if (preconditioner_.IsFree(i)) {
      std::copy(packed + from[i], packed + from[i + 1], padded->begin() + to[i]);
    }
  }
}

void PcgSolver::Unpad(double* packed) const {
  const std::vector<int>& to = preconditioner_.packed_offsets();
  for (int i = 0; i < preconditioner_.num_rows(); ++i) {
    std::copy_n(x_.begin() + preconditioner_.padded_offsets()[i], to[i + 1] - to[i], packed + to[i]);
  }
}

std::size_t PcgSolver::Bytes() const {
  std::size_t bytes = preconditioner_.Bytes() + gains_.capacity() * sizeof(double);
  for (const AlignedVector<double>* vector : {&b_, &x_, &r_, &z_, &p_, &minus_product_}) {
    bytes += vector->capacity() * sizeof(double);
  }
  return bytes;
}

}  // namespace inceres::internal
