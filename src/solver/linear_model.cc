#include "solver/linear_model.h"

#include "linearisation/row_products.h"
#include "solver/dense_qr_model.h"
#include "solver/schur_model.h"

namespace inceres::internal {

double LinearModel::Quadratic(const double* v) const {
  return MultiplyJacobian(evaluator_, v).squared_norm;
}

double LinearModel::ModelDecrease(const double* v) const {
  return MultiplyJacobian(evaluator_, v).model_decrease;
}

std::unique_ptr<LinearModel> MakeLinearModel(const SolverOptions& options, const Evaluator& evaluator, StageSeconds* seconds,
                                             Status* status) {
  if (options.linear_model == LinearModelKind::kDenseQr) {
    *status = Status::Ok();
    return std::make_unique<DenseQrModel>(evaluator, seconds);
  }
  if (evaluator.layout().num_landmarks() == 0) {
    return std::make_unique<PlainModel>(options, evaluator, seconds, status);
  }
  return std::make_unique<SchurModel>(options, evaluator, seconds, status);
}

}  // namespace inceres::internal
