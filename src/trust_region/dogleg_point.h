#pragma once

#include <cmath>

namespace inceres::internal {

/// Where the dog-leg path from the Cauchy point a, inside the sphere ‖p‖ = r, to the Gauss–Newton
/// point b leaves it: the β of p = a + β (b − a). What it takes are r², ‖a‖², aᵀ(b − a) and ‖b −
/// a‖², in whichever metric.
///
/// β is the positive root of ‖b − a‖² β² + 2 aᵀ(b − a) β − (r² − ‖a‖²) = 0, in the one of its two
/// forms in which nothing cancels. Source: Nocedal & Wright, "Numerical Optimization", 2006,
/// section 4.1; Ceres 2.1's DoglegStrategy.
inline double DoglegShare(double squared_radius, double squared_a, double a_dot_difference,
                          double squared_difference) {
  const double to_go = squared_radius - squared_a;
  const double root = std::sqrt(a_dot_difference * a_dot_difference + squared_difference * to_go);
  return a_dot_difference <= 0.0 ? (root - a_dot_difference) / squared_difference
                                 : to_go / (root + a_dot_difference);
}

}  // namespace inceres::internal
