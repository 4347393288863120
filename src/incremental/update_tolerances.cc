#include "incremental/update_tolerances.h"

#include <algorithm>
#include <cmath>
#include <numeric>

#include "base/formatted.h"
#include "base/larger_of.h"
#include "linearize/tangent.h"

namespace inceres::internal {

// gradient_tolerance and parameter_tolerance of an Update, in Ceres's words and meaning
// (docs/ceres_contract.md, "Termination and messages"). Both are off by default; each costs a pass
// over all variables an iteration.
//
// A gradient is believed at the values held only: old Jacobians are renewed before it is summed,
// and then from all factors, since b has the landmarks at their minimum.

namespace {

// max |x − (x ⊞ −g)| of one variable, in its ambient space, clamped to its bounds; `downhill` is
// −g. Ceres's projected gradient: a gradient that points out of a bound counts for nothing.
double ProjectedMaxNorm(const FactorGraph& graph, VariableId id, const double* x,
                        const double* downhill) {
  const int tangent = graph.TangentSize(id), ambient = graph.AmbientSize(id);
  double largest = 0.0;
  const Manifold* manifold = graph.manifold(id);
  const VariableBounds* bounds = graph.HasBounds() ? graph.bounds(id) : nullptr;
  // x − (x − g) without its rounding.
  if (manifold == nullptr && bounds == nullptr) {
    for (int k = 0; k < tangent; ++k) {
      largest = LargerOf(largest, std::fabs(downhill[k]));
    }
    return largest;
  }
  std::vector<double> moved(ambient);
  // Where ⊞ fails nothing is known of the gradient, and no tolerance is met.
  if (!MoveVariable(graph, id, x, downhill, moved.data())) {
    return HUGE_VAL;
  }
  for (int k = 0; k < ambient; ++k) {
    if (bounds != nullptr) {
      moved[k] = std::clamp(moved[k], bounds->lower[k], bounds->upper[k]);
    }
    largest = LargerOf(largest, std::fabs(x[k] - moved[k]));
  }
  return largest;
}

// Frames and landmarks that are not constant, also those outside S: undetermined ones have a
// gradient too.
template <typename Visit>
void ForEachMoving(const IncrementalSystem& system, const Visit& visit) {
  for (const IncrementalSchur::Frame& frame : system.schur().frames()) {
    if (frame.id >= 0 && !frame.held) {
      visit(frame.id, frame.quad);
    }
  }
  for (const IncrementalSchur::Landmark& landmark : system.schur().landmarks()) {
    if (landmark.id >= 0 && !landmark.held) {
      visit(landmark.id, landmark.quad);
    }
  }
}

}  // namespace

// The step first: it costs norms only.
bool UpdateTolerances::EndUpdate() {
  return (context_.options.parameter_tolerance > 0.0 && EndByStep()) ||
         (context_.options.gradient_tolerance > 0.0 && EndByGradient());
}

// No system was solved here: what the summary has is of before the last step, or of none.
bool UpdateTolerances::Converged(const std::string& message) {
  context_.summary->remaining_decrease = -1.0;
  context_.Finish(Termination::kConvergence, message.c_str());
  return true;
}

bool UpdateTolerances::EndByStep() {
  // No step yet, or it was shortened: short for another reason.
  if (whole_step_ < 0.0) {
    return false;
  }
  double squared = 0.0;
  // ‖x‖ in the ambient spaces, as in Ceres.
  ForEachMoving(context_.system, [&](VariableId id, std::int32_t /*quad*/) {
    const double* x = context_.system.variables().current(id);
    squared += std::inner_product(x, x + context_.system.graph().AmbientSize(id), x, 0.0);
  });
  const double tolerance = context_.options.parameter_tolerance;
  // The tolerance is added to ‖x‖ so that an x of zero divides.
  const double relative = whole_step_ / (std::sqrt(squared) + tolerance);
  // Written so that a NaN is no convergence.
  return relative <= tolerance &&
         Converged(Formatted("Parameter tolerance reached. Relative step_norm: %e <= %e.", relative,
                             tolerance));
}

// b and η are what is known of the gradient for nothing: with the landmarks at their minimum, and
// by Jacobians that may be old. Only where they are small it is worth while to look closer.
bool UpdateTolerances::EndByGradient() {
  double largest = 0.0, norm = 0.0;
  context_.system.schur().RhsNorms(&largest, &norm);
  // Written so that a NaN is no convergence.
  if (!(largest <= context_.options.gradient_tolerance)) {
    return false;
  }
  // Any error at all, which the rules of relinearization would allow.
  if (MarkOld() && !linearization_.Relinearize()) {
    return true;
  }
  largest = GradientMaxNorm();
  return largest <= context_.options.gradient_tolerance &&
         Converged(Formatted("Gradient tolerance reached. Gradient max norm: %e <= %e", largest,
                             context_.options.gradient_tolerance));
}

// Marks every factor whose Jacobian is of other values. True if there are any.
bool UpdateTolerances::MarkOld() {
  bool any = false;
  for (const IncrementalFamily& family : context_.system.families()) {
    for (int i = 0; i < family.num_places(); ++i) {
      if (family.weighed().linearized(i) && family.weighed().SquaredError(i) > 0.0) {
        context_.system.MarkDirty({family.id(), i});
        any = true;
      }
    }
  }
  return any;
}

double UpdateTolerances::GradientMaxNorm() const {
  const std::ptrdiff_t size = std::ptrdiff_t{context_.system.variables().num_quads()} * kQuad;
  AlignedVector<double> minus_gradient(static_cast<std::size_t>(size), 0.0);
  std::vector<std::int32_t> all;
  for (const IncrementalFamily& family : context_.system.families()) {
    all.clear();
    for (int i = 0; i < family.num_places(); ++i) {
      if (family.weighed().linearized(i)) {
        all.push_back(i);
      }
    }
    family.SubtractGradient(all, minus_gradient.data());
  }
  double largest = 0.0;
  ForEachMoving(context_.system, [&](VariableId id, std::int32_t quad) {
    largest =
        LargerOf(largest, ProjectedMaxNorm(context_.system.graph(), id,
                                           context_.system.variables().current(id),
                                           minus_gradient.data() + std::ptrdiff_t{quad} * kQuad));
  });
  return largest;
}

}  // namespace inceres::internal
