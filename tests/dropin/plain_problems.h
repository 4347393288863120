#pragma once

#include <memory>
#include <vector>

#include <ceres/problem.h>
#include <ceres/solver.h>

/// Small problems for programs that know nothing but Ceres.
namespace plain {

/// y = exp(m t + c) + o through 53 points, three parameters.
struct Curve {
  void AddTo(ceres::Problem* problem);
  void Restart();
  std::vector<double> x = {0.0, 0.0, 0.0};
};

/// DENSE_QR, enough iterations.
ceres::Solver::Options CurveOptions();

/// Planar poses (x, y, θ) in a row, each bound to the one before and to what it sees; old ones
/// leave. The residual blocks of one frame are removed, changed where they are, and added again.
class Chain {
 public:
  Chain();
  ~Chain();
  void Grow(ceres::Problem* problem);
  std::vector<double> Values() const;

 private:
  struct Impl;
  std::unique_ptr<Impl> impl_;
};

ceres::Solver::Options ChainOptions();

/// 1,000 cameras in a row and 1,000 points, 9,000 unknowns. A point is seen from 20 of the 200
/// cameras nearest to it, whichever: the reduced system is too wide a band to be factored cheaply,
/// and too long for blocks.
class Photos {
 public:
  Photos();
  void AddTo(ceres::Problem* problem);

 private:
  struct View {
    int camera, point;
    double pixel[2];
  };
  std::vector<double> cameras_;  // angle axis and translation
  std::vector<double> points_;
  std::vector<View> views_;
};

/// ITERATIVE_SCHUR with SCHUR_JACOBI, five iterations.
ceres::Solver::Options PhotosOptions();

}  // namespace plain
