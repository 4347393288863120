#include "adapters/ceres/src/compare_solves.h"

#include <algorithm>
#include <cmath>
#include <cstdlib>
#include <limits>
#include <sstream>

namespace inceres::internal {
namespace {

constexpr double kInfinity = std::numeric_limits<double>::infinity();
// A step that changes the cost by less than this, relatively, has a quality that rounding decides: whether it is accepted, and
// the radius after it, may differ between two correct solvers.
constexpr double kFlat = 1e-7;
// Parameter blocks smaller than this everywhere count as this large.
constexpr double kSmallestBlock = 1e-3;

std::string Words(const std::string& what, double ours, double stock, double difference, double tolerance) {
  std::ostringstream text;
  text.precision(12);
  text << what << ": ours " << ours << ", stock " << stock;
  text.precision(2);
  text << " (difference " << difference << ", tolerance " << tolerance << ")";
  return text.str();
}

// Not a number, and one infinite, differ from everything but their like.
double Relative(double difference, double scale) {
  return std::isfinite(difference) ? difference / scale : kInfinity;
}

class Comparison {
 public:
  Comparison(const JudgedTolerances& tolerances, CrossCheckResult* result)
      : tolerances_(tolerances), result_(*result), ours_(result->ours), stock_(result->stock) {
    smallest_cost_ =
        std::max(std::numeric_limits<double>::epsilon() * std::abs(ours_.initial_cost), std::numeric_limits<double>::min());
  }

  void Run(const UserState& layout, const SolvedStates& states) {
    result_.cost_difference = CostDifference(ours_.final_cost, stock_.final_cost);
    FindParameterDifference(layout, states);
    if (tolerances_.traces) {
      CompareTraces();
    }
    if (EndsAreComparable()) {
      CompareEnds();
    }
  }

 private:
  double CostDifference(double ours, double stock) const {
    if (ours == stock) {
      return 0.0;
    }
    return Relative(ours - stock, std::max({std::abs(ours), std::abs(stock), smallest_cost_}));
  }

  bool CostsAgree(double difference, double tolerance) const {
    return difference <= tolerance && -difference <= std::max(tolerance, tolerances_.lower_cost);
  }

  void FindParameterDifference(const UserState& layout, const SolvedStates& states) {
    for (const UserState::Block& block : layout.blocks()) {
      double scale = kSmallestBlock;
      for (int i = block.first; i < block.first + block.size; ++i) {
        const auto k = static_cast<std::size_t>(i);
        scale = std::max({scale, std::abs(states.start[k]), std::abs(states.ours[k]), std::abs(states.stock[k])});
      }
      for (int i = 0; i < block.size; ++i) {
        const std::size_t k = static_cast<std::size_t>(block.first) + static_cast<std::size_t>(i);
        const double ours = states.ours[k];
        const double stock = states.stock[k];
        const double relative = ours == stock ? 0.0 : Relative(std::abs(ours - stock), scale);
        if (relative > result_.parameters.relative) {
          result_.parameters = {block.values, block.index, block.size, i, ours, stock, relative};
        }
      }
    }
  }

  void Differ(int iteration, const std::string& violation) {
    if (iteration >= 0 && result_.first_different_iteration < 0) {
      result_.first_different_iteration = iteration;
    }
    result_.violations.push_back(violation);
  }

  // Up to the first iteration that differs: the later ones do in consequence.
  void CompareTraces() {
    const std::size_t common = std::min(ours_.iterations.size(), stock_.iterations.size());
    for (std::size_t k = 0; k < common && result_.violations.empty(); ++k) {
      const ceres::IterationSummary& x = ours_.iterations[k];
      const ceres::IterationSummary& y = stock_.iterations[k];
      const bool flat = k > 0 && std::abs(x.cost_change) <= kFlat * x.cost && std::abs(y.cost_change) <= kFlat * y.cost;
      const bool same_decision = x.step_is_valid == y.step_is_valid && x.step_is_successful == y.step_is_successful;
      if (!same_decision && flat) {
        rounding_decided_ = true;
        return;
      }
      radius_is_comparable_ = radius_is_comparable_ && !flat;
      CompareIteration(x, y, same_decision);
    }
  }

  void CompareIteration(const ceres::IterationSummary& x, const ceres::IterationSummary& y, bool same_decision) {
    const std::string of_iteration = " of iteration " + std::to_string(x.iteration);
    const double cost = CostDifference(x.cost, y.cost);
    if (!CostsAgree(cost, tolerances_.cost)) {
      Differ(x.iteration, Words("cost" + of_iteration, x.cost, y.cost, cost, tolerances_.cost));
    }
    if (!same_decision) {
      const auto decision = [](const ceres::IterationSummary& step) {
        return step.step_is_successful ? "accepted" : step.step_is_valid ? "rejected" : "invalid";
      };
      Differ(x.iteration, std::string("step") + of_iteration + ": ours " + decision(x) + ", stock " + decision(y));
    }
    const double radius = x.trust_region_radius == y.trust_region_radius
                              ? 0.0
                              : Relative(std::abs(x.trust_region_radius - y.trust_region_radius),
                                         std::max(x.trust_region_radius, y.trust_region_radius));
    if (radius_is_comparable_ && same_decision && radius > tolerances_.radius) {
      Differ(x.iteration, Words("trust-region radius" + of_iteration, x.trust_region_radius, y.trust_region_radius, radius,
                                tolerances_.radius));
    }
  }

