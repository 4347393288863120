#pragma once

#include <atomic>
#include <cstddef>
#include <vector>

#include <ceres/cost_function.h>

#include "tools/fuzz/dice.h"
#include "tools/fuzz/recycled.h"

namespace inceres::fuzz {

/// Of residuals, by which rounding may blur them: where costs are nearly zero.
inline constexpr double kNineDigits = 1e-9;

/// Who calls cost functions, and when: what a solver must not do is counted here.
struct CallWatch {
  std::atomic<bool> may_call{true};        ///< false: no solve is under way
  std::atomic<bool> may_overlap{false};    ///< the solve under way may use several threads
  std::atomic<int> active{0};              ///< calls under way
  std::atomic<long> calls_too_late{0};     ///< while may_call was false
  std::atomic<long> overlapping_calls{0};  ///< while may_overlap was false
};

/// The process's only one.
CallWatch& TheCallWatch();

/// How a cost function goes wrong where direction · x₀ > limit, x₀ its first parameter block.
enum class Fault {
  kNone,
  kRefuse,       ///< Evaluate returns false
  kNanResidual,  ///< the last residual is NaN
  kInfResidual,  ///< the last residual is infinite
  kNanJacobian,  ///< the first entry of the first Jacobian is NaN
};

/// Residuals whose minimum is known and whose shape is chosen:
///
///     kSmooth      r = w (A φ(x) − b),  φ(x) = x + c sin x,  of any blocks
///     kProjection  r = w (f (p_x, p_y) / p_z − b),  p = q + ω × q,  q = X − position;
///                  camera (position, ω, f) of size 3, 6 or 7, point X
///     kDistance    r = w (|x₁ − x₀| − b), two blocks of one size
///     kRay         r = w ((p_x, p_y) / p_z − b),  p = x₀ + (u, v, 1) / x₂ − x₁;
///                  two camera positions, and an inverse depth along a ray of the first
///
/// Of kProjection, a point nearer than 0.05 is refused, as cheirality guards do. kUnguarded is the
/// same without that, and kRay has no guard either.
class FuzzCost final : public ceres::CostFunction {
 public:
  enum class Kind { kSmooth, kProjection, kUnguarded, kDistance, kRay };

  FuzzCost(Kind kind, const std::vector<int>& sizes, int num_residuals, double weight,
           double curvature, Dice* dice);

  static void* operator new(std::size_t bytes) { return Recycled::Take(bytes); }
  static void operator delete(void* memory, std::size_t bytes) {
    Recycled::GiveBack(memory, bytes);
  }

  bool Evaluate(double const* const* parameters, double* residuals,
                double** jacobians) const override;

  /// Chooses b such that the residual at these values is `noise`-sized times the weight.
  void Measure(const std::vector<const double*>& truth, double noise, Dice* dice);
  /// The measurement is revised in place: the object stays.
  void Shift(double size, Dice* dice);
  /// The cost ½ Σ (size of the terms of each residual)²: what rounding errors are relative to.
  double Magnitude(double const* const* parameters) const;

  /// From now on faulty where the first block has gone further than `margin` from `x` along a
  /// random direction; a negative margin makes it faulty at x.
  void SetFault(Fault fault, const double* x, double margin, Dice* dice);
  Fault fault() const { return fault_; }
  Kind kind() const { return kind_; }

 private:
  // Whatever the fault.
  bool EvaluateSound(double const* const* parameters, double* residuals, double** jacobians) const;
  void Smooth(double const* const* parameters, double* residuals, double** jacobians) const;
  bool Projection(double const* const* parameters, double* residuals, double** jacobians) const;
  void Distance(double const* const* parameters, double* residuals, double** jacobians) const;
  void Ray(double const* const* parameters, double* residuals, double** jacobians) const;
  bool IsFaulty(const double* x) const;
  int size(int block) const { return parameter_block_sizes()[static_cast<std::size_t>(block)]; }

  Kind kind_;
  double weight_;
  double curvature_;
  int num_parameters_ = 0;
  std::vector<double> A_;  // num_residuals × num_parameters_; of kRay u and v
  std::vector<double> b_;
  Fault fault_ = Fault::kNone;
  std::vector<double> direction_;
  double limit_ = 0.0;
};

}  // namespace inceres::fuzz
