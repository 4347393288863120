#include "tools/fuzz/ingredients.h"

#include <algorithm>
#include <cmath>
#include <memory>

#include <ceres/line_manifold.h>
#include <ceres/product_manifold.h>
#include <ceres/sphere_manifold.h>

namespace inceres::fuzz {
namespace {

// A user's own manifold: x + D δ, D diagonal with entries 1, 2, … times a scale.
class StretchedManifold : public ceres::Manifold {
 public:
  StretchedManifold(int size, double scale) : size_(size), scale_(scale) {}
  int AmbientSize() const override { return size_; }
  int TangentSize() const override { return size_; }
  bool Plus(const double* x, const double* delta, double* x_plus_delta) const override {
    for (int j = 0; j < size_; ++j) {
      x_plus_delta[j] = x[j] + Stretch(j) * delta[j];
    }
    return true;
  }
  bool PlusJacobian(const double* /*x*/, double* jacobian) const override {
    return Diagonal([this](int j) { return Stretch(j); }, jacobian);
  }
  bool Minus(const double* y, const double* x, double* y_minus_x) const override {
    for (int j = 0; j < size_; ++j) {
      y_minus_x[j] = (y[j] - x[j]) / Stretch(j);
    }
    return true;
  }
  bool MinusJacobian(const double* /*x*/, double* jacobian) const override {
    return Diagonal([this](int j) { return 1.0 / Stretch(j); }, jacobian);
  }

 private:
  double Stretch(int j) const { return scale_ * (j + 1); }
  template <typename Entry>
  bool Diagonal(const Entry& entry, double* jacobian) const {
    std::fill_n(jacobian, size_ * size_, 0.0);
    for (int j = 0; j < size_; ++j) {
      jacobian[j * (size_ + 1)] = entry(j);
    }
    return true;
  }

