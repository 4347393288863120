#pragma once

#include <memory>
#include <vector>

#include "inceres/export.h"
#include "inceres/factors/imu_preintegrator.h"
#include "inceres/problem/factor_family.h"

namespace inceres {

/// A preintegrated IMU measurement between two states, with analytic Jacobians. Slots 0 and 2 are
/// the poses of i and j, the IMU's in the world: [p(3), q(x, y, z, w)]; slots 1 and 3 their
/// velocities in the world and biases, [v(3), biases(6)], Euclidean. Poses must be on PoseManifold,
/// or on LeftPoseManifold if the conventions perturb on the left: Jacobians are written in its
/// tangent.
///
///     r_R = Log((ΔR̄ Exp(∂ΔR̄/∂b_g δb_g))ᵀ R_iᵀ R_j)
///     r_v = R_iᵀ(v_j − v_i − gΔt) − [Δv̄ + ∂Δv̄/∂b_g δb_g + ∂Δv̄/∂b_a δb_a]
///     r_p = R_iᵀ(p_j − p_i − v_iΔt − ½gΔt²) − [Δp̄ + ∂Δp̄/∂b_g δb_g + ∂Δp̄/∂b_a δb_a]
///     r_b = b_j − b_i                                                    (15 rows, whitened)
///
/// in the order, frame, form and sign of the measurement's conventions, multiplied by the Cholesky
/// factor U of the information matrix, which is kept. δb = b_i − b̄ is the distance from the biases
/// integrated at. When it exceeds the options' limits the solver, between two iterations, has the
/// samples integrated anew (Recenter); so two graphs that are solved at the same time must not
/// share a family. After such a solve, measurement(i) shows the biases used last.
///
/// Fails to evaluate where a result is not finite, or if the measurement has no information matrix
/// (nothing integrated; see ImuPreintegrator::SqrtInformation).
///
/// Cost: about 19,000 instructions a factor with Jacobians, 1,700 without (x86-64, SSE2); nothing
/// allocated in Evaluate; Recenter integrates all samples of a factor. Threads: as FactorFamily;
/// Add is for one writer. Source: Forster et al. 2017, section VI.C; derived in imu_factor.cc.
class INCERES_EXPORT ImuFactorFamily final : public FactorFamily {
 public:
  /// What Add and Place take: samples integrated between the two states.
  using Measurement = ImuPreintegrator;

  ImuFactorFamily();
  ~ImuFactorFamily() override;

  /// Appends a measurement.
  void Add(const Measurement& measurement) { Place(size(), measurement); }
  /// Overwrites the measurement at `index`, or appends it if index == size().
  void Place(int index, const Measurement& measurement);
  /// As it is now: integrated at the biases that the last solve asked for.
  const Measurement& measurement(int index) const;

  int size() const override { return static_cast<int>(factors_.size()); }
  const char* Name() const override { return "IMU preintegration"; }
  /// Of poses by the conventions of the first measurement: those of a family are to be on one side.
  SlotSpace Space(int s) const override;
  EvaluationFailure Evaluate(const FactorBatch& batch) const override;
  bool Recenters() const override { return true; }
  bool Recenter(int factor, const double* const* parameters) const override;

 private:
  struct Factor;
  std::vector<std::unique_ptr<Factor>> factors_;
};

}  // namespace inceres
