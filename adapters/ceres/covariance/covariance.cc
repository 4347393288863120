#include "inceres/ceres/covariance.h"

#include <glog/logging.h>

#include "adapters/ceres/covariance/problem_covariance.h"
#include "adapters/ceres/read/ceres_version.h"

namespace inceres {
namespace {

bool NotComputed() {
  LOG(ERROR) << "inceres: a covariance was asked for before Compute, or after it returned false";
  return false;
}

}  // namespace

Covariance::Covariance(const ceres::Covariance::Options& options) : options_(options) {
}
Covariance::~Covariance() = default;

void Covariance::SetEvaluationCallback(ceres::EvaluationCallback* callback) {
  callback_ = callback;
}

bool Covariance::Compute(
    const std::vector<std::pair<const double*, const double*>>& covariance_blocks,
    ceres::Problem* problem) {
  using Outcome = internal::ProblemCovariance::Outcome;
  stock_.reset();
  ours_ = std::make_unique<internal::ProblemCovariance>();
  const Outcome outcome = ours_->Compute(options_, covariance_blocks, *problem,
                                         internal::EvaluationCallbackOf(*problem, callback_));
  report_ = {outcome == Outcome::kDeclined, ours_->message()};
  if (outcome == Outcome::kComputed) {
    return true;
  }
  ours_.reset();
  if (outcome == Outcome::kFailed) {
    return false;
  }
  stock_ = std::make_unique<ceres::Covariance>(options_);
  const bool computed = stock_->Compute(covariance_blocks, problem);
  if (!computed) {
    stock_.reset();
  }
  return computed;
}

bool Covariance::Compute(const std::vector<const double*>& parameter_blocks,
                         ceres::Problem* problem) {
  return Compute(internal::ProblemCovariance::AllPairs(parameter_blocks), problem);
}

bool Covariance::GetCovarianceBlock(const double* parameter_block1, const double* parameter_block2,
                                    double* covariance_block) const {
  if (stock_ != nullptr) {
    return stock_->GetCovarianceBlock(parameter_block1, parameter_block2, covariance_block);
  }
  return ours_ != nullptr ? ours_->GetBlock(parameter_block1, parameter_block2, /*ambient=*/true,
                                            covariance_block)
                          : NotComputed();
}

bool Covariance::GetCovarianceBlockInTangentSpace(const double* parameter_block1,
                                                  const double* parameter_block2,
                                                  double* covariance_block) const {
  if (stock_ != nullptr) {
    return stock_->GetCovarianceBlockInTangentSpace(parameter_block1, parameter_block2,
                                                    covariance_block);
  }
  return ours_ != nullptr ? ours_->GetBlock(parameter_block1, parameter_block2, /*ambient=*/false,
                                            covariance_block)
                          : NotComputed();
}

bool Covariance::GetCovarianceMatrix(const std::vector<const double*>& parameter_blocks,
                                     double* covariance_matrix) const {
  if (stock_ != nullptr) {
    return stock_->GetCovarianceMatrix(parameter_blocks, covariance_matrix);
  }
  return ours_ != nullptr ? ours_->GetMatrix(parameter_blocks, /*ambient=*/true, covariance_matrix)
                          : NotComputed();
}

bool Covariance::GetCovarianceMatrixInTangentSpace(
    const std::vector<const double*>& parameter_blocks, double* covariance_matrix) const {
  if (stock_ != nullptr) {
    return stock_->GetCovarianceMatrixInTangentSpace(parameter_blocks, covariance_matrix);
  }
  return ours_ != nullptr ? ours_->GetMatrix(parameter_blocks, /*ambient=*/false, covariance_matrix)
                          : NotComputed();
}

}  // namespace inceres
