#include <cmath>
#include <numeric>

#include "distributed/reduced_system.h"

namespace inceres::internal {

// The solver for kConjugateGradients: S stays implicit, each rank multiplies by its own C − Y Yᵀ,
// taken from the Jacobians, and the preconditioner is made anew for each step, since damping
// changes it.
//
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
// own. The iterates are those of ConjugateGradients but for rounding, and so is the rule to stop
// by: Ceres's, with the residual computed anew every ten iterations. Source: Chronopoulos & Gear,
// "s-step iterative methods for symmetric linear systems", 1989.
//
// Cost of an iteration: a product, a preconditioning, a reduction of three numbers.
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

Status Breakdown() {
  return Status::Error(StatusCode::kSingular,
                       "conjugate gradients: the residual or a curvature is zero or no number");
}

class MergedGradients final : public DistributedReducedSolver {
 public:
  MergedGradients(const ConjugateGradientsOptions& options, ReducedSystem* system)
      : options_(options), system_(*system) {}

  const char* Name() const override {
    return options_.preconditioner == PreconditionerKind::kTwoLevel
               ? "conjugate gradients on the reduced system, by products, two-level"
               : "conjugate gradients on the reduced system, by products, one reduction an "
                 "iteration";
  }
  Status Solve(const std::vector<double>& b, std::vector<double>* x) override;
  int num_iterations() const override { return num_iterations_; }

 private:
  // What looking for the next direction has led to.
  enum class Direction { kFound, kNotNeeded, kNotPositiveDefinite, kBreakdown };

  bool ReduceDots();
  Direction FindDirection();
  void ComputeResidual(const std::vector<double>& b, const std::vector<double>& x);

  const ConjugateGradientsOptions options_;
  ReducedSystem& system_;
  std::vector<double> r_;
  std::vector<double> z_;
  std::vector<double> p_;
  std::vector<double> w_;  // A z
  std::vector<double> s_;  // A p
  double rz_ = 0.0;
  double zaz_ = 0.0;
  double zap_ = 0.0;
  double curvature_ = 0.0;  // pᵀA p
  int num_iterations_ = 0;
};

// The one reduction of an iteration. False if a number is none.
bool MergedGradients::ReduceDots() {
  double dots[3] = {Dot(r_, z_), Dot(z_, w_), Dot(z_, s_)};
  system_.parts().ranks.SumAll(3, dots);
  rz_ = dots[0];
  zaz_ = dots[1];
  zap_ = dots[2];
  return !std::isnan(rz_) && !std::isnan(zaz_) && !std::isnan(zap_);
}

// The next direction p, with s = A p and its curvature. In exact arithmetic the recurrence of the
// curvature has pᵀA p of the last direction.
MergedGradients::Direction MergedGradients::FindDirection() {
  const double last_rz = rz_;
  system_.Precondition(r_.data(), z_.data());
  system_.Multiply(z_.data(), w_.data());
  if (!ReduceDots()) {
    return Direction::kBreakdown;
  }
  // b = 0, or x solves the system: β and α would be 0/0.
  if (rz_ == 0.0) {
    return Direction::kNotNeeded;
  }
  // Fletcher and Reeves's form; zero makes the first direction z, whatever p and s hold.
  const double beta = num_iterations_ == 0 ? 0.0 : rz_ / last_rz;
  curvature_ = zaz_ + 2.0 * beta * zap_ + beta * beta * curvature_;
  if (std::isnan(curvature_)) {
    return Direction::kBreakdown;
  }
  if (curvature_ <= 0.0 || std::isinf(curvature_)) {
    return Direction::kNotPositiveDefinite;
  }
  ScaleAndAdd(z_, beta, &p_);
  ScaleAndAdd(w_, beta, &s_);
  return Direction::kFound;
}

// r = b − A x anew, for another product: without it the r of the recurrence drifts away from it. w
// is free until the next product.
void MergedGradients::ComputeResidual(const std::vector<double>& b, const std::vector<double>& x) {
  system_.Multiply(x.data(), w_.data());
  for (std::size_t k = 0; k < b.size(); ++k) {
    r_[k] = b[k] - w_[k];
  }
}

// A step that took too many iterations, or met a direction without curvature, is as good as any: x
// is what the directions before have made of it. x starts from zero in each step, as Ceres's does.
Status MergedGradients::Solve(const std::vector<double>& b, std::vector<double>* x) {
  const Status prepared = system_.Prepare(options_.preconditioner);
  if (!prepared.ok()) {
    return prepared;
  }
  const std::size_t size = b.size();
  x->assign(size, 0.0);
  r_ = b;
  for (std::vector<double>* vector : {&z_, &w_, &p_, &s_}) {
    vector->assign(size, 0.0);
  }
  curvature_ = 0.0;
  // Σ ½ α rᵀz: how far bᵀx − ½ xᵀA x has risen, which is what the stopping rule compares.
  double decrease = 0.0;
  for (num_iterations_ = 0; num_iterations_ < options_.max_iterations;) {
    const Direction direction = FindDirection();
    // Where x solves the system there was nothing for another iteration to do.
    num_iterations_ += direction == Direction::kNotNeeded ? 0 : 1;
    if (direction != Direction::kFound) {
      return direction == Direction::kBreakdown ? Breakdown() : Status::Ok();
    }
    // The step along p raises the decrease by α rᵀz − ½ α² pᵀA p = ½ α rᵀz.
    const double alpha = rz_ / curvature_;
    const double gain = 0.5 * alpha * rz_;
    Add(alpha, p_, x);
    decrease += gain;
    // Ceres's rule with Q = −decrease: i (Q_i − Q_{i−1}) / Q_i < η.
    if (num_iterations_ >= options_.min_iterations &&
        num_iterations_ * gain / decrease < options_.eta) {
      return decrease > 0.0 ? Status::Ok() : Breakdown();
    }
    if (num_iterations_ % kResidualResetPeriod == 0) {
      ComputeResidual(b, *x);
    } else {
      Add(-alpha, s_, &r_);
    }
  }
  return Status::Ok();
}

}  // namespace

std::unique_ptr<DistributedReducedSolver> MakeMergedGradients(
    const ConjugateGradientsOptions& options, ReducedSystem* system) {
  return std::make_unique<MergedGradients>(options, system);
}

}  // namespace inceres::internal
