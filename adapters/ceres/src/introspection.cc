#include "adapters/ceres/src/introspection.h"

#include <cstdio>

#include <ceres/cost_function.h>

#include "inceres/graph/ambient_family.h"

namespace inceres::internal {
namespace {

void SetDefect(ProblemView* view, std::string text) {
  if (view->defect.empty()) {
    view->defect = std::move(text);
  }
}

ParameterBlockView ReadParameterBlock(const ceres::Problem& problem, double* values, std::vector<double>* bounds) {
  ParameterBlockView block;
  block.values = values;
  block.ambient_size = problem.ParameterBlockSize(values);
  block.manifold = ManifoldOf(problem, values);
  block.tangent_size = block.manifold != nullptr ? TangentSizeOf(*block.manifold) : block.ambient_size;
  block.constant = block.tangent_size == 0 || problem.IsParameterBlockConstant(values);
  block.first_bound = bounds->size();
  block.bounds = ReadBounds(problem, values, block.ambient_size, block.constant, bounds);
  return block;
}

void CheckValues(const ParameterBlockView& block, ProblemView* view) {
  if (!AreWritten(block.values, block.ambient_size)) {  // what Ceres fills outputs with it rejects as input
    SetDefect(view, Describe(block) + " has a value that is not finite");
  }
}

void ReadParameterBlocks(const ceres::Problem& problem, ProblemView* view) {
  std::vector<double*> pointers;
  problem.GetParameterBlocks(&pointers);
  view->index.Build(pointers);
  view->blocks.reserve(pointers.size());
  for (double* values : pointers) {
    view->blocks.push_back(ReadParameterBlock(problem, values, &view->bounds));
    const ParameterBlockView& block = view->blocks.back();
    CheckValues(block, view);
    const std::size_t count = view->blocks.size();
    if (count > 1) {
      const ParameterBlockView& previous = view->blocks[count - 2];
      if (previous.values + previous.ambient_size > block.values) {
        SetDefect(view, Describe(previous) + " overlaps " + Describe(block));
      }
    }
  }
}

// Names the residual block in program order, which is the order Ceres's own messages use.
std::string ResidualText(const ProblemView& view) {
  return "residual block " + std::to_string(view.residuals.size());
}

// last_residual[b] is the last residual block seen to touch b: a block twice in one residual block shows at once.
void ReadSlots(const std::vector<double*>& pointers, ResidualBlockView* residual, std::vector<int>* last_residual,
               ProblemView* view) {
  const std::vector<std::int32_t>& sizes = residual->cost->parameter_block_sizes();
  const int this_residual = static_cast<int>(view->residuals.size());
  residual->first_slot = static_cast<int>(view->slots.size());
  residual->num_slots = static_cast<int>(pointers.size());
  if (sizes.size() != pointers.size()) {
    SetDefect(view, "the cost function of " + ResidualText(*view) + " has changed its number of parameter blocks");
  }
  for (std::size_t s = 0; s < pointers.size(); ++s) {
    const int b = view->index.Find(pointers[s]);
    view->slots.push_back(b);
    ParameterBlockView& block = view->blocks[static_cast<std::size_t>(b)];
    residual->fixed = residual->fixed && block.constant;
    int& last = (*last_residual)[static_cast<std::size_t>(b)];
    if (last == this_residual) {
      SetDefect(view, Describe(block) + " appears twice in " + ResidualText(*view));
    }
    last = this_residual;
    if (s < sizes.size() && sizes[s] != block.ambient_size) {
      SetDefect(view, "the cost function of " + ResidualText(*view) + " expects another size than that of " + Describe(block));
    }
  }
}

void ReadResidualBlocks(const ceres::Problem& problem, ProblemView* view) {
  std::vector<ceres::ResidualBlockId> ids;
  problem.GetResidualBlocks(&ids);
  view->residuals.reserve(ids.size());
  view->slots.reserve(3 * ids.size());
  std::vector<int> last_residual(view->blocks.size(), -1);
  std::vector<double*> pointers;
  for (const ceres::ResidualBlockId id : ids) {
    ResidualBlockView residual;
    residual.id = id;
    residual.cost = problem.GetCostFunctionForResidualBlock(id);
    residual.loss = problem.GetLossFunctionForResidualBlock(id);
    residual.num_residuals = residual.cost->num_residuals();
    problem.GetParameterBlocksForResidualBlock(id, &pointers);
    ReadSlots(pointers, &residual, &last_residual, view);
    if (residual.num_residuals <= 0) {
      SetDefect(view, ResidualText(*view) + " has no residuals");
    }
    if (!residual.fixed) {
      for (int s = 0; s < residual.num_slots; ++s) {
        ++view->blocks[static_cast<std::size_t>(view->SlotsOf(residual)[s])].degree;
      }
    }
    view->residuals.push_back(residual);
  }
}

void Count(const ParameterBlockView& block, ProblemTotals* totals) {
  ++totals->num_parameter_blocks;
  totals->num_parameters += block.ambient_size;
  totals->num_effective_parameters += block.tangent_size;
}

void Count(const ResidualBlockView& residual, ProblemTotals* totals) {
  ++totals->num_residual_blocks;
  totals->num_residuals += residual.num_residuals;
}

}  // namespace

std::string Describe(const ParameterBlockView& block) {
  char text[80];
  std::snprintf(text, sizeof(text), "parameter block %p of size %d", static_cast<const void*>(block.values), block.ambient_size);
  return text;
}

ProblemView Introspect(const ceres::Problem& problem) {
  ProblemView view;
  Introspect(problem, &view);
  return view;
}

void Introspect(const ceres::Problem& problem, ProblemView* view) {
  view->blocks.clear();
  view->residuals.clear();
  view->slots.clear();
  view->bounds.clear();
  view->all = view->reduced = ProblemTotals();
  view->defect.clear();
  ReadParameterBlocks(problem, view);
  ReadResidualBlocks(problem, view);
  for (const ParameterBlockView& block : view->blocks) {
    Count(block, &view->all);
    if (block.reduced()) {
      Count(block, &view->reduced);
    }
  }
  for (const ResidualBlockView& residual : view->residuals) {
    Count(residual, &view->all);
    if (!residual.fixed) {
      Count(residual, &view->reduced);
    }
  }
}

void IntrospectValues(const ceres::Problem& problem, ProblemView* view) {
  if (!view->defect.empty()) {
    Introspect(problem, view);  // whether it is one of values or of structure is not known any more
    return;
  }
  std::vector<double> known_bounds;
  for (ParameterBlockView& block : view->blocks) {
    CheckValues(block, view);
    if (block.bounds != BoundsKind::kNone) {
      known_bounds.clear();
      block.bounds = ReadBounds(problem, block.values, block.ambient_size, block.constant, &known_bounds);
    }
  }
}

}  // namespace inceres::internal
