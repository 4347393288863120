#include "trust_region/linear_model.h"

#include "trust_region/dense_model.h"
#include "trust_region/dense_qr_model.h"
#include "trust_region/dynamic_model.h"
#include "trust_region/iterative_model.h"
#include "trust_region/large_block_schur_model.h"
#include "trust_region/schur_model.h"
#include "trust_region/step_way.h"

namespace inceres::internal {
namespace {

// Whether steps may come from conjugate gradients where these are cheaper.
bool MayBeIterative(const SolverOptions& options, const Evaluator& evaluator) {
  const bool damped = options.strategy == TrustRegionStrategyKind::kLevenbergMarquardt ||
                      options.strategy == TrustRegionStrategyKind::kMarquardt;
  return damped && options.linear_model == LinearModelKind::kAutomatic &&
         options.reduced_solver == ReducedSolverKind::kAutomaticInexact &&
         !options.reduced_solver_factory && !evaluator.leaves_out_zero_blocks() &&
         evaluator.layout().num_landmarks() > 0;
}

}  // namespace

std::unique_ptr<LinearModel> MakeLinearModel(const SolverOptions& options,
                                             const Evaluator& evaluator,
                                             const std::vector<VariableId>* eliminated,
                                             Status* status) {
  const bool by_qr = options.linear_model == LinearModelKind::kDenseQr;
  if (eliminated != nullptr) {
    return std::make_unique<LargeBlockSchurModel>(options, evaluator, *eliminated, status);
  }
  if (IsIterative(options.linear_model)) {
    return std::make_unique<IterativeModel>(options.conjugate_gradients, Unfinished::kAsCeres,
                                            evaluator, status);
  }
  if (evaluator.storage() == JacobianStorage::kWholeRows) {
    *status = Status::Ok();
    return by_qr ? std::make_unique<DenseColumnsQrModel>(evaluator)
                 : std::make_unique<DenseModel>(evaluator);
  }
  if (by_qr) {
    *status = Status::Ok();
    return std::make_unique<DenseQrModel>(evaluator);
  }
  if (evaluator.leaves_out_zero_blocks()) {
    *status = Status::Ok();
    return std::make_unique<DynamicModel>(options, evaluator);
  }
  if (evaluator.layout().num_landmarks() == 0) {
    return std::make_unique<PlainModel>(options, evaluator, status);
  }
  const StepWay way =
      MayBeIterative(options, evaluator) ? PredictSteps(evaluator).Cheapest() : StepWay::kFactor;
  if (way != StepWay::kFactor) {
    return std::make_unique<IterativeModel>(OptionsOf(way, options.conjugate_gradients),
                                            Unfinished::kMovesAll, evaluator, status);
  }
  return std::make_unique<SchurModel>(options, evaluator, status);
}

}  // namespace inceres::internal
