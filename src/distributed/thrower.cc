#include "distributed/thrower.h"

#include <vector>

namespace inceres::internal {
namespace {

template <typename Evaluate>
bool Throws(const Evaluate& evaluate) {
  try {
    evaluate();
  } catch (...) {
    return true;
  }
  return false;
}

}  // namespace

std::string DescribeThrower(Evaluator* evaluator) {
  const FactorGraph& graph = evaluator->graph();
  for (Linearization& cache : evaluator->families()) {
    for (int i = 0; i < cache.num_factors; ++i) {
      if (graph.HasFactor(cache.id, i) && (Throws([&] { cache.EvaluateCandidate(i, i + 1); }) ||
                                           Throws([&] { cache.Linearize(i, i + 1); }))) {
        return graph.DescribeFactor(cache.id, i);
      }
    }
  }
  return "a factor that did not throw again";
}

}  // namespace inceres::internal
