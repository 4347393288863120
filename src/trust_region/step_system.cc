// Who looks at the linear systems of steps: a member of TrustRegionMinimizer.
#include <algorithm>
#include <vector>

#include "trust_region/trust_region_minimizer.h"

namespace inceres::internal {
namespace {

void AddBlocksOf(const Linearization& factors, const Layout& layout, StepSystem* system) {
  for (int i = 0; i < factors.num_factors; ++i) {
    for (int s = 0; s < factors.num_slots; ++s) {
      const VariableId id = factors.graph->Variables(factors.id, i)[s];
      const int position = layout.Position(id);
      if (position >= 0) {
        const JacobianView& view = factors.views[s];
        system->blocks.push_back({factors.id, i, id, factors.residual_size,
                                  layout.TangentSize(position), view.data + i * view.factor_stride,
                                  view.row_stride});
      }
    }
  }
}

}  // namespace

void TrustRegionMinimizer::ShowSystem() {
  StepSystemObserver* const observer = loop_.system_observer;
  if (observer == nullptr || !observer->Wants(iteration_.iteration)) {
    return;
  }
  const Layout& layout = evaluator_.layout();
  StepSystem system;
  system.iteration = iteration_.iteration;
  for (const Linearization& factors : evaluator_.families()) {
    AddBlocksOf(factors, layout, &system);
    system.residuals.push_back(factors.residuals.data());
  }
  system.first_entry.resize(layout.position.size());
  std::transform(
      layout.position.begin(), layout.position.end(), system.first_entry.begin(),
      [&layout](int position) { return position < 0 ? -1 : layout.packed_offset[position]; });
  system.scale = scale_;
  system.solution = trial_.step();
  strategy_->GetLastSolve(&system.damping, &system.solution);
  observer->See(system);
}

}  // namespace inceres::internal
