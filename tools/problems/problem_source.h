#pragma once

#include <memory>
#include <string>
#include <vector>

#include <ceres/ordered_groups.h>
#include <ceres/problem.h>

#include "inceres/io/bal.h"
#include "inceres/problem/factor_graph.h"
#include "inceres/status.h"
#include "tools/problems/bal_ceres_problem.h"
#include "tools/problems/gauge.h"
#include "tools/problems/loss_spec.h"

namespace inceres::tools {

/// A problem from a file that is solved again and again, each time from the same start values on
/// freshly built objects.
class ProblemSource {
 public:
  /// One copy for Ceres: the parameter values and the problem over them.
  struct CeresInstance {
    std::vector<double> parameters;
    std::unique_ptr<ceres::Problem> problem;
    /// null if there are no landmarks
    std::shared_ptr<ceres::ParameterBlockOrdering> landmarks_first;
  };

  virtual ~ProblemSource() = default;

  /// "49 cameras, 7776 points, 31843 observations".
  virtual std::string Describe() const = 0;
  virtual bool HasLandmarks() const = 0;

  virtual Status MakeCeresInstance(const LossSpec& loss, CeresInstance* instance) const = 0;

  /// The same problem as a factor graph of built-in factors; kInvalidArgument if there are none for
  /// it.
  virtual Status MakeGraph(const LossSpec& loss, std::unique_ptr<FactorGraph>* graph) const = 0;

  /// The graph's values, laid out like CeresInstance::parameters.
  virtual std::vector<double> ParametersOf(const FactorGraph& graph) const = 0;

  /// Largest difference between two solutions after the gauge is removed.
  virtual GeometryDifference Difference(const std::vector<double>& a,
                                        const std::vector<double>& b) const = 0;
};

/// A BAL problem; parameters are the cameras, then the points.
class BalSource : public ProblemSource {
 public:
  /// Requires bal.Validate().ok(). `jacobians` are those of the cost functions for Ceres.
  explicit BalSource(BalProblem bal, BalJacobians jacobians = BalJacobians::kAutoDiff)
      : bal_(std::move(bal)), jacobians_(jacobians) {}

  const BalProblem& bal() const { return bal_; }
  /// The problem with other parameter values.
  BalProblem WithParameters(const std::vector<double>& parameters) const;

  std::string Describe() const override;
  bool HasLandmarks() const override { return true; }
  Status MakeCeresInstance(const LossSpec& loss, CeresInstance* instance) const override;
  Status MakeGraph(const LossSpec& loss, std::unique_ptr<FactorGraph>* graph) const override;
  std::vector<double> ParametersOf(const FactorGraph& graph) const override;
  GeometryDifference Difference(const std::vector<double>& a,
                                const std::vector<double>& b) const override;

 private:
  std::vector<double> Parameters() const;

  BalProblem bal_;
  BalJacobians jacobians_;
};

/// Opens "bal:FILE", "g2o:FILE", "vio:FILE" or "vio:PRESET". `jacobians` are for bal: the cost
/// functions of vio: are analytic, those of g2o: AutoDiff.
Status OpenProblem(const std::string& specification, std::unique_ptr<ProblemSource>* source,
                   BalJacobians jacobians = BalJacobians::kAutoDiff);

}  // namespace inceres::tools
