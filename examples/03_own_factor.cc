// Lesson 3, a factor of your own: the range to a beacon, with analytic Jacobians, which are checked
// before they are trusted.
//
//     03_own_factor
#include <cmath>
#include <cstddef>
#include <cstdio>
#include <iostream>
#include <memory>
#include <vector>

#include "inceres/problem/ambient_family.h"
#include "inceres/problem/check_jacobians.h"
#include "inceres/solver/solver.h"

namespace {

// [quoted in docs/lessons/03_own_factor.md]
// residual = (‖p − b‖ − range) / sigma, of a place p and a beacon b, both 3 meters long.
class RangeFamily : public inceres::AmbientFamily<RangeFamily> {
 public:
  struct Measurement {
    double range = 0.0;  // meters
    double sigma = 1.0;
  };
  // Residuals; then the ambient and the tangent size of each variable.
  explicit RangeFamily(bool with_mistake = false)
      : AmbientFamily(1, {{3, 3}, {3, 3}}), with_mistake_(with_mistake) {}

  void Add(const Measurement& measurement) { measurements_.push_back(measurement); }
  void Place(int index, const Measurement& m) { PlaceIn(&measurements_, index, m); }
  int size() const override { return static_cast<int>(measurements_.size()); }
  const char* Name() const override { return "range"; }

  bool EvaluateOne(int i, const double* const* x, double* residual, double** jacobians) const {
    const Measurement& m = measurements_[static_cast<std::size_t>(i)];
    const double d[3] = {x[0][0] - x[1][0], x[0][1] - x[1][1], x[0][2] - x[1][2]};
    const double distance = std::hypot(d[0], d[1], d[2]);
    residual[0] = (distance - m.range) / m.sigma;
    for (int slot = 0; slot < 2; ++slot) {
      if (jacobians != nullptr && jacobians[slot] != nullptr) {  // null: cost only, or a constant
        const double sign = slot == 0 || with_mistake_ ? 1.0 : -1.0;
        for (int k = 0; k < 3; ++k) {
          jacobians[slot][k] = sign * d[k] / (distance * m.sigma);
        }
      }
    }
    return distance > 0.0;  // false: cannot be evaluated here
  }

 private:
  bool with_mistake_;  // a sign is forgotten, for the check to find
  std::vector<Measurement> measurements_;
};
// [end of quote]

}  // namespace

int main() {
  const double truth[3] = {3.0, 4.0, 1.5}, start[3] = {0.5, 0.5, 0.5};
  const double beacons[4][3] = {{0, 0, 3}, {10, 0, 2.5}, {10, 8, 3}, {0, 8, 0.5}};

  // [quoted in docs/lessons/03_own_factor.md]
  for (const bool with_mistake : {true, false}) {
    RangeFamily family(with_mistake);
    family.Add({5.0, 0.1});
    const inceres::JacobianReport report = inceres::CheckJacobians(family, 0, {start, beacons[1]});
    std::printf("%d entries: %s\n", report.num_entries,
                report.ok() ? "none is wrong" : report.ToString().c_str());
  }
  // [end of quote]

  // [quoted in docs/lessons/03_own_factor.md]
  inceres::FactorGraph graph;
  const auto ranges = graph.AddFamily(std::make_shared<RangeFamily>());
  const inceres::VariableId place = graph.AddVariable(start, 3, inceres::Role::kFrame);
  for (const auto& beacon : beacons) {
    const double range =
        std::hypot(truth[0] - beacon[0], truth[1] - beacon[1], truth[2] - beacon[2]);
    const inceres::VariableId b = graph.AddBorrowedConstant(beacon, 3);
    graph.AddFactor(ranges, {range, 0.1}, {place, b});
  }
  const inceres::Summary summary = inceres::Solve(inceres::SolverOptions(), &graph);
  // [end of quote]
  if (!summary.IsSolutionUsable()) {
    std::cerr << summary.message << '\n' << summary.detail << '\n';
    return 1;
  }
  const double* found = graph.Values(place);
  std::printf("\n%d iterations, cost %.1f to %.1f\n", summary.num_successful_steps,
              summary.initial_cost, summary.final_cost);
  std::printf("place (%.3f, %.3f, %.3f), truth (%.3f, %.3f, %.3f)\n", found[0], found[1], found[2],
              truth[0], truth[1], truth[2]);
  return 0;
}