  int size_;
  double scale_;
};

void Normalize(std::vector<double>* x, std::size_t begin) {
  double squared = 0.0;
  for (std::size_t j = begin; j < x->size(); ++j) {
    squared += (*x)[j] * (*x)[j];
  }
  for (std::size_t j = begin; j < x->size(); ++j) {
    (*x)[j] = squared > 1e-4 ? (*x)[j] / std::sqrt(squared) : (j == begin ? 1.0 : 0.0);
  }
}

std::unique_ptr<ceres::Manifold> RandomSubset(int size, Dice* dice) {
  std::vector<int> constant;
  const double share = dice->Chance(0.05) ? 1.1 : 0.4;  // all of them, now and then
  for (int j = 0; j < size; ++j) {
    if (dice->Chance(share)) {
      constant.push_back(j);
    }
  }
  return std::make_unique<ceres::SubsetManifold>(size, constant);
}

std::unique_ptr<ceres::Manifold> CurvedManifold(int size, Dice* dice, std::vector<double>* x) {
  switch (size) {
    case 3:
      Normalize(x, 0);
      return std::make_unique<ceres::SphereManifold<3>>();
    case 4:
      Normalize(x, 0);
      switch (dice->Int(0, 2)) {
        case 0:
          return std::make_unique<ceres::QuaternionManifold>();
        case 1:
          return std::make_unique<ceres::EigenQuaternionManifold>();
        default:
          return std::make_unique<ceres::SphereManifold<4>>();
      }
    case 6:
      Normalize(x, 3);
      return std::make_unique<ceres::LineManifold<3>>();
    case 7:
      Normalize(x, 3);
      return std::make_unique<
          ceres::ProductManifold<ceres::EuclideanManifold<3>, ceres::EigenQuaternionManifold>>();
    default:
      return nullptr;
  }
}

void ChooseLinearSolver(const OptionRange& range, Dice* dice, ceres::Solver::Options* options) {
  constexpr ceres::LinearSolverType kTypes[] = {ceres::DENSE_SCHUR, ceres::SPARSE_SCHUR,
                                                ceres::DENSE_NORMAL_CHOLESKY,
                                                ceres::SPARSE_NORMAL_CHOLESKY, ceres::DENSE_QR};
  options->linear_solver_type = kTypes[dice->Int(0, range.follows_stock ? 4 : 3)];
}

void ChooseStrategy(Dice* dice, ceres::Solver::Options* options) {
  options->trust_region_strategy_type =
      dice->Chance(0.7) ? ceres::LEVENBERG_MARQUARDT : ceres::DOGLEG;
  options->dogleg_type = dice->Chance(0.5) ? ceres::TRADITIONAL_DOGLEG : ceres::SUBSPACE_DOGLEG;
}

void ChooseTolerance(Dice* dice, ceres::Solver::Options* options) {
  options->function_tolerance = dice->Chance(0.6) ? 1e-6 : dice->Magnitude(1e-10, 1e-3);
}

}  // namespace

std::unique_ptr<ceres::LossFunction> RandomLoss(Dice* dice) {
  const double a = dice->Magnitude(0.1, 3.0);
  switch (dice->Int(0, 9)) {
    case 0:
    case 1:
      return std::make_unique<ceres::HuberLoss>(a);
    case 2:
    case 3:
      return std::make_unique<ceres::CauchyLoss>(a);
    case 4:
      return std::make_unique<ceres::SoftLOneLoss>(a);
    case 5:
      return std::make_unique<ceres::ArctanLoss>(a + 0.5);
    case 6:
      return std::make_unique<ceres::TolerantLoss>(a, 0.2 * a);
    case 7:
      return std::make_unique<ceres::TukeyLoss>(a + 0.5);
    case 8:
      return std::make_unique<ceres::ScaledLoss>(
          dice->Chance(0.5) ? nullptr : RandomLoss(dice).release(), dice->Magnitude(0.1, 10.0),
          ceres::TAKE_OWNERSHIP);
    default:
      if (dice->Chance(0.5)) {
        return std::make_unique<ceres::TrivialLoss>();
      }
      return std::make_unique<ceres::ComposedLoss>(new ceres::HuberLoss(a), ceres::TAKE_OWNERSHIP,
                                                   new ceres::CauchyLoss(2.0 * a),
                                                   ceres::TAKE_OWNERSHIP);
  }
}

std::unique_ptr<ceres::Manifold> RandomManifold(int size, Dice* dice, std::vector<double>* x) {
  const int kind = dice->Int(0, 9);
  if (kind < 5) {
    return CurvedManifold(size, dice, x);
  }
  if (kind < 8 && size > 1) {
    return RandomSubset(size, dice);
  }
  if (kind == 8) {
    return std::make_unique<StretchedManifold>(size, dice->Magnitude(0.1, 10.0));
  }
  return std::make_unique<ceres::EuclideanManifold<ceres::DYNAMIC>>(size);
}

ceres::Solver::Options RandomOptions(const OptionRange& range, Dice* dice) {
  ceres::Solver::Options options;
  options.logging_type = ceres::SILENT;
  ChooseLinearSolver(range, dice, &options);
  ChooseStrategy(dice, &options);
  ChooseTolerance(dice, &options);
  options.max_num_iterations = dice->Chance(0.8) ? 100 : dice->Int(0, 12);
  options.num_threads = dice->Chance(0.1) ? 2 : 1;
  if (dice->Chance(0.2)) {
    options.initial_trust_region_radius = dice->Magnitude(1e-2, 1e8);
  }
  if (range.follows_stock) {
    options.use_nonmonotonic_steps = dice->Chance(0.1);
    options.jacobi_scaling = dice->Chance(0.9);
    options.update_state_every_iteration = dice->Chance(0.1);
    if (dice->Chance(0.2)) {
      options.gradient_tolerance = 0.0;
      options.parameter_tolerance = 0.0;
    }
  }
  return options;
}

void ChangeOptions(const OptionRange& range, Dice* dice, ceres::Solver::Options* options) {
  for (int changes = dice->Int(1, 2); changes > 0; --changes) {
    switch (dice->Int(0, 4)) {
      case 0:
        ChooseLinearSolver(range, dice, options);
        break;
      case 1:
        ChooseStrategy(dice, options);
        break;
      case 2:
        ChooseTolerance(dice, options);
        break;
      case 3:
        options->max_num_iterations = dice->Chance(0.7) ? 100 : dice->Int(0, 12);
        break;
      default:
        options->num_threads = 3 - options->num_threads;
    }
  }
}

}  // namespace inceres::fuzz
