#include "adapters/ceres/plan/iterative_choice.h"

#include "adapters/ceres/plan/landmark_selection.h"
#include "adapters/ceres/read/factor_shapes.h"

namespace inceres::internal {
namespace {

// Scalar unknowns left when the landmarks are eliminated.
int ReducedSize(const ProblemView& view, const OrderingView& ordering, ceres::LinearSolverType type) {
  const LandmarkSelection landmarks = SelectLandmarks(view, ordering, FindShapes(view), type);
  int size = 0;
  for (std::size_t b = 0; b < view.blocks.size(); ++b) {
    size += view.blocks[b].reduced() && landmarks.is_landmark[b] == 0 ? view.blocks[b].tangent_size : 0;
  }
  return size;
}

}  // namespace

void ChooseIterativeSolver(const ceres::Solver::Options& options, const ProblemView& view, const OrderingView& ordering,
                           int max_direct_size, IncrementalOptions* core) {
  const ceres::LinearSolverType type = IncrementalLinearSolver(options, ordering);
  if (!IsIterative(type) || core->reduced_solver != ReducedSolverKind::kAutomatic ||
      view.reduced.num_effective_parameters <= max_direct_size || ReducedSize(view, ordering, type) <= max_direct_size) {
    return;
  }
  core->reduced_solver = ReducedSolverKind::kPcg;
  if (core->batch_share > 0.0) {
    core->batch_share = 1.0;  // the batch solver's solvers are direct
  }
}

}  // namespace inceres::internal
