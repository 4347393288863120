#include "adapters/ceres/compare/compare_solves.h"

#include <algorithm>
#include <cmath>
#include <cstdlib>
#include <limits>
#include <sstream>

namespace inceres::internal {
namespace {

constexpr double kInfinity = std::numeric_limits<double>::infinity();
// A step that changes the cost by less than this, relatively, has a quality that rounding decides:
// whether it is accepted, and the radius after it, may differ between two correct solvers.
constexpr double kFlat = 1e-7;
// Parameter blocks smaller than this everywhere count as this large.
constexpr double kSmallestBlock = 1e-3;

std::string Words(const std::string& what, double ours, double stock, double difference,
                  double tolerance) {
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

double SmallestCost(const ceres::Solver::Summary& summary) {
  return std::max(std::numeric_limits<double>::epsilon() * std::abs(summary.initial_cost),
                  std::numeric_limits<double>::min());
}

double RelativeCost(double ours, double stock, double smallest) {
  return ours == stock
             ? 0.0
             : Relative(ours - stock, std::max({std::abs(ours), std::abs(stock), smallest}));
}

double RadiusDifference(const ceres::IterationSummary& x, const ceres::IterationSummary& y) {
  return x.trust_region_radius == y.trust_region_radius
             ? 0.0
             : Relative(std::abs(x.trust_region_radius - y.trust_region_radius),
                        std::max(x.trust_region_radius, y.trust_region_radius));
}

double ValueOrZero(const std::vector<double>& values, int k) {
  return static_cast<std::size_t>(k) < values.size() ? values[static_cast<std::size_t>(k)] : 0.0;
}

class Comparison {
 public:
  Comparison(const JudgedTolerances& tolerances, const Excuse& excuse, CrossCheckResult* result)
      : tolerances_(tolerances),
        excuse_(excuse),
        result_(*result),
        ours_(result->ours),
        stock_(result->stock),
        smallest_cost_(SmallestCost(ours_)) {}

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
    return RelativeCost(ours, stock, smallest_cost_);
  }

  bool CostsAgree(double difference, double tolerance) const {
    return difference <= tolerance && -difference <= std::max(tolerance, tolerances_.lower_cost);
  }

  void FindParameterDifference(const UserState& layout, const SolvedStates& states) {
    for (const UserState::Block& block : layout.blocks()) {
      double scale = kSmallestBlock;
      for (int i = block.first; i < block.first + block.size; ++i) {
        const auto k = static_cast<std::size_t>(i);
        scale = std::max({scale, std::abs(states.start[k]), std::abs(states.ours[k]),
                          std::abs(states.stock[k])});
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
      if (static_cast<int>(k) >= excuse_.first_different_iteration) {
        return;
      }
      const ceres::IterationSummary& x = ours_.iterations[k];
      const ceres::IterationSummary& y = stock_.iterations[k];
      const bool flat = k > 0 && std::abs(x.cost_change) <= kFlat * x.cost &&
                        std::abs(y.cost_change) <= kFlat * y.cost;
      const bool same_decision =
          x.step_is_valid == y.step_is_valid && x.step_is_successful == y.step_is_successful;
      if (!same_decision && flat) {
        rounding_decided_ = true;
        return;
      }
      radius_is_comparable_ = radius_is_comparable_ && !flat;
      CompareIteration(x, y, same_decision);
    }
  }

  void CompareIteration(const ceres::IterationSummary& x, const ceres::IterationSummary& y,
                        bool same_decision) {
    const std::string of_iteration = " of iteration " + std::to_string(x.iteration);
    const double cost = CostDifference(x.cost, y.cost);
    const double cost_tolerance =
        std::max(tolerances_.cost, ValueOrZero(excuse_.costs, x.iteration));
    if (!CostsAgree(cost, cost_tolerance)) {
      Differ(x.iteration, Words("cost" + of_iteration, x.cost, y.cost, cost, cost_tolerance));
    }
    if (!same_decision) {
      const auto decision = [](const ceres::IterationSummary& step) {
        return step.step_is_successful ? "accepted" : step.step_is_valid ? "rejected" : "invalid";
      };
      Differ(x.iteration, std::string("step") + of_iteration + ": ours " + decision(x) +
                              ", stock " + decision(y));
    }
    const double radius = RadiusDifference(x, y);
    const double radius_tolerance =
        std::max(tolerances_.radius, ValueOrZero(excuse_.radii, x.iteration));
    if (radius_is_comparable_ && same_decision && radius > radius_tolerance) {
      Differ(x.iteration, Words("trust-region radius" + of_iteration, x.trust_region_radius,
                                y.trust_region_radius, radius, radius_tolerance));
    }
  }

  bool EndsAreComparable() {
    for (const ceres::Solver::Summary* summary : {&ours_, &stock_}) {
      if (summary->total_time_in_seconds >= tolerances_.max_seconds) {
        result_.reason = "the time limit ended a solve: its end was not judged";
        return false;
      }
    }
    if (ours_.termination_type == ceres::USER_SUCCESS ||
        ours_.termination_type == ceres::USER_FAILURE) {
      result_.reason =
          "an iteration callback ended our solve, and stock was solved without callbacks: the end "
          "was not judged";
      return false;
    }
    return true;
  }

  void CompareEnds() {
    const bool both_usable = ours_.IsSolutionUsable() && stock_.IsSolutionUsable();
    const bool excused = excuse_.terminations || (both_usable && excuse_.iterations > 0.0);
    const bool judge_termination =
        tolerances_.traces || ours_.IsSolutionUsable() != stock_.IsSolutionUsable();
    if (judge_termination && !excused && ours_.termination_type != stock_.termination_type) {
      Differ(-1, std::string("termination: ours ") +
                     ceres::TerminationTypeToString(ours_.termination_type) + " (" + ours_.message +
                     "), stock " + ceres::TerminationTypeToString(stock_.termination_type) + " (" +
                     stock_.message + ")");
    }
    const int count = static_cast<int>(ours_.iterations.size());
    const int stock_count = static_cast<int>(stock_.iterations.size());
    const int surplus = std::abs(count - stock_count);
    const double iteration_tolerance = std::max(tolerances_.iterations, excuse_.iterations);
    if (surplus > iteration_tolerance) {
      Differ(std::min(count, stock_count),
             Words("number of iterations", std::max(0, count - 1), std::max(0, stock_count - 1),
                   surplus, iteration_tolerance));
    }
    CompareSolutions(surplus);
  }

  void CompareSolutions(int surplus) {
    const bool ends_elsewhere = tolerances_.traces && (surplus > 0 || rounding_decided_);
    const double cost_tolerance =
        std::max({tolerances_.cost, ends_elsewhere ? tolerances_.function_tolerance : 0.0,
                  excuse_.final_cost});
    if (!CostsAgree(result_.cost_difference, cost_tolerance)) {
      Differ(-1, Words("final cost", ours_.final_cost, stock_.final_cost, result_.cost_difference,
                       cost_tolerance));
    }
    const ParameterDifference& worst = result_.parameters;
    const double parameter_tolerance = std::max(tolerances_.parameters, excuse_.parameters);
    if (worst.relative > parameter_tolerance &&
        std::abs(worst.ours - worst.stock) > SurplusMotion()) {
      std::ostringstream what;
      what << "parameter block " << worst.block << " of size " << worst.size << ", component "
           << worst.component;
      Differ(-1, Words(what.str(), worst.ours, worst.stock, worst.relative, parameter_tolerance));
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
        motion +=
            summary->iterations[k].step_is_successful ? summary->iterations[k].step_norm : 0.0;
      }
    }
    return motion;
  }

  const JudgedTolerances& tolerances_;
  const Excuse& excuse_;
  CrossCheckResult& result_;
  const ceres::Solver::Summary& ours_;
  const ceres::Solver::Summary& stock_;
  const double smallest_cost_;
  bool radius_is_comparable_ = true;
  bool rounding_decided_ = false;
};

}  // namespace

JudgedTolerances TolerancesFor(const SolveOptions& asked, const ceres::Solver::Options& options) {
  const CrossCheckOptions& check = asked.cross_check;
  const bool exact = asked.mode == SolveMode::kExact;
  JudgedTolerances tolerances;
  tolerances.cost = check.cost_tolerance.value_or(exact ? 1e-9 : options.function_tolerance);
  tolerances.lower_cost = exact ? tolerances.cost : kInfinity;
  tolerances.parameters = check.parameter_tolerance.value_or(exact ? 1e-6 : kInfinity);
  tolerances.iterations = check.iteration_tolerance ? *check.iteration_tolerance
                          : exact                   ? 1.0
                                                    : kInfinity;
  tolerances.radius = check.radius_tolerance.value_or(1e-6);
  tolerances.function_tolerance = options.function_tolerance;
  tolerances.max_seconds = options.max_solver_time_in_seconds;
  tolerances.traces = exact;
  return tolerances;
}

void Compare(const UserState& layout, const SolvedStates& states,
             const JudgedTolerances& tolerances, const Excuse& excuse, CrossCheckResult* result) {
  Comparison(tolerances, excuse, result).Run(layout, states);
}

void Widen(const CrossCheckResult& pair, double factor, Excuse* excuse) {
  const std::vector<ceres::IterationSummary>& x = pair.ours.iterations;
  const std::vector<ceres::IterationSummary>& y = pair.stock.iterations;
  const double smallest = SmallestCost(pair.ours);
  const std::size_t common = std::min(x.size(), y.size());
  double cost = 0.0;
  double radius = 0.0;
  std::size_t k = 0;
  for (; k < common && static_cast<int>(k) != pair.first_different_iteration; ++k) {
    if (x[k].step_is_valid != y[k].step_is_valid ||
        x[k].step_is_successful != y[k].step_is_successful) {
      break;
    }
    cost = std::max(cost, std::abs(RelativeCost(x[k].cost, y[k].cost, smallest)));
    radius = std::max(radius, RadiusDifference(x[k], y[k]));
    excuse->costs.resize(std::max(excuse->costs.size(), k + 1));
    excuse->radii.resize(excuse->costs.size());
    excuse->costs[k] = std::max(excuse->costs[k], factor * cost);
    excuse->radii[k] = std::max(excuse->radii[k], factor * radius);
  }
  if (k < common) {
    excuse->first_different_iteration =
        std::min(excuse->first_different_iteration, static_cast<int>(k));
  }
  excuse->final_cost = std::max(excuse->final_cost, factor * std::abs(pair.cost_difference));
  excuse->parameters = std::max(excuse->parameters, factor * pair.parameters.relative);
  // How long a trace goes on is no more judged than where it goes.
  const double surplus =
      k < common ? kInfinity
                 : std::abs(static_cast<double>(x.size()) - static_cast<double>(y.size()));
  excuse->iterations = std::max(excuse->iterations, factor * surplus);
  excuse->terminations =
      excuse->terminations || pair.ours.termination_type != pair.stock.termination_type;
}

}  // namespace inceres::internal
