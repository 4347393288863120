#include "trust_region/linear_model.h"

#include <utility>

#include "trust_region/dense_model.h"
#include "trust_region/iterative_model.h"
#include "trust_region/large_block_schur_model.h"
#include "trust_region/schur_model.h"
#include "trust_region/strategy.h"

namespace inceres::internal {

// Which model represents ½‖f + Jδ‖² (docs/algorithms.md, "Reduced linear systems"). What Ceres's
// options ask for comes first and is not second-guessed, since the trace is to be Ceres's. What is
// left is a choice by structure: dense where J is one small matrix, the pattern renewed where zero
// blocks are left out, no elimination where there are no landmarks, and only then, if inexact steps
// are allowed, a comparison of predicted costs.

namespace {

// Whether steps may come from conjugate gradients where these are cheaper.
bool MayBeIterative(const SolverOptions& options, const Evaluator& evaluator) {
  // Dog-Leg goes with a factor only, as in Ceres.
  return IsDamped(options.strategy) && options.linear_model == LinearModelKind::kAutomatic &&
         options.reduced_solver == ReducedSolverKind::kAutomaticInexact &&
         !options.reduced_solver_factory && !evaluator.leaves_out_zero_blocks() &&
         evaluator.layout().num_landmarks() > 0;
}

}  // namespace

// The prediction may take a symbolic analysis: it is asked for only where its answer may be
// followed.
StepWay ChooseStepWay(const SolverOptions& options, const Evaluator& evaluator,
                      std::unique_ptr<LandmarkIncidences>* incidences) {
  return MayBeIterative(options, evaluator) ? PredictSteps(evaluator, incidences).Cheapest()
                                            : StepWay::kFactor;
}

std::unique_ptr<LinearModel> MakeLinearModel(const SolverOptions& options, StepWay way,
                                             const Evaluator& evaluator,
                                             const std::vector<VariableId>* eliminated,
                                             std::unique_ptr<LandmarkIncidences> incidences,
                                             Status* status) {
  // By options, connections and sizes: no values are looked at.
  const bool by_qr = options.linear_model == LinearModelKind::kDenseQr;
  // Set for kIterativeSchur only (LoopOptions::eliminated).
  if (eliminated != nullptr) {
    return std::make_unique<LargeBlockSchurModel>(options, evaluator, *eliminated, status);
  }
  if (IsIterative(options.linear_model)) {
    return std::make_unique<IterativeModel>(options.conjugate_gradients, Unfinished::kAsCeres,
                                            evaluator, status);
  }
  // The evaluator has decided this already: J lies as whole rows, which only the dense models read.
  if (evaluator.storage() == JacobianStorage::kWholeRows) {
    *status = Status::Ok();
    return by_qr ? std::make_unique<DenseColumnsQrModel>(evaluator)
                 : std::make_unique<DenseModel>(evaluator);
  }
  if (by_qr) {
    *status = Status::Ok();
    return std::make_unique<DenseQrModel>(evaluator);
  }
  // Its pattern comes with each linearization, so nothing can fail, and nothing be planned, before.
  if (evaluator.leaves_out_zero_blocks()) {
    *status = Status::Ok();
    return std::make_unique<DynamicModel>(options, evaluator);
  }
  if (evaluator.layout().num_landmarks() == 0) {
    return std::make_unique<PlainModel>(options, evaluator, nullptr, status);
  }
  if (way != StepWay::kFactor) {
    // Not Ceres's iteration here: landmarks follow in every step.
    return std::make_unique<IterativeModel>(OptionsOf(way, options.conjugate_gradients),
                                            Unfinished::kMovesAll, evaluator, status);
  }
  return std::make_unique<SchurModel>(options, evaluator, std::move(incidences), status);
}

}  // namespace inceres::internal
