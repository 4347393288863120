#include "trust_region/reference_trust_region.h"

#include <algorithm>
#include <cmath>
#include <limits>

#include <Eigen/QR>
#include <gtest/gtest.h>

#include "support/dense_oracle.h"

namespace inceres::test {
namespace {

using Eigen::ArrayXd;
using Eigen::MatrixXd;
using Eigen::VectorXd;

// min ‖A z − b‖² + ‖D z‖²
VectorXd SolveStacked(const MatrixXd& A, const VectorXd& D, const VectorXd& b) {
  MatrixXd stacked(A.rows() + A.cols(), A.cols());
  stacked << A, MatrixXd(D.asDiagonal());
  VectorXd rhs = VectorXd::Zero(stacked.rows());
  rhs.head(b.size()) = b;
  return stacked.householderQr().solve(rhs);
}

class Reference {
 public:
  Reference(const SolverOptions& options, const std::vector<VariableId>& variables,
            FactorGraph graph)
      : options_(options),
        variables_(variables),
        graph_(std::move(graph)),
        radius_(options.initial_trust_region_radius) {}

  ReferenceTrace Run() {
    Linearize();
    s_ = options_.jacobi_scaling ? VectorXd(1.0 / (1.0 + J_.colwise().norm().transpose().array()))
                                 : VectorXd::Ones(J_.cols());
    J_ = J_ * s_.asDiagonal();
    current_ = minimum_ = reference_ = candidate_ = cost_;
    it_.cost = cost_;
    it_.step_is_successful = it_.step_is_valid = true;
    while (Finalize()) {
      const IterationSummary last = it_;
      it_ = IterationSummary();
      it_.iteration = last.iteration + 1;
      it_.gradient_max_norm = last.gradient_max_norm;
      if (!Step()) {
        break;
      }
    }
    return trace_;
  }

 private:
  void Linearize() {
    const DenseOracle oracle(graph_, variables_);
    J_ = oracle.J;
    r_ = oracle.f;
    g_ = oracle.g;
    cost_ = oracle.cost;
    const std::vector<double> p = Plus(-g_);
    it_.gradient_max_norm = 0.0;
    for (std::size_t k = 0; k < p.size(); ++k) {
      it_.gradient_max_norm = std::max(it_.gradient_max_norm, std::fabs(graph_.state()[k] - p[k]));
    }
    if (s_.size() > 0) {
      J_ = J_ * s_.asDiagonal();
    }
  }

  std::vector<double> Plus(const VectorXd& delta) const {
    std::vector<double> moved = graph_.state();
    int at = 0;
    for (const VariableId id : variables_) {
      double* x = moved.data() + graph_.StateOffset(id);
      if (graph_.manifold(id) != nullptr) {
        EXPECT_TRUE(graph_.manifold(id)->Plus(graph_.Values(id), delta.data() + at, x));
      } else {
        Eigen::Map<VectorXd>(x, graph_.AmbientSize(id)) +=
            delta.segment(at, graph_.AmbientSize(id));
      }
      at += graph_.TangentSize(id);
    }
    return moved;
  }

  double Distance(const std::vector<double>& a, const std::vector<double>& b) const {
    double sum = 0.0;
    for (std::size_t k = 0; k < a.size(); ++k) {
      sum += (a[k] - b[k]) * (a[k] - b[k]);
    }
    return std::sqrt(sum);
  }

  bool Finalize() {
    if (it_.step_is_successful && cost_ < best_cost_) {
      best_cost_ = cost_;
      trace_.state = graph_.state();
    }
    it_.trust_region_radius = radius_;
    trace_.iterations.push_back(it_);
    if (it_.iteration >= options_.max_num_iterations) {
      return false;
    }
    const bool converged =
        (it_.step_is_successful && it_.gradient_max_norm <= options_.gradient_tolerance) ||
        radius_ <= options_.min_trust_region_radius;
    if (converged) {
      trace_.termination = Termination::kConvergence;
    }
    return !converged;
  }

  VectorXd Clamped() const {
    return J_.colwise()
        .squaredNorm()
        .transpose()
        .array()
        .max(options_.min_lm_diagonal)
        .min(options_.max_lm_diagonal);
  }

  // The step y of the scaled variables.
  VectorXd LevenbergMarquardt() const {
    return -SolveStacked(J_, (Clamped() / radius_).cwiseSqrt(), r_);
  }

