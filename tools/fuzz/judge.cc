#include "tools/fuzz/judge.h"

#include <algorithm>
#include <cmath>
#include <limits>
#include <vector>

#include <Eigen/Dense>
#include <ceres/crs_matrix.h>

namespace inceres::fuzz {
namespace {

constexpr double kStartDamping = 1e-4;
constexpr double kLeastDamping = 1e-12;
constexpr double kMostDamping = 1e12;
constexpr double kHardlyDamped = 1e-4;
constexpr double kLeastDiagonal = 1e-12;  // of H, relative to its largest
constexpr double kPromiseShare = 1e-3;    // of the tolerance: less is not worth a step
constexpr double kRounding = 1e-13;
constexpr int kMaxSteps = 200;  // accepted
constexpr int kMaxTries = 1000;

class PlainDescent {
 public:
  PlainDescent(World* world, double tolerance) : world_(world), tolerance_(tolerance) {
    evaluate_.residual_blocks = world->MovingResidualBlocks(&magnitude_);
    for (const auto& block : world->blocks()) {
      if (!block->constant && TangentSize(*block) > 0) {
        variable_.push_back(block.get());
        evaluate_.parameter_blocks.push_back(block->x);
        size_ += TangentSize(*block);
      }
    }
  }

  bool Run();
  /// What the model promises where it is.
  std::vector<double> Promises();
  const std::vector<double>& costs() const { return costs_; }
  double magnitude() const { return magnitude_; }

 private:
  static int TangentSize(const World::Block& block) {
    return block.manifold != nullptr ? block.manifold->TangentSize() : block.size;
  }
  bool Linearize();
  void HoldBounded();
  Eigen::VectorXd DampedStep(double damping, double* promise) const;
  bool Step(double damping, double* promise);
  void Move(const Eigen::VectorXd& step);
  bool CostHere(double* cost);

