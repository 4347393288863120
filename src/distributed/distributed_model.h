#pragma once

#include <memory>
#include <vector>

#include "distributed/communicator.h"
#include "distributed/frame_exchange.h"
#include "distributed/ranked_aggregates.h"
#include "distributed/reduced_system.h"
#include "distributed/shared_frames.h"
#include "inceres/distributed/distributed_solver.h"
#include "linearize/hessian.h"
#include "schur/elimination.h"
#include "trust_region/linear_model.h"

namespace inceres::internal {

/// The linear model of a problem that lies in parts on the ranks: packed vectors are those of this
/// rank, frames and landmarks, where the entries of a frame are the same on all ranks that have it.
/// Landmarks are eliminated and substituted where they are; of frames the gradient, the diagonal,
/// b and the step go through their owners.
class DistributedModel final : public LinearModel {
 public:
  /// Collective, as all calls. Throws what PETSc cannot do.
  DistributedModel(const DistributedOptions& options, const Communicator& ranks,
                   const SharedFrames& frames, const Evaluator& evaluator, Status* status);
  ~DistributedModel() override;

  void Refresh() override;
  const std::vector<double>& Gradient() const override { return gradient_; }
  const std::vector<double>& Diagonal() const override { return diagonal_; }
  Status Solve(const double* damping, double* step) override;
  void ScaleColumnsBy(const std::vector<double>& scale) override;
  int num_iterations() const override;
  const char* SolverName() const override { return solver_->Name(); }
  void Describe(WorkCounts* work) const override;
  double Dot(const std::vector<double>& a, const std::vector<double>& b) const override;
  bool IsFinite(const std::vector<double>& v) const override;

  const FrameExchange& exchange() const { return exchange_; }
  /// Seconds in products with S, exchange included; 0 where S is factored.
  double product_seconds() const { return system_.product_seconds(); }
  std::int64_t num_products() const { return system_.num_products(); }

 private:
  RowProducts MultiplyJacobian(const double* v) override;
  void GatherFrames(const std::vector<double>& own, std::vector<double>* all);

  const Communicator& ranks_;
  const SharedFrames& frames_;
  LandmarkIncidences incidences_;
  std::unique_ptr<RankedAggregates> aggregates_;  // of a two-level preconditioner
  FramePlans plans_;
  Hessian hessian_;
  Elimination elimination_;
  const RankedParts parts_;
  FrameExchange exchange_;
  JacobianProduct rows_;
  ReducedSystem system_;
  std::unique_ptr<DistributedReducedSolver> solver_;
  std::vector<double> gradient_;
  std::vector<double> diagonal_;
  std::vector<double> owned_;  // workspaces of owned frames
  std::vector<double> owned_b_;
  std::vector<double> owned_step_;
};

}  // namespace inceres::internal
