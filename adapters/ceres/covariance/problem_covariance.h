#pragma once

#include <map>
#include <string>
#include <utility>
#include <vector>

#include <ceres/covariance.h>
#include <ceres/evaluation_callback.h>
#include <ceres/problem.h>

#include "adapters/ceres/plan/graph_plan.h"
#include "adapters/ceres/read/introspection.h"
#include "inceres/solver/covariance.h"

namespace inceres::internal {

/// Blocks of the covariance of a ceres::Problem, by the core. Keeps numbers only: neither the
/// problem nor anything of it is looked at once Compute has returned.
class ProblemCovariance {
 public:
  using Pairs = std::vector<std::pair<const double*, const double*>>;

  enum class Outcome {
    kComputed,
    kFailed,   ///< the Jacobian is rank deficient, or it cannot be evaluated: Ceres's false
    kDeclined  ///< not done here, for message(): stock's to do
  };

  /// What ceres::Covariance::Compute does with these pairs. `callback`: the problem's own, or null.
  Outcome Compute(const ceres::Covariance::Options& options, const Pairs& pairs,
                  const ceres::Problem& problem, ceres::EvaluationCallback* callback);
  /// Why it failed or was declined; empty after kComputed.
  const std::string& message() const { return message_; }

  /// As the functions of ceres::Covariance of like names, in the ambient or the tangent space.
  /// False, and said in the log, where the block was not computed.
  bool GetBlock(const double* a, const double* b, bool ambient, double* covariance) const;
  bool GetMatrix(const std::vector<const double*>& blocks, bool ambient, double* covariance) const;

  /// All pairs of these blocks.
  static Pairs AllPairs(const std::vector<const double*>& blocks);

 private:
  struct BlockOfUser {
    const double* values = nullptr;
    int ambient_size = 0;
    int tangent_size = 0;
    VariableId variable = -1;  ///< -1: it is constant, or no residual block touches it
  };

  static std::string FindMisuse(const ProblemView& view, const Pairs& pairs);
  static std::string FindRankRule(const ceres::Covariance::Options& options);
  void RememberBlocks(const ProblemView& view, const Pairs& pairs);
  /// Those without a constant. Notes the variables of all blocks.
  GraphCovariance::Pairs MovingPairs(const ProblemView& view, const GraphPlan& plan,
                                     const Pairs& pairs);
  Outcome Decline(std::string why);
  Outcome Fail(std::string why);
  Outcome ComputeMoving(const ceres::Covariance::Options& options, const Pairs& pairs,
                        ProblemView* view);
  const BlockOfUser* FindBlock(const double* values) const;
  void Lift(const BlockOfUser& a, const BlockOfUser& b, const std::vector<double>& tangent,
            double* covariance) const;

  std::vector<BlockOfUser> blocks_;  // all of the problem, by address
  // Ambient × tangent, row-major, of blocks that were asked for; none: a unit matrix.
  std::map<const double*, std::vector<double>> plus_jacobians_;
  GraphCovariance covariance_;  // tangent
  std::string message_;
};

}  // namespace inceres::internal
