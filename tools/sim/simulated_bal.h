#pragma once

#include <vector>

#include "inceres/io/bal.h"

namespace inceres {

/// A simulated BAL problem and what is behind it. The observations are there once, and noisy: exact
/// ones follow from the true parameters.
struct SimulatedBal {
  BalProblem problem;
  std::vector<double> true_cameras, true_points;  ///< in the order of the problem's
  std::vector<int> outliers;  ///< indices of the observations that are outliers, ascending

  /// Observations photo by photo, and within each in the order of before.
  void SortByCamera();
  /// The problem becomes the truth: true cameras and points, exact projections; what it was is
  /// gone.
  void BecomeTruth();
  /// The error of the noisy observations at the true parameters: ReprojectionRms.
  double RmsAtTruth();
};

}  // namespace inceres
