#include "trust_region/step_solve.h"

#include <algorithm>
#include <cstdint>
#include <string>
#include <vector>

#include "trust_region/loop_ends.h"

namespace inceres::internal {

// ComputeTrustRegionStep of Ceres's loop (docs/ceres_contract.md, "Trust-region loop"). Three
// outcomes: a valid step, an invalid one (no factor, not finite, nothing promised), which changes
// the damping and costs no evaluation, and an error of another kind, which ends the solve.

namespace {

// Views are where Jacobians are written, which may be a strip that is over.
JacobianView BlockOf(const Linearization& factors, int i, int s) {
  JacobianView block = factors.views[s];
  if (factors.has_whole_rows()) {
    block.data += i * block.factor_stride;
  } else {
    const SlotJacobians& slot = factors.slots[s];
    block = {slot.data + factors.Record(i) * slot.factor_stride, slot.factor_stride,
             slot.row_stride};
  }
  return block;
}

// By factor, whatever the order of their records.
std::vector<double> ResidualsOf(const Linearization& factors) {
  std::vector<double> residuals;
  for (int i = 0; i < factors.num_factors; ++i) {
    const double* const f = factors.residuals.data() +
                            static_cast<std::ptrdiff_t>(factors.Record(i)) * factors.residual_size;
    residuals.insert(residuals.end(), f, f + factors.residual_size);
  }
  return residuals;
}

void AddBlocksOf(const Evaluator& evaluator, const Linearization& factors, StepSystem* system) {
  const Layout& layout = evaluator.layout();
  // Where blocks are left out, what is there may be of an earlier iteration. Elsewhere all of them
  // are written, and whole rows have no offsets to ask.
  const std::int32_t* const offsets =
      evaluator.leaves_out_zero_blocks() ? factors.tangent_offsets.data() : nullptr;
  for (int i = 0; i < factors.num_factors; ++i) {
    for (int s = 0; s < factors.num_slots; ++s) {
      // Places of a factor whose variable does not move have no block.
      const VariableId id = factors.graph->Variables(factors.id, i)[s];
      const int position = layout.Position(id);
      if (position >= 0 && (offsets == nullptr || offsets[factors.Entry(i) + s] >= 0)) {
        const JacobianView block = BlockOf(factors, i, s);
        system->blocks.push_back({factors.id, i, id, factors.residual_size,
                                  layout.TangentSize(position), block.data, block.row_stride});
      }
    }
  }
}

}  // namespace

bool StepSolve::Run(IterationSummary* iteration) {
  StageClock& clock = parts_.clock;
  const double start = clock.now();
  int num_solves = 0;
  // After a rejected Dog-Leg step none may be needed: num_solves is then 0.
  const Status solved =
      parts_.memory.strategy->ComputeStep(&parts_.model, trial_.step().data(), &num_solves);
  // The time of everything the strategy does, which for Dog-Leg is more than a solve.
  iteration->step_solver_time_in_seconds = clock.Read() - start;
  Count(num_solves, iteration);
  if (num_solves > 0) {
    ShowSystem(iteration->iteration);
  }
  // A singular system is a matter of damping; anything else is not.
  if (!solved.ok() && solved.code != StatusCode::kSingular) {
    parts_.summary.detail = solved.message;
    return EndSolve(Termination::kFailure,
                    {"Linear solver failed due to unrecoverable non-numeric "
                     "causes. Please see the error log for clues. "},
                    &parts_.summary);
  }
  // An invalid step is no end: the caller asks GoOnWithout.
  if (!solved.ok() || !parts_.model.IsFinite(trial_.step())) {
    parts_.summary.detail = solved.ok() ? "the step is not finite" : solved.message;
    return true;
  }
  // The model decrease is a pass over J of its own, and decides whether the step is valid.
  const double promise = trial_.FindPromise();
  // NaN is not positive.
  iteration->step_is_valid = promise > 0.0;
  if (iteration->step_is_valid) {
    iteration->model_cost_change = promise;
    num_invalid_ = num_empty_ = 0;
  } else if (promise <= 0.0) {
    ++num_empty_;
  }
  return true;
}

void StepSolve::Count(int num_solves, IterationSummary* iteration) {
  // Ceres counts no iteration where no system was solved, and one for a direct solver.
  iteration->linear_solver_iterations =
      num_solves > 0 && parts_.summary.work.reduced_size > 0 ? parts_.model.num_iterations() : 0;
  parts_.summary.work.num_linear_solves += num_solves;
  parts_.summary.work.num_conjugate_gradients +=
      parts_.model.is_iterative() ? iteration->linear_solver_iterations : 0;
  parts_.summary.work.num_steps_without_landmarks += parts_.model.left_out_landmarks() ? 1 : 0;
}

bool StepSolve::GoOnWithout() {
  // The limit itself is one too many.
  if (++num_invalid_ >= parts_.options.max_num_consecutive_invalid_steps) {
    // A step with whatever damping promises something but for rounding. By Ceres's own rules the
    // gradient's tolerance has ended the solve before.
    if (parts_.loop.judge != nullptr && num_empty_ == num_invalid_) {
      return EndSolve(Termination::kConvergence, {"Steps promise no more than rounding."},
                      &parts_.summary);
    }
    return EndSolve(Termination::kFailure,
                    {"Number of consecutive invalid steps more than "
                     "Solver::Options::max_num_consecutive_invalid_steps: ",
                     std::to_string(parts_.options.max_num_consecutive_invalid_steps).c_str()},
                    &parts_.summary);
  }
  // More damping, or more regularization, for the next one.
  parts_.memory.strategy->StepIsInvalid();
  return true;
}

void StepSolve::ShowSystem(int iteration) const {
  // Only asked for, as every field is filled for it alone.
  StepSystemObserver* const observer = parts_.loop.system_observer;
  if (observer == nullptr || !observer->Wants(iteration)) {
    return;
  }
  const Evaluator& evaluator = parts_.evaluator;
  const Layout& layout = evaluator.layout();
  StepSystem system;
  system.iteration = iteration;
  // Blocks as the factors have them: unscaled, corrected for the loss.
  for (const Linearization& factors : evaluator.families()) {
    AddBlocksOf(evaluator, factors, &system);
    system.residuals.push_back(ResidualsOf(factors));
  }
  system.first_entry.resize(layout.position.size());
  std::transform(
      layout.position.begin(), layout.position.end(), system.first_entry.begin(),
      [&layout](int position) { return position < 0 ? -1 : layout.packed_offset[position]; });
  system.scale = parts_.memory.scale;
  // Dog-Leg has solved for the Gauss–Newton step, and overwrites this.
  system.solution = trial_.step();
  parts_.memory.strategy->GetLastSolve(&system.damping, &system.solution);
  observer->See(system);
}

}  // namespace inceres::internal
