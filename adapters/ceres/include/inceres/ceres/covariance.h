#pragma once

#include <memory>
#include <string>
#include <utility>
#include <vector>

#include <ceres/covariance.h>
#include <ceres/evaluation_callback.h>
#include <ceres/problem.h>

#include "inceres/export.h"

namespace inceres {

namespace internal {
class ProblemCovariance;
}

/// ceres::Covariance by inceres: the same calls, the same numbers, the same answers, sooner. For
/// a FactorGraph see GraphCovariance, which this is made of.
///
/// Instead of a QR factorization of the whole Jacobian and a solve for every column: points (blocks
/// of up to four unknowns) are eliminated, S is factored once, and the blocks of the inverse are
/// taken from that factor, those of points in full, not for known cameras.
///
/// DENSE_SVD takes the singular values of the whole Jacobian, with Ceres's rank rules.
///
/// Of SPARSE_QR, variances inflated more than 1e8-fold over those with all else known, of which
/// normal equations lose too many digits, come from a QR of the Jacobian. Stock computes DENSE_SVD
/// with options out of range, an invalid problem, what there is no memory for, and misuse for which
/// Ceres ends the process, as a pair given twice. report() says so.
///
/// Compute returns false where the Jacobian is rank deficient: of SPARSE_QR by the same measure,
/// now with points not known, above 1e12, which does not depend on the units of a parameter block
/// as stock's rule does; by that rule too; and where points leave a block nothing but rounding. The
/// log and report() name how many directions are open, and blocks that move along them.
///
/// Threads: one caller. Cost functions are evaluated on num_threads threads; the result is the
/// same to the last bit for any number.
class INCERES_EXPORT Covariance {
 public:
  /// How the last Compute went.
  struct Report {
    bool used_stock = false;  ///< stock Ceres computed them
    std::string message;      ///< why stock was used, or why there is no covariance; else empty
  };

  /// Holds no covariances yet.
  explicit Covariance(const ceres::Covariance::Options& options);
  ~Covariance();
  Covariance(const Covariance&) = delete;
  Covariance& operator=(const Covariance&) = delete;

  /// The problem's own ceres::Problem::Options::evaluation_callback, not owned, which Ceres up to
  /// 2.1 shows to nobody: called once before cost functions are evaluated.
  void SetEvaluationCallback(ceres::EvaluationCallback* callback);

  /// As ceres::Covariance::Compute. All residual blocks with a variable block are evaluated once,
  /// at the values the parameter blocks have.
  bool Compute(const std::vector<std::pair<const double*, const double*>>& covariance_blocks,
               ceres::Problem* problem);
  /// The same, of all pairs of these blocks.
  bool Compute(const std::vector<const double*>& parameter_blocks, ceres::Problem* problem);

  /// As the functions of ceres::Covariance, but that false, and a line in the log, is the answer
  /// where Ceres ends the process: before Compute, or after it has returned false.
  bool GetCovarianceBlock(const double* parameter_block1, const double* parameter_block2,
                          double* covariance_block) const;
  /// The same, not lifted to the ambient space.
  bool GetCovarianceBlockInTangentSpace(const double* parameter_block1,
                                        const double* parameter_block2,
                                        double* covariance_block) const;
  /// The same, of several blocks at once.
  bool GetCovarianceMatrix(const std::vector<const double*>& parameter_blocks,
                           double* covariance_matrix) const;
  /// The same, of several blocks, not lifted to the ambient space.
  bool GetCovarianceMatrixInTangentSpace(const std::vector<const double*>& parameter_blocks,
                                         double* covariance_matrix) const;

  /// Of the last Compute.
  const Report& report() const { return report_; }

 private:
  ceres::Covariance::Options options_;
  ceres::EvaluationCallback* callback_ = nullptr;
  Report report_;
  std::unique_ptr<internal::ProblemCovariance> ours_;  // null unless it has computed
  std::unique_ptr<ceres::Covariance> stock_;           // the same
};

}  // namespace inceres
