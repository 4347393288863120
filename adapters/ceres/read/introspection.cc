#include "adapters/ceres/read/introspection.h"

#include <cstdio>

#include <ceres/cost_function.h>

#include "inceres/problem/ambient_family.h"

namespace inceres::internal {
namespace {

void SetDefect(ProblemView* view, std::string text) {
  if (view->defect.empty()) {
    view->defect = std::move(text);
  }
}

ParameterBlockView ReadParameterBlock(const ceres::Problem& problem, double* values,
                                      std::vector<double>* bounds) {
  ParameterBlockView block;
  block.values = values;
  block.ambient_size = problem.ParameterBlockSize(values);
  block.manifold = ManifoldOf(problem, values);
  block.tangent_size =
      block.manifold != nullptr ? TangentSizeOf(*block.manifold) : block.ambient_size;
  block.constant = block.tangent_size == 0 || problem.IsParameterBlockConstant(values);
  block.first_bound = bounds->size();
  block.bounds = ReadBounds(problem, values, block.ambient_size, block.constant, bounds);
  return block;
}

void CheckValues(const ParameterBlockView& block, ProblemView* view) {
  if (!AreWritten(block.values,
                  block.ambient_size)) {  // what Ceres fills outputs with it rejects as input
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
  explicit ResidualReader(ProblemView* view)
      : view_(*view), last_residual_(view->blocks.size(), -1) {}

  void Run(const ceres::Problem& problem) {
    std::vector<ceres::ResidualBlockId> ids;
    problem.GetResidualBlocks(&ids);
    view_.residuals.reserve(ids.size());
    view_.slots.reserve(3 * ids.size());
    ResidualBlockView residual;  // keeps what its neighbor repeats
    Repeats repeats;
    for (const ceres::ResidualBlockId id : ids) {
      const int num_residuals_before = residual.num_residuals;
      residual.id = id;
      residual.cost = problem.GetCostFunctionForResidualBlock(id);
      residual.loss = problem.GetLossFunctionForResidualBlock(id);
      residual.num_residuals = residual.cost->num_residuals();
      problem.GetParameterBlocksForResidualBlock(id, &pointers_);
      if (RepeatsSlots(residual)) {
        residual.like_previous = residual.num_residuals == num_residuals_before;
      } else {
        Count(residual, repeats);
        repeats = Repeats();
        ReadSlots(&residual);
      }
      ++repeats.num_residual_blocks;
      repeats.num_residuals += residual.num_residuals;
      if (residual.num_residuals <= 0) {
        SetDefect(&view_, ThisResidual() + " has no residuals");
      }
      view_.residuals.push_back(residual);
    }
    Count(residual, repeats);
  }

 private:
  // Neighboring residual blocks with the same slots.
  struct Repeats {
    int num_residual_blocks = 0;
    int num_residuals = 0;
  };

  // Names the residual block in program order, which is the order Ceres's own messages use.
  std::string ThisResidual() const {
    return "residual block " + std::to_string(view_.residuals.size());
  }

  // Whether the slots, which are still those of the residual block before, are right for this one
  // too; its neighbors' often are.
  bool RepeatsSlots(const ResidualBlockView& residual) const {
    const std::vector<std::int32_t>& sizes = residual.cost->parameter_block_sizes();
    const auto num_slots = static_cast<std::size_t>(residual.num_slots);
    if (view_.residuals.empty() || pointers_.size() != num_slots || sizes.size() != num_slots) {
      return false;
    }
    const int* slots = view_.SlotsOf(residual);
    for (std::size_t s = 0; s < num_slots; ++s) {
      const ParameterBlockView& block = view_.block(slots[s]);
      if (pointers_[s] != block.values || sizes[s] != block.ambient_size) {
        return false;
      }
    }
    return true;
  }

  // Counts residual blocks with the same slots as this one, and the blocks they touch.
  void Count(const ResidualBlockView& residual, const Repeats& repeats) {
    const auto add = [&repeats](ProblemTotals* totals) {
      totals->num_residual_blocks += repeats.num_residual_blocks;
      totals->num_residuals += repeats.num_residuals;
    };
    add(&view_.all);
    if (!residual.fixed) {
      add(&view_.reduced);
      for (int s = 0; s < residual.num_slots; ++s) {
        view_.blocks[static_cast<std::size_t>(view_.SlotsOf(residual)[s])].degree +=
            repeats.num_residual_blocks;
      }
    }
  }

  void ReadSlots(ResidualBlockView* residual) {
    const std::vector<std::int32_t>& sizes = residual->cost->parameter_block_sizes();
    const ResidualBlockView previous = *residual;
    residual->first_slot = static_cast<int>(view_.slots.size());
    residual->num_slots = static_cast<int>(pointers_.size());
    residual->fixed = true;
    residual->like_previous = false;
    if (sizes.size() != pointers_.size()) {
      SetDefect(&view_, "the cost function of " + ThisResidual() +
                            " has changed its number of parameter blocks");
    }
    for (std::size_t s = 0; s < pointers_.size(); ++s) {
      const int b = FindBlock(previous, s);
      const ParameterBlockView& block = view_.block(b);
      view_.slots.push_back(b);
      residual->fixed = residual->fixed && block.constant;
      Meet(b);
      if (s < sizes.size() && sizes[s] != block.ambient_size) {
        SetDefect(&view_, "the cost function of " + ThisResidual() +
                              " expects another size than that of " + Describe(block));
      }
    }
  }

  // Of slot s, where the residual block before often has the same.
  int FindBlock(const ResidualBlockView& previous, std::size_t s) const {
    if (static_cast<int>(s) < previous.num_slots) {
      const int b = view_.SlotsOf(previous)[s];
      if (view_.block(b).values == pointers_[s]) {
        return b;
      }
    }
    return view_.index.Find(pointers_[s]);
  }

  // A block twice in one residual block shows at once.
  void Meet(int b) {
    const int this_residual = static_cast<int>(view_.residuals.size());
    int& last = last_residual_[static_cast<std::size_t>(b)];
    if (last == this_residual) {
      SetDefect(&view_, Describe(view_.block(b)) + " appears twice in " + ThisResidual());
    }
    last = this_residual;
  }

  ProblemView& view_;
  std::vector<int> last_residual_;  // per block: the last residual block seen to touch it
  std::vector<double*> pointers_;   // of this residual block
};

void Count(const ParameterBlockView& block, ProblemTotals* totals) {
  ++totals->num_parameter_blocks;
  totals->num_parameters += block.ambient_size;
  totals->num_effective_parameters += block.tangent_size;
}

}  // namespace

std::string Describe(const ParameterBlockView& block) {
  char text[80];
  std::snprintf(text, sizeof(text), "parameter block %p of size %d",
                static_cast<const void*>(block.values), block.ambient_size);
  return text;
}

ProblemView Introspect(const ceres::Problem& problem) {
  ProblemView view;
  Introspect(problem, &view);
  return view;
}

void ProblemView::Clear() {
  blocks.clear();
  residuals.clear();
  slots.clear();
  bounds.clear();
  all = reduced = ProblemTotals();
  defect.clear();
}

void Introspect(const ceres::Problem& problem, ProblemView* view) {
  view->Clear();
  ReadParameterBlocks(problem, view);
  ResidualReader(view).Run(problem);
  for (const ParameterBlockView& block : view->blocks) {
    Count(block, &view->all);
    if (block.reduced()) {
      Count(block, &view->reduced);
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
      block.bounds =
          ReadBounds(problem, block.values, block.ambient_size, block.constant, &known_bounds);
    }
  }
}

}  // namespace inceres::internal
