#pragma once

#include <cstddef>
#include <memory>
#include <vector>

#include "inceres/export.h"
#include "inceres/problem/factor_family.h"
#include "inceres/problem/factor_graph.h"
#include "inceres/problem/manifolds.h"

namespace inceres {

/// What is left of factors and variables that were marginalized: a square-root prior on their
/// neighbors x_1 … x_k, linearized once and for all at x₀,
///
///     e(x) = e₀ + J δ,   δ = (x_1 ⊟ x₀_1, …, x_k ⊟ x₀_k).
///
/// JᵀJ is its information, −Jᵀe₀ its right-hand side at x₀. J has as many rows as columns, rows of
/// zeros included.
struct INCERES_EXPORT LinearPrior {
  /// One variable of the prior.
  struct Block {
    std::vector<double> x0;                    ///< linearization point, ambient size
    std::shared_ptr<const Manifold> manifold;  ///< null: Euclidean
    int tangent_size = 0;                      ///< of the manifold, or x0.size()
  };
  std::vector<Block> blocks;  ///< x_1 … x_k
  std::vector<double> J;      ///< row-major, e0.size() × Σ tangent_size, whitened
  std::vector<double> e0;     ///< whitened

  /// Σ tangent_size over the blocks.
  int num_columns() const;
};

/// The factors that LinearPriors are: one slot a block. A family holds priors of one shape: the
/// same number of rows and the same sizes, block by block.
///
/// The tangent Jacobian is J itself, at every x: the first-estimate Jacobian, which is a choice and
/// not the derivative of e once a rotation has moved from x₀. (VINS and OKVIS make the same one.)
/// It holds for ⊞ of vector spaces and groups, whose tangent coordinates at x and x₀ mean the same;
/// those of a SphereManifold do not after a large move. Fails to evaluate where an x ⊟ x₀ is
/// undefined or a residual is not finite.
///
/// Cost: rows × columns multiplications a factor, a copy of J for Jacobians; nothing allocated up
/// to 256 columns. JᵀJ is formed once by the incremental solver (HasConstantJacobian). Threads: as
/// FactorFamily; Place is for one writer. Source: Leutenegger et al., "Keyframe-based
/// visual–inertial odometry using nonlinear optimization", 2015, section 3.5.
class INCERES_EXPORT LinearPriorFamily : public FactorFamily {
 public:
  /// What Add and Place take.
  using Measurement = LinearPrior;

  /// For priors of the shape of this one.
  explicit LinearPriorFamily(const LinearPrior& shape);

  /// Whether a prior has the family's shape.
  bool Fits(const LinearPrior& prior) const;
  /// Requires a prior that fits.
  void Add(const LinearPrior& prior) { Place(size(), prior); }
  /// Overwrites the prior at `index`, or appends it if index == size(). Requires a prior that fits.
  void Place(int index, const LinearPrior& prior);
  /// The prior at an index.
  const LinearPrior& prior(int index) const { return priors_[static_cast<std::size_t>(index)]; }

  int size() const override { return static_cast<int>(priors_.size()); }
  const char* Name() const override { return "linear prior"; }
  EvaluationFailure Evaluate(const FactorBatch& batch) const override;
  bool HasConstantJacobian() const override { return true; }

 private:
  EvaluationFailure EvaluateOne(int i, const FactorBatch& batch, double* delta) const;

  int num_columns_;
  std::vector<LinearPrior> priors_;
};

/// The prior that a factor of a graph is; null if it is of another kind, or there is no such
/// factor.
INCERES_EXPORT const LinearPrior* FindLinearPrior(const FactorGraph& graph, FactorId factor);

}  // namespace inceres