  bool EndsAreComparable() {
    for (const ceres::Solver::Summary* summary : {&ours_, &stock_}) {
      if (summary->total_time_in_seconds >= tolerances_.max_seconds) {
        result_.reason = "the time limit ended a solve: its end was not judged";
        return false;
      }
    }
    if (ours_.termination_type == ceres::USER_SUCCESS || ours_.termination_type == ceres::USER_FAILURE) {
      result_.reason = "an iteration callback ended our solve, and stock was solved without callbacks: the end was not judged";
      return false;
    }
    return true;
  }

  void CompareEnds() {
    const bool judge_termination = tolerances_.traces || ours_.IsSolutionUsable() != stock_.IsSolutionUsable();
    if (judge_termination && ours_.termination_type != stock_.termination_type) {
      Differ(-1, std::string("termination: ours ") + ceres::TerminationTypeToString(ours_.termination_type) + " (" +
                     ours_.message + "), stock " + ceres::TerminationTypeToString(stock_.termination_type) + " (" +
                     stock_.message + ")");
    }
    const int count = static_cast<int>(ours_.iterations.size());
    const int stock_count = static_cast<int>(stock_.iterations.size());
    const int surplus = std::abs(count - stock_count);
    if (surplus > tolerances_.iterations) {
      Differ(std::min(count, stock_count), Words("number of iterations", std::max(0, count - 1), std::max(0, stock_count - 1),
                                                 surplus, tolerances_.iterations));
    }
    const bool ends_elsewhere = tolerances_.traces && (surplus > 0 || rounding_decided_);
    const double cost_tolerance = ends_elsewhere ? std::max(tolerances_.cost, tolerances_.function_tolerance) : tolerances_.cost;
    if (!CostsAgree(result_.cost_difference, cost_tolerance)) {
      Differ(-1, Words("final cost", ours_.final_cost, stock_.final_cost, result_.cost_difference, cost_tolerance));
    }
    const ParameterDifference& worst = result_.parameters;
    if (worst.relative > tolerances_.parameters && std::abs(worst.ours - worst.stock) > SurplusMotion()) {
      std::ostringstream what;
      what << "parameter block " << worst.block << " of size " << worst.size << ", component " << worst.component;
      Differ(-1, Words(what.str(), worst.ours, worst.stock, worst.relative, tolerances_.parameters));
    }
  }

  // How far the iterations that only one of the two made may have moved a parameter.
  double SurplusMotion() const {
    if (rounding_decided_) {
      return kInfinity;
    }
    const std::size_t common = std::min(ours_.iterations.size(), stock_.iterations.size());
    double motion = 0.0;
    for (const ceres::Solver::Summary* summary : {&ours_, &stock_}) {
      for (std::size_t k = common; k < summary->iterations.size(); ++k) {
        motion += summary->iterations[k].step_is_successful ? summary->iterations[k].step_norm : 0.0;
      }
    }
    return motion;
  }

  const JudgedTolerances& tolerances_;
  CrossCheckResult& result_;
  const ceres::Solver::Summary& ours_;
  const ceres::Solver::Summary& stock_;
  double smallest_cost_ = 0.0;
  bool radius_is_comparable_ = true;
  bool rounding_decided_ = false;
};

}  // namespace

JudgedTolerances TolerancesFor(SolveMode mode, const CrossCheckOptions& check, const ceres::Solver::Options& options) {
  const bool exact = mode == SolveMode::kExact;
  JudgedTolerances tolerances;
  tolerances.cost = check.cost_tolerance.value_or(exact ? 1e-9 : options.function_tolerance);
  tolerances.lower_cost = exact ? tolerances.cost : kInfinity;
  tolerances.parameters = check.parameter_tolerance.value_or(exact ? 1e-6 : kInfinity);
  tolerances.iterations = check.iteration_tolerance ? *check.iteration_tolerance : exact ? 1.0 : kInfinity;
  tolerances.radius = check.radius_tolerance.value_or(1e-6);
  tolerances.function_tolerance = options.function_tolerance;
  tolerances.max_seconds = options.max_solver_time_in_seconds;
  tolerances.traces = exact;
  return tolerances;
}

void Compare(const UserState& layout, const SolvedStates& states, const JudgedTolerances& tolerances, CrossCheckResult* result) {
  Comparison(tolerances, result).Run(layout, states);
}

}  // namespace inceres::internal
