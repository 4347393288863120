#include "tools/fuzz/trace.h"

#include <algorithm>
#include <cmath>
#include <cstdio>
#include <limits>
#include <memory>

#include "tools/fuzz/solver.h"

namespace inceres::fuzz {
namespace {

constexpr double kStockAgrees = 1e-8;
constexpr double kOursAgrees = 1e-6;
constexpr double kOursShare = 100.0;
constexpr double kLastDigits = 1e-15;  // of a cost
constexpr double kNudge = 1e-14;       // of the values next to the start, relative

ceres::Solver::Summary SolveFrom(const std::vector<double>& start,
                                 const ceres::Solver::Options& options, World* world) {
  ceres::Solver::Summary summary;
  world->SetValues(start);
  ceres::Solver::Options alone = options;
  alone.num_threads = 1;                            // the sums of several depend on which is first
  if (options.linear_solver_ordering != nullptr) {  // stock edits it
    alone.linear_solver_ordering =
        std::make_shared<ceres::ParameterBlockOrdering>(*options.linear_solver_ordering);
  }
  SolveByStock(alone, &world->problem(), &summary);
  return summary;
}

}  // namespace

StockTraces::StockTraces(const ceres::Solver::Options& options, const std::vector<double>& start,
                         World* world, Dice* dice) {
  const std::vector<double> values = world->Values();
  summary_ = SolveFrom(start, options, world);
  end_ = world->Values();
  floor_ = kNineDigits * kNineDigits * world->Magnitude();

  ceres::Solver::Options other = options;
  other.linear_solver_type = options.linear_solver_type == ceres::DENSE_QR
                                 ? ceres::DENSE_NORMAL_CHOLESKY
                                 : ceres::DENSE_QR;
  std::vector<double> nudged = start;
  for (double& x : nudged) {
    x *= 1.0 + kNudge * dice->Signed();
  }
  Count(summary_);
  for (const ceres::Solver::Summary& one :
       {SolveFrom(start, other, world), SolveFrom(nudged, options, world)}) {
    distance_ = std::max(distance_, Distance(one));
    Count(one);
  }
  agree_ = distance_ <= kStockAgrees;
  world->SetValues(values);
}

void StockTraces::Count(const ceres::Solver::Summary& one) {
  num_iterations_ = one.termination_type == ceres::CONVERGENCE
                        ? std::max(num_iterations_, static_cast<int>(one.iterations.size()) - 1)
                        : std::numeric_limits<int>::max();
}

// Of the cost, what can move.
bool StockTraces::IsRounding(double cost) const {
  return cost - summary_.fixed_cost <= floor_ + kLastDigits * cost;
}

// The largest relative difference of costs along the way; infinite if the ways are not the same.
// Where both have come to a cost that is rounding, so is what follows: whether a step is taken, and
// which test ends the solve.
double StockTraces::Distance(const ceres::Solver::Summary& other) const {
  constexpr double kInfinity = std::numeric_limits<double>::infinity();
  const std::size_t num_common = std::min(summary_.iterations.size(), other.iterations.size());
  double distance = 0.0;
  for (std::size_t i = 0; i < num_common; ++i) {
    const ceres::IterationSummary& a = summary_.iterations[i];
    const ceres::IterationSummary& b = other.iterations[i];
    if (IsRounding(a.cost) && IsRounding(b.cost)) {
      return distance;
    }
    if (a.step_is_successful != b.step_is_successful) {
      return kInfinity;
    }
    distance = std::max(distance, std::abs(a.cost - b.cost) / (std::abs(a.cost) + floor_ +
                                                               std::numeric_limits<double>::min()));
  }
  return other.termination_type == summary_.termination_type &&
                 other.iterations.size() == summary_.iterations.size()
             ? distance
             : kInfinity;
}

bool StockTraces::EndedByLength() const {
  return summary_.message.rfind("Gradient tolerance", 0) == 0 ||
         summary_.message.rfind("Parameter tolerance", 0) == 0;
}

std::optional<std::string> StockTraces::Difference(const ceres::Solver::Summary& ours) const {
  const double distance = Distance(ours);
  if (distance <= std::max(kOursAgrees, kOursShare * distance_)) {
    return std::nullopt;
  }
  char text[300];
  std::snprintf(text, sizeof text,
                "ours: %s, %zu iterations, cost %.12g; stock: %s, %zu iterations, cost %.12g; "
                "costs differ by %.2g",
                ceres::TerminationTypeToString(ours.termination_type), ours.iterations.size(),
                ours.final_cost, ceres::TerminationTypeToString(summary_.termination_type),
                summary_.iterations.size(), summary_.final_cost, distance);
  return text + std::string(" (") + ours.message + "; " + summary_.message + ")";
}

}  // namespace inceres::fuzz