  VectorXd Dogleg() {
    const VectorXd D = Clamped().cwiseSqrt();
    const VectorXd g = (J_.transpose() * r_).cwiseQuotient(D);
    const double alpha = g.squaredNorm() / (J_ * g.cwiseQuotient(D)).squaredNorm();
    const VectorXd gn = -D.cwiseProduct(SolveStacked(J_, std::sqrt(mu_) * D, r_));
    VectorXd p = gn;
    dogleg_norm_ = gn.norm();
    if (gn.norm() > radius_ && g.norm() * alpha >= radius_) {
      p = -radius_ / g.norm() * g;
      dogleg_norm_ = radius_;
    } else if (gn.norm() > radius_) {
      // The point of the segment from a to gn at distance radius, by the quadratic equation in β.
      const VectorXd a = -alpha * g;
      const double A = (gn - a).squaredNorm();
      const double B = 2.0 * a.dot(gn - a);
      const double C = a.squaredNorm() - radius_ * radius_;
      p = a + (-B + std::sqrt(B * B - 4.0 * A * C)) / (2.0 * A) * (gn - a);
      dogleg_norm_ = p.norm();
    }
    return p.cwiseQuotient(D);
  }

  bool Step() {
    const bool lm = options_.strategy == TrustRegionStrategyKind::kLevenbergMarquardt;
    const VectorXd y = lm ? LevenbergMarquardt() : Dogleg();
    const VectorXd Jy = J_ * y;
    const double model = -Jy.dot(r_ + 0.5 * Jy);
    EXPECT_GT(model, 0.0) << "the reference does not handle invalid steps";
    const std::vector<double> candidate = Plus(s_.cwiseProduct(y));
    const double candidate_cost = CostAt(graph_, candidate);
    it_.step_norm = Distance(graph_.state(), candidate);
    it_.cost_change = cost_ - candidate_cost;
    if (it_.step_norm <= options_.parameter_tolerance * (x_norm_ + options_.parameter_tolerance) ||
        std::fabs(it_.cost_change) <= options_.function_tolerance * cost_) {
      trace_.termination = Termination::kConvergence;
      return false;
    }
    it_.relative_decrease = std::max((current_ - candidate_cost) / model,
                                     (reference_ - candidate_cost) / (since_reference_ + model));
    it_.step_is_successful = it_.relative_decrease > options_.min_relative_decrease;
    if (!it_.step_is_successful) {
      it_.cost = candidate_cost;
      radius_ /= lm ? nu_ : 2.0;
      nu_ *= 2.0;
      return true;
    }
    graph_.mutable_state() = candidate;
    x_norm_ = Distance(candidate, std::vector<double>(candidate.size(), 0.0));
    Linearize();
    it_.cost = cost_;
    AcceptRadius(lm, it_.relative_decrease);
    AcceptCost(candidate_cost, model);
    return true;
  }

  void AcceptRadius(bool lm, double q) {
    if (lm) {
      radius_ = std::min(options_.max_trust_region_radius,
                         radius_ / std::max(1.0 / 3.0, 1.0 - std::pow(2.0 * q - 1.0, 3)));
      nu_ = 2.0;
      return;
    }
    if (q < 0.25) {
      radius_ *= 0.5;
    } else if (q > 0.75) {
      radius_ = std::max(radius_, 3.0 * dogleg_norm_);
    }
    mu_ = std::max(1e-8, 0.2 * mu_);
  }

  void AcceptCost(double cost, double model) {
    current_ = cost;
    since_candidate_ += model;
    since_reference_ += model;
    if (cost < minimum_) {
      minimum_ = candidate_ = cost;
      num_nonmonotonic_ = 0;
      since_candidate_ = 0.0;
    } else {
      ++num_nonmonotonic_;
      if (cost > candidate_) {
        candidate_ = cost;
        since_candidate_ = 0.0;
      }
    }
    if (num_nonmonotonic_ ==
        (options_.use_nonmonotonic_steps ? options_.max_consecutive_nonmonotonic_steps : 0)) {
      reference_ = candidate_;
      since_reference_ = since_candidate_;
    }
  }

  const SolverOptions& options_;
  const std::vector<VariableId>& variables_;
  FactorGraph graph_;
  ReferenceTrace trace_;
  IterationSummary it_;
  MatrixXd J_;  // scaled once s is known
  VectorXd r_, g_, s_;
  double cost_ = 0.0;
  double best_cost_ = std::numeric_limits<double>::max();
  double x_norm_ = -1.0;
  double radius_;
  double nu_ = 2.0;
  double mu_ = 1e-8;
  double dogleg_norm_ = 0.0;
  int num_nonmonotonic_ = 0;
  double current_ = 0.0, minimum_ = 0.0, reference_ = 0.0, candidate_ = 0.0, since_reference_ = 0.0,
         since_candidate_ = 0.0;
};

}  // namespace

ReferenceTrace RunReference(const SolverOptions& options, const std::vector<VariableId>& variables,
                            FactorGraph graph) {
  return Reference(options, variables, std::move(graph)).Run();
}

}  // namespace inceres::test
