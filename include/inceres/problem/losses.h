#pragma once

#include <memory>
#include <utility>

#include "inceres/export.h"

namespace inceres {

/// A robust loss ρ(s) of the squared residual norm s = ‖f‖²; a factor costs ½ρ(s). Null means ρ(s)
/// = s.
///
/// The built-in losses follow. Evaluate is called concurrently when the solver runs with several
/// threads. Source: Triggs et al., "Bundle Adjustment — A Modern Synthesis", 1999, section 4.3.
class INCERES_EXPORT Loss {
 public:
  virtual ~Loss() = default;

  /// rho[0] = ρ(s), rho[1] = ρ'(s), rho[2] = ρ''(s), for s ≥ 0. Requires ρ(0) = 0 and ρ' > 0 where
  /// ρ'' > 0.
  virtual void Evaluate(double s, double rho[3]) const = 0;
};

/// \file
/// The built-in robust losses ρ(s) of s = ‖f‖². Each has ρ(0) = 0 and, TolerantLoss, ScaledLoss and
/// ComposedLoss aside, ρ'(0) = 1, so that small residuals cost what they cost without a loss.
/// Definitions and parameters are those of the Ceres losses of the same names. A scale `a` is in
/// units of the residual norm, unless a class says otherwise, and must be positive.
///
/// Cost: a few operations, at most a square root and a transcendental function. Threads: immutable,
/// share freely. Source: Triggs et al., "Bundle Adjustment — A Modern Synthesis", 1999, section
/// 4.3; the documentation of Ceres 2.1.

/// ρ(s) = s for s ≤ a², else 2a√s − a²: quadratic, then linear in the residual norm.
class INCERES_EXPORT HuberLoss final : public Loss {
 public:
  /// Quadratic up to a, linear beyond.
  explicit HuberLoss(double a) : a_(a), b_(a * a) {}
  void Evaluate(double s, double rho[3]) const override;
  /// The scale, as given.
  double a() const { return a_; }

 private:
  double a_;
  double b_;
};

/// ρ(s) = 2a² (√(1 + s/a²) − 1): a smooth HuberLoss.
class INCERES_EXPORT SoftLOneLoss final : public Loss {
 public:
  /// Quadratic well below a, linear well above.
  explicit SoftLOneLoss(double a) : a_(a), b_(a * a) {}
  void Evaluate(double s, double rho[3]) const override;
  /// The scale, as given.
  double a() const { return a_; }

 private:
  double a_;
  double b_;
};

/// ρ(s) = a² log(1 + s/a²).
class INCERES_EXPORT CauchyLoss final : public Loss {
 public:
  /// Quadratic well below a.
  explicit CauchyLoss(double a) : a_(a), b_(a * a) {}
  void Evaluate(double s, double rho[3]) const override;
  /// The scale, as given.
  double a() const { return a_; }

 private:
  double a_;
  double b_;
};

/// ρ(s) = a atan(s / a). Here `a` is in units of s, the *squared* norm.
class INCERES_EXPORT ArctanLoss final : public Loss {
 public:
  /// Bounded by a π/2; a in units of s.
  explicit ArctanLoss(double a) : a_(a) {}
  void Evaluate(double s, double rho[3]) const override;
  /// The scale, as given.
  double a() const { return a_; }

 private:
  double a_;
};

/// ρ(s) = b log(1 + e^((s − a)/b)) − b log(1 + e^(−a/b)): nearly nothing up to a, then s − a; b is
/// the width of the transition. Both a and b are in units of s, the *squared* norm, and positive.
class INCERES_EXPORT TolerantLoss final : public Loss {
 public:
  /// Both in units of s, both positive.
  TolerantLoss(double a, double b);
  void Evaluate(double s, double rho[3]) const override;
  /// The scale, as given.
  double a() const { return a_; }
  /// The width of the transition, as given.
  double b() const { return b_; }

 private:
  double a_;
  double b_;
  double rho_at_zero_;
};

/// Tukey's biweight: ρ(s) = a²/3 (1 − (1 − s/a²)³) for s ≤ a², else a²/3. Residuals beyond a have
/// no influence at all.
class INCERES_EXPORT TukeyLoss final : public Loss {
 public:
  /// Bounded by a²/3, which it reaches at a.
  explicit TukeyLoss(double a) : a_(a), b_(a * a) {}
  void Evaluate(double s, double rho[3]) const override;
  /// The scale, as given.
  double a() const { return a_; }

 private:
  double a_;
  double b_;
};

/// scale · ρ(s). A null loss means ρ(s) = s, so ScaledLoss(nullptr, w) weights the squared norm by
/// w.
class INCERES_EXPORT ScaledLoss final : public Loss {
 public:
  /// The loss, which may be null, times the scale, which is positive, or 0: no influence at all.
  ScaledLoss(std::shared_ptr<const Loss> loss, double scale)
      : loss_(std::move(loss)), scale_(scale) {}
  void Evaluate(double s, double rho[3]) const override;
  /// The loss that is scaled.
  const Loss* loss() const { return loss_.get(); }
  /// The factor.
  double scale() const { return scale_; }

 private:
  std::shared_ptr<const Loss> loss_;
  double scale_;
};

/// f(g(s)). A null f or g means the identity.
class INCERES_EXPORT ComposedLoss final : public Loss {
 public:
  /// The outer and the inner loss; either may be null.
  ComposedLoss(std::shared_ptr<const Loss> f, std::shared_ptr<const Loss> g)
      : f_(std::move(f)), g_(std::move(g)) {}
  void Evaluate(double s, double rho[3]) const override;
  /// The outer loss.
  const Loss* f() const { return f_.get(); }
  /// The inner loss.
  const Loss* g() const { return g_.get(); }

 private:
  std::shared_ptr<const Loss> f_;
  std::shared_ptr<const Loss> g_;
};

}  // namespace inceres
