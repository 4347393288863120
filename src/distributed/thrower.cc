#include "distributed/thrower.h"

namespace inceres::internal {

// Finds the factor behind an exception, after the fact: one factor at a time is evaluated until one
// throws again. Costs an evaluation of all factors in the worst case, and is not collective. A
// factor that counts its calls may not throw a second time.

namespace {

// What is thrown is dropped: the message is that of the first time.
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

// Residuals at the candidate come first, then residuals and Jacobians at the current point;
// families in their order, factors by place. Writes into the caches, which the end of the solve
// makes worthless.
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
