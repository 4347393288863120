#include "trust_region/coordinate_descent.h"

#include <algorithm>

#include "base/counting_sort.h"

// A round of coordinate descent over groups of independent variables (Ruhe & Wedin 1980;
// docs/ceres_contract.md, "Inner iterations"). Within a group no factor sees two variables, so
// tasks write to different variables, residuals and kept evaluations, and nothing depends on
// their order or number. Groups follow each other, each from where the one before has led.

namespace inceres::internal {
namespace {

constexpr int kTasksPerThread = 8;
constexpr int kMaxVariablesPerTask = 64;

}  // namespace

CoordinateDescent::CoordinateDescent(const InnerDescent& descent, CeresRules rules,
                                     Evaluator* evaluator)
    : descent_(descent), rules_(rules), evaluator_(*evaluator) {
  CollectSightings();
}

// By variable, of each by family, of each ascending.
void CoordinateDescent::CollectSightings() {
  const FactorGraph& graph = evaluator_.graph();
  // Numbered group by group; variables in no group have no number and are held.
  index_.assign(graph.num_variables(), -1);
  int num_variables = 0;
  for (const std::vector<VariableId>& group : descent_.groups) {
    for (const VariableId id : group) {
      index_[id] = num_variables++;
    }
  }
  const auto for_each_sighting = [&](const auto& add) {
    for (const Linearization& family : evaluator_.families()) {
      for (int i = 0; i < family.num_factors; ++i) {
        for (int s = 0; s < family.num_slots; ++s) {
          const VariableId id = graph.Variables(family.id, i)[s];
          if (id >= 0 && index_[id] >= 0) {
            add(index_[id], Sighting{family.id, i, s});
          }
        }
      }
    }
  };
  CountingSort(num_variables, for_each_sighting, &begin_, &sightings_);
}

void CoordinateDescent::Run() {
  // Parameters of all factors point to the candidate, which variables are moved in.
  evaluator_.points().PointTo(/*candidate=*/true);
  // Where a group leaves its variables the next one begins, or the next iteration.
  KeepEvaluations(!descent_.asks_as_ceres, &evaluator_.families());
  const Executor& executor = evaluator_.executor();
  for (const std::vector<VariableId>& group : descent_.groups) {
    const int count = static_cast<int>(group.size());
    // Several tasks a thread, for variables differ in what they cost; not too small, for each
    // makes a minimizer with memory of its own.
    const int grain =
        std::clamp(count / (kTasksPerThread * executor.num_threads()), 1, kMaxVariablesPerTask);
    executor.For(count, grain, [&](int begin, int end) {
      BlockMinimizer minimizer(rules_, descent_.asks_as_ceres,
                               sightings_.data() + sightings_.size(), &evaluator_);
      for (int k = begin; k < end; ++k) {
        const int index = index_[group[k]];
        minimizer.Minimize(group[k], sightings_.data() + begin_[index],
                           sightings_.data() + begin_[index + 1]);
      }
    });
  }
}

}  // namespace inceres::internal
