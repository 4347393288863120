#include <algorithm>
#include <cmath>
#include <vector>

#include "inceres/problem/manifolds.h"

// The default of Manifold::Minus, for a manifold of a user that only has Plus. It solves x ⊞ δ = y
// for δ from δ = 0: Newton's method, with D = ∂(x ⊞ δ)/∂δ by central differences at each step. D is
// ambient × tangent, so a step is the least-squares solution; at the solution the residual is zero,
// and the rate of convergence does not suffer. It looks near zero only: q and −q are two points to
// it.

namespace inceres {
namespace {

// x ⊞ δ = y by Newton's method: the search for a manifold that knows Plus only.
class MinusSearch {
 public:
  MinusSearch(const Manifold& manifold, const double* y, const double* x)
      : manifold_(manifold),
        y_(y),
        x_(x),
        rows_(static_cast<std::size_t>(manifold.AmbientSize())),
        columns_(static_cast<std::size_t>(manifold.TangentSize())),
        r_(rows_),
        backward_(rows_),
        D_(columns_, std::vector<double>(rows_)) {}

  // The best point is kept, for the last step may lead away from it.
  bool Run(double* delta) {
    constexpr int kMaxSteps = 50;
    std::fill_n(delta, columns_, 0.0);
    double best = HUGE_VAL;
    std::vector<double> found(columns_, 0.0);
    for (int step = 0; step < kMaxSteps; ++step) {
      const double distance = Distance(delta);
      if (!(distance < best)) {
        break;  // as near as rounding lets it come, or astray
      }
      best = distance;
      std::copy_n(delta, columns_, found.begin());
      // An exact hit, or Plus fails beside it: there is nothing more to gain.
      if (distance == 0.0 || !Step(delta)) {
        break;
      }
    }
    std::copy(found.begin(), found.end(), delta);
    // Relative to the largest value of y, or to 1: a point that is not on the manifold has no δ,
    // and is not taken for one that is merely badly solved.
    double scale = 1.0;
    for (std::size_t r = 0; r < rows_; ++r) {
      scale = std::max(scale, std::fabs(y_[r]));
    }
    return best <= 1e-12 * scale;
  }

 private:
  // r := y − x ⊞ δ; its norm.
  double Distance(const double* delta) {
    // Plus may refuse: a point where x ⊞ δ is not defined is infinitely far away.
    if (!manifold_.Plus(x_, delta, r_.data())) {
      return HUGE_VAL;
    }
    double sum = 0.0;
    for (std::size_t r = 0; r < rows_; ++r) {
      r_[r] = y_[r] - r_[r];
      sum += r_[r] * r_[r];
    }
    return std::sqrt(sum);
  }

  // δ += D⁺ r with D = ∂(x ⊞ δ)/∂δ, by modified Gram–Schmidt on [D r].
  bool Step(double* delta) {
    // For central differences: their error is of order kStep² = 1e-10, enough for Newton steps that
    // shrink anyway.
    constexpr double kStep = 1e-5;
    std::vector<double> R(columns_ * columns_, 0.0);
    std::vector<double> s(columns_);
    for (std::size_t c = 0; c < columns_; ++c) {
      const double at = delta[c];
      delta[c] = at + kStep;
      const bool forward = manifold_.Plus(x_, delta, D_[c].data());
      delta[c] = at - kStep;
      const bool backward = manifold_.Plus(x_, delta, backward_.data());
      delta[c] = at;
      if (!forward || !backward) {
        return false;
      }
      // In place: the column of the forward point becomes the derivative.
      for (std::size_t r = 0; r < rows_; ++r) {
        D_[c][r] = (D_[c][r] - backward_[r]) / (2.0 * kStep);
      }
      // Orthogonal to the columns before it, whose shares are R. Modified Gram–Schmidt takes each
      // share of what is left, which keeps columns orthogonal where they are nearly parallel.
      for (std::size_t k = 0; k < c; ++k) {
        R[k * columns_ + c] = Project(D_[k], &D_[c]);
      }
      const double norm = std::sqrt(Dot(D_[c], D_[c]));
      // A column that is zero: δ_c moves nothing here. NaN ends it as well.
      if (!(norm > 0.0)) {
        return false;
      }
      R[c * columns_ + c] = norm;
      std::for_each(D_[c].begin(), D_[c].end(), [norm](double& entry) { entry /= norm; });
      // r goes along as one more column: s = Qᵀ r.
      s[c] = Project(D_[c], &r_);
    }
    // R s = Qᵀ r from the last row up.
    for (std::size_t c = columns_; c-- > 0;) {
      for (std::size_t k = c + 1; k < columns_; ++k) {
        s[c] -= R[c * columns_ + k] * s[k];
      }
      s[c] /= R[c * columns_ + c];
      delta[c] += s[c];
    }
    return true;
  }

  static double Dot(const std::vector<double>& a, const std::vector<double>& b) {
    double sum = 0.0;
    for (std::size_t r = 0; r < a.size(); ++r) {
      sum += a[r] * b[r];
    }
    return sum;
  }
  // Takes the share along the unit vector out of v, and returns it.
  static double Project(const std::vector<double>& unit, std::vector<double>* v) {
    const double share = Dot(unit, *v);
    for (std::size_t r = 0; r < unit.size(); ++r) {
      (*v)[r] -= share * unit[r];
    }
    return share;
  }

  const Manifold& manifold_;
  const double* y_;
  const double* x_;
  std::size_t rows_;
  std::size_t columns_;
  std::vector<double> r_;
  std::vector<double> backward_;
  std::vector<std::vector<double>> D_;  // by columns
};

}  // namespace

bool Manifold::Minus(const double* y, const double* x, double* delta) const {
  return MinusSearch(*this, y, x).Run(delta);
}

}  // namespace inceres
