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

class ResidualReader {
 public:
  explicit ResidualReader(ProblemView* view) : view_(*view), last_residual_(view->blocks.size(), -1) {}

  void Run(const ceres::Problem& problem) {
    std::vector<ceres::ResidualBlockId> ids;
    problem.GetResidualBlocks(&ids);
    view_.residuals.reserve(ids.size());
    view_.slots.reserve(3 * ids.size());
    for (const ceres::ResidualBlockId id : ids) {
      ResidualBlockView& residual = view_.residuals.emplace_back();
      residual.id = id;
      residual.cost = problem.GetCostFunctionForResidualBlock(id);
      residual.loss = problem.GetLossFunctionForResidualBlock(id);
      residual.num_residuals = residual.cost->num_residuals();
      previous_.swap(pointers_);
      problem.GetParameterBlocksForResidualBlock(id, &pointers_);
      ReadSlots(&residual);
      if (residual.num_residuals <= 0) {
        SetDefect(&view_, ThisResidual() + " has no residuals");
      }
    }
  }

 private:
  // Names the residual block in program order, which is the order Ceres's own messages use.
  std::string ThisResidual() const { return "residual block " + std::to_string(view_.residuals.size() - 1); }

  void ReadSlots(ResidualBlockView* residual) {
    const std::vector<std::int32_t>& sizes = residual->cost->parameter_block_sizes();
    residual->first_slot = static_cast<int>(view_.slots.size());
    residual->num_slots = static_cast<int>(pointers_.size());
    if (sizes.size() != pointers_.size()) {
      SetDefect(&view_, "the cost function of " + ThisResidual() + " has changed its number of parameter blocks");
    }
    if (view_.residuals.size() > 1 && HasBlocksOfPrevious()) {
      RepeatSlots(residual);
    } else {
      FindSlots(residual);
    }
    const int* slots = view_.SlotsOf(*residual);
    const int touch = residual->fixed ? 0 : 1;
    const std::int32_t* const expected = sizes.data();
    const std::size_t num_expected = sizes.size();
    const std::size_t num_slots = pointers_.size();
    ParameterBlockView* const blocks = view_.blocks.data();
    for (std::size_t s = 0; s < num_slots; ++s) {
      ParameterBlockView& block = blocks[slots[s]];
      block.degree += touch;
      if (s < num_expected && expected[s] != block.ambient_size) {
        SetDefect(&view_, "the cost function of " + ThisResidual() + " expects another size than that of " + Describe(block));
      }
    }
  }

  // By a loop: to call a comparison of memory takes longer than to compare a few.
  bool HasBlocksOfPrevious() const {
    bool same = pointers_.size() == previous_.size();
    for (std::size_t s = 0; same && s < pointers_.size(); ++s) {
      same = pointers_[s] == previous_[s];
    }
    return same;
  }

  // The blocks of the residual block before, of which nothing new is to be found.
  void RepeatSlots(ResidualBlockView* residual) {
    const ResidualBlockView& before = view_.residuals.end()[-2];
    residual->fixed = before.fixed;
    residual->like_previous = residual->num_residuals == before.num_residuals;
    for (int s = 0; s < before.num_slots; ++s) {
      const int b = view_.SlotsOf(before)[s];
      view_.slots.push_back(b);
    }
  }

  void FindSlots(ResidualBlockView* residual) {
    const std::size_t first_of_previous = view_.slots.size() - previous_.size();
    for (std::size_t s = 0; s < pointers_.size(); ++s) {
      const bool as_before = s < previous_.size() && previous_[s] == pointers_[s];  // as neighbours often have
      const int b = as_before ? view_.slots[first_of_previous + s] : view_.index.Find(pointers_[s]);
      view_.slots.push_back(b);
      residual->fixed = residual->fixed && view_.block(b).constant;
      Meet(b);
    }
  }

  // A block twice in one residual block shows at once.
  void Meet(int b) {
    const int this_residual = static_cast<int>(view_.residuals.size()) - 1;
    int& last = last_residual_[static_cast<std::size_t>(b)];
    if (last == this_residual) {
      SetDefect(&view_, Describe(view_.block(b)) + " appears twice in " + ThisResidual());
    }
    last = this_residual;
  }

  ProblemView& view_;
  std::vector<int> last_residual_;  // per block: the last residual block seen to touch it
  std::vector<double*> pointers_;
  std::vector<double*> previous_;  // those of the residual block before
};

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
  ResidualReader(view).Run(problem);
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
