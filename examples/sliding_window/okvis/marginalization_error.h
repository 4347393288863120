#pragma once

#include <vector>

#include <ceres/cost_function.h>
#include <ceres/manifold.h>
#include <ceres/problem.h>

#include "common/schur_complement.h"

namespace sliding_window {

/// What a map knew of variables that have left it: a linear residual J dx + r over those that stay,
/// one object for as long as the map lives. Between two solves it is taken out of the
/// ceres::Problem, changed, and put back, with other sizes:
///
///     problem.RemoveResidualBlock(id);
///     prior.Add(problem, residual);   // for every residual block that touches what leaves
///     prior.MarginalizeOut(leaving);
///     prior.Update();
///     id = problem.AddResidualBlock(&prior, nullptr, prior.Blocks());
///
/// A block is linearized where it is when it is connected first, and stays so for all residuals
/// that come later (first-estimate Jacobians). Source: Leutenegger et al., Keyframe-based
/// visual-inertial odometry (IJRR 2015), section 4.
class MarginalizationError : public ceres::CostFunction {
 public:
  /// Linearizes a residual block with respect to those of its parameter blocks that are not
  /// constant.
  void Add(const ceres::Problem& problem, ceres::ResidualBlockId residual);
  /// Minimizes over these blocks; one that is not connected is passed over.
  void MarginalizeOut(const std::vector<double*>& leaving);
  /// Makes J, r and the sizes that Ceres sees.
  void Update();

  std::vector<double*> Blocks() const;
  bool Evaluate(double const* const* parameters, double* residuals,
                double** jacobians) const override;

  const SquareRoot& prior() const { return prior_; }

 private:
  struct Block {
    double* address;
    std::vector<double> x_0;
    const ceres::Manifold* manifold;  // null: none
    int offset;                       // of its rows in the equations
    int tangent_size() const {
      return manifold != nullptr ? manifold->TangentSize() : static_cast<int>(x_0.size());
    }
  };

  int FindOrConnect(double* address, int size, const ceres::Manifold* manifold);
  const Block* Find(const double* address) const;

  std::vector<Block> blocks_;
  NormalEquations equations_ = NormalEquations::Zero(0);
  SquareRoot prior_;
};

}  // namespace sliding_window
