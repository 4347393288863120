#include "inceres/ceres/covariance.h"

#include <memory>
#include <utility>

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
  ours_.reset();
  auto ours = std::make_unique<internal::ProblemCovariance>();
  const Outcome outcome = ours->Compute(options_, covariance_blocks, *problem,
                                        internal::EvaluationCallbackOf(*problem, callback_));
  report_ = {outcome == Outcome::kDeclined, ours->message()};
  if (outcome == Outcome::kComputed) {
    ours_ = std::move(ours);
    return true;
  }
  ours.reset();
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

bool Covariance::GetCovarianceBlock(const double* a, const double* b, double* block) const {
  return stock_ != nullptr  ? stock_->GetCovarianceBlock(a, b, block)
         : ours_ != nullptr ? ours_->GetBlock(a, b, /*ambient=*/true, block)
                            : NotComputed();
}

bool Covariance::GetCovarianceBlockInTangentSpace(const double* a, const double* b,
                                                  double* block) const {
  return stock_ != nullptr  ? stock_->GetCovarianceBlockInTangentSpace(a, b, block)
         : ours_ != nullptr ? ours_->GetBlock(a, b, /*ambient=*/false, block)
                            : NotComputed();
}

bool Covariance::GetCovarianceMatrix(const std::vector<const double*>& blocks,
                                     double* matrix) const {
  return stock_ != nullptr  ? stock_->GetCovarianceMatrix(blocks, matrix)
         : ours_ != nullptr ? ours_->GetMatrix(blocks, /*ambient=*/true, matrix)
                            : NotComputed();
}

bool Covariance::GetCovarianceMatrixInTangentSpace(const std::vector<const double*>& blocks,
                                                   double* matrix) const {
  return stock_ != nullptr  ? stock_->GetCovarianceMatrixInTangentSpace(blocks, matrix)
         : ours_ != nullptr ? ours_->GetMatrix(blocks, /*ambient=*/false, matrix)
                            : NotComputed();
}

}  // namespace inceres