  World* world_;
  double tolerance_;
  double magnitude_ = 0.0;  // of what moves, at the start
  std::vector<World::Block*> variable_;
  ceres::Problem::EvaluateOptions evaluate_;
  int size_ = 0;
  Eigen::MatrixXd H_;
  Eigen::VectorXd g_;
  std::vector<double> costs_;  // at the start and after each accepted step
};

// An empty list would mean all residual blocks to Ceres.
bool PlainDescent::CostHere(double* cost) {
  *cost = 0.0;
  return evaluate_.residual_blocks.empty() ||
         (world_->problem().Evaluate(evaluate_, cost, nullptr, nullptr, nullptr) &&
          std::isfinite(*cost));
}

bool PlainDescent::Linearize() {
  ceres::CRSMatrix jacobian;
  std::vector<double> residuals;
  double cost = 0.0;
  if (!world_->problem().Evaluate(evaluate_, &cost, &residuals, nullptr, &jacobian)) {
    return false;
  }
  Eigen::MatrixXd J = Eigen::MatrixXd::Zero(jacobian.num_rows, size_);
  for (int row = 0; row < jacobian.num_rows; ++row) {
    const auto r = static_cast<std::size_t>(row);
    for (int k = jacobian.rows[r]; k < jacobian.rows[r + 1]; ++k) {
      J(row, jacobian.cols[static_cast<std::size_t>(k)]) =
          jacobian.values[static_cast<std::size_t>(k)];
    }
  }
  H_ = J.transpose() * J;
  g_ = J.transpose() * Eigen::Map<const Eigen::VectorXd>(
                           residuals.data(), static_cast<Eigen::Index>(residuals.size()));
  HoldBounded();
  return H_.allFinite() && g_.allFinite();
}

// Takes coordinates out that lie at a bound and would go beyond.
void PlainDescent::HoldBounded() {
  int column = 0;
  for (const World::Block* block : variable_) {
    for (int j = 0; block->manifold == nullptr && j < block->size; ++j) {
      const bool low = block->x[j] <= world_->problem().GetParameterLowerBound(block->x, j) &&
                       g_[column + j] > 0.0;
      const bool high = block->x[j] >= world_->problem().GetParameterUpperBound(block->x, j) &&
                        g_[column + j] < 0.0;
      if (low || high) {
        H_.row(column + j).setZero();
        H_.col(column + j).setZero();
        g_[column + j] = 0.0;
      }
    }
    column += TangentSize(*block);
  }
}

void PlainDescent::Move(const Eigen::VectorXd& step) {
  const double* delta = step.data();
  for (const World::Block* block : variable_) {
    const std::vector<double> x(block->x, block->x + block->size);
    if (block->manifold != nullptr) {
      block->manifold->Plus(x.data(), delta, block->x);
    } else {
      for (int j = 0; j < block->size; ++j) {
        block->x[j] = std::min(std::max(x[static_cast<std::size_t>(j)] + delta[j],
                                        world_->problem().GetParameterLowerBound(block->x, j)),
                               world_->problem().GetParameterUpperBound(block->x, j));
      }
    }
    delta += TangentSize(*block);
  }
}

Eigen::VectorXd PlainDescent::DampedStep(double damping, double* promise) const {
  Eigen::VectorXd damped = H_.diagonal();
  damped = damping * damped.cwiseMax(kLeastDiagonal * std::max(damped.maxCoeff(), 1e-300));
  Eigen::MatrixXd A = H_;
  A.diagonal() += damped;
  Eigen::VectorXd step = A.ldlt().solve(-g_);
  *promise = -step.dot(g_) - 0.5 * step.dot(H_ * step);
  return step;
}

std::vector<double> PlainDescent::Promises() {
  std::vector<double> promises;
  for (double damping = kStartDamping; Linearize() && damping > 0.5 * kLeastDamping;
       damping *= 0.01) {
    DampedStep(damping, &promises.emplace_back());
  }
  return promises;
}

// Whether a step with this damping was taken; *promise is what its model saw to gain.
bool PlainDescent::Step(double damping, double* promise) {
  const Eigen::VectorXd step = DampedStep(damping, promise);
  if (!step.allFinite() || !(*promise > 0.0)) {
    // a system that could not be solved promises nothing
    *promise = std::numeric_limits<double>::infinity();
    return false;
  }
  const std::vector<double> before = world_->Values();
  Move(step);
  double cost = 0.0;
  const double gain = CostHere(&cost) ? (costs_.back() - cost) / *promise : -1.0;
  if (gain < 0.25 || gain > 4.0) {
    world_->SetValues(before);
    return false;
  }
  costs_.push_back(cost);
  return true;
}

bool PlainDescent::Run() {
  double cost = 0.0;
  const bool moves = size_ > 0 && !evaluate_.residual_blocks.empty();
  if (!CostHere(&cost) || (moves && !Linearize())) {
    return false;
  }
  costs_ = {cost};
  double damping = kStartDamping;
  for (int tries = 0; moves && tries < kMaxTries && damping < kMostDamping; ++tries) {
    double promise = 0.0;
    const bool taken = Step(damping, &promise);
    if (taken && (static_cast<int>(costs_.size()) > kMaxSteps || !Linearize())) {
      break;
    }
    if (promise <= kPromiseShare * tolerance_ * costs_.back() && damping <= kHardlyDamped) {
      break;
    }
    damping = taken ? std::max(0.1 * damping, kLeastDamping) : 10.0 * damping;
  }
  return true;
}

}  // namespace

Verdict Judge(World* world, double function_tolerance) {
  const std::vector<double> values = world->Values();
  PlainDescent descent(world, function_tolerance);
  const double magnitude = descent.magnitude();
  Verdict verdict;
  verdict.judged = descent.Run();
  world->SetValues(values);
  if (!verdict.judged) {
    return verdict;
  }
  verdict.costs = descent.costs();
  verdict.cost = descent.costs().front();
  verdict.best = descent.costs().back();
  verdict.excess =
      (verdict.cost - verdict.best) / std::max(verdict.best, std::numeric_limits<double>::min());
  const double rounding =
      kNineDigits * kNineDigits * magnitude + kRounding * std::sqrt(magnitude * verdict.cost);
  const double allowed = kExcessTolerances * function_tolerance * verdict.best + rounding;
  const auto first = descent.costs().begin();
  const auto gained = std::find_if(first, descent.costs().end(),
                                   [&](double cost) { return verdict.cost - cost > allowed; });
  verdict.steps = static_cast<int>(gained - first);
  verdict.is_excess = gained != descent.costs().end();
  verdict.is_creeping = verdict.is_excess && verdict.steps > kCreepingSteps;
  if (verdict.is_excess) {
    verdict.promises = descent.Promises();
  }
  return verdict;
}

}  // namespace inceres::fuzz
