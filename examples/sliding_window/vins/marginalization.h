#pragma once

#include <memory>
#include <unordered_map>
#include <vector>

#include <Eigen/Core>
#include <ceres/cost_function.h>
#include <ceres/loss_function.h>

#include "common/linearize.h"

namespace sliding_window {

/// What the window knew of variables that leave it, as a linear residual J dx + r over those that
/// stay:
///
///     // For every factor that touches what leaves:
///     info.Add(factor, loss, its blocks, which of them leave);
///     info.Marginalize();
///     problem.AddResidualBlock(new MarginalizationFactor(&info), nullptr,
///                              info.KeptBlocks(where they lie now));
///
/// Factors are linearized once, at the values their blocks have when they are added. Blocks of size
/// 7 are poses, with the derivatives in their first six columns. Source: Qin et al., VINS-Mono
/// (T-RO 2018), section VI.C.
class MarginalizationInfo {
 public:
  struct Block {
    double* address;  // where it lay when it was added
    int size;
    int tangent_size;
    int offset;  // of its columns in J
    std::vector<double> x_0;
  };

  /// `dropped`: which of `blocks` leave, by their places in it.
  void Add(const ceres::CostFunction& cost, const ceres::LossFunction* loss,
           const std::vector<double*>& blocks, const std::vector<int>& dropped);
  void Marginalize();

  /// Where the kept blocks lie now, in the order of J's columns. A block that `moved` does not name
  /// has not moved.
  std::vector<double*> KeptBlocks(const std::unordered_map<const double*, double*>& moved) const;

  const std::vector<Block>& kept() const { return kept_; }
  const Eigen::MatrixXd& J() const { return J_; }
  const Eigen::VectorXd& r() const { return r_; }

 private:
  struct Factor {
    LinearizedFactor linearized;
    std::vector<int> blocks;  // into blocks_
  };

  int FindOrAddBlock(double* address, int size);
  /// Gives every block its columns, what is dropped first. Returns how many columns are dropped.
  int OrderBlocks();

  std::vector<Block> blocks_;
  std::vector<bool> is_dropped_;
  std::unordered_map<const double*, int> block_at_;
  std::vector<Factor> factors_;
  std::vector<Block> kept_;
  Eigen::MatrixXd J_;
  Eigen::VectorXd r_;
};

/// The prior as a cost function of as many residuals as J has rows. Refers to `info`, which must
/// live as long as this is evaluated.
class MarginalizationFactor : public ceres::CostFunction {
 public:
  explicit MarginalizationFactor(const MarginalizationInfo* info);
  bool Evaluate(double const* const* parameters, double* residuals,
                double** jacobians) const override;

 private:
  const MarginalizationInfo* info_;
};

}  // namespace sliding_window
