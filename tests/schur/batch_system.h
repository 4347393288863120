#pragma once

#include <vector>

#include <Eigen/Dense>

#include "inceres/problem/factor_graph.h"
#include "incremental/incremental_system.h"

namespace inceres::internal {

/// S and b of an incremental system, summed densely in long double from the Jacobians, weights and
/// landmark dampings cached in it: what the incremental ones are judged by. Which variables a
/// factor touches is asked of the graph, not of the system.
class BatchSystem {
 public:
  using Matrix = Eigen::Matrix<long double, Eigen::Dynamic, Eigen::Dynamic>;
  using Vector = Eigen::Matrix<long double, Eigen::Dynamic, 1>;

  BatchSystem(const FactorGraph& graph, const IncrementalSystem& system);

  /// The law: |S − S_batch|_ij ≤ 1e-10 √(C_ii C_jj), |b − b_batch|_i ≤ 1e-10 √(C_ii 2F), diag(C)
  /// and the cost to 1e-10; and exactly those landmarks take part that are free and have
  /// information. Where a row sees a landmark whose damped P is nearer to singular than 1e-5, the
  /// law is that much wider there.
  void ExpectLaw() const;

  /// (S + diag(damping)) δ = b over the frames that are not held; damping = mu · diag(C).
  Vector SolveFrames(double mu) const;
  /// Expects that the packed step of the frames, and what the system makes of it for the landmarks,
  /// is that of the batch, in the metric of C.
  void ExpectStep(const std::vector<double>& frame_step, double mu) const;

 private:
  static constexpr double kLaw = 1e-10;

  struct Separator {
    int row;
    Matrix W;  // frame × landmark
  };
  struct Landmark {
    Matrix P;
    Vector l;
    std::vector<Separator> separators;
    long double smallest = 0.0;  // eigenvalue of the damped P in the units of its coordinates
  };

  int size() const { return system_.schur().size(); }
  void SumFamily(const IncrementalFamily& family);
  void SumFactor(const IncrementalFamily& family, int i);
  void Eliminate(int landmark);
  Matrix Damped(int landmark) const;
  long double SmallestEigenvalue(int landmark) const;
  double IncrementalS(int row, int column, int r, int c) const;
  void ExpectS() const;
  void ExpectB() const;
  void ExpectLandmarks() const;

  const FactorGraph& graph_;
  const IncrementalSystem& system_;
  std::vector<int> row_of_;       // per variable, or -1
  std::vector<int> landmark_of_;  // per variable, or -1
  std::vector<Landmark> landmarks_;
  Matrix S_;
  Vector b_;
  Vector C_diagonal_;
  std::vector<double> law_;   // per row of S
  double widest_law_ = kLaw;  // of all that is in S
  long double cost_ = 0.0;
  int num_factors_ = 0;
};

}  // namespace inceres::internal
