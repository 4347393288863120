#include "adapters/ceres/read/introspection.h"

#include <algorithm>
#include <numeric>

#include "adapters/ceres/read/index.h"
#include "adapters/ceres/read/touched_blocks.h"
#include "inceres/problem/ambient_family.h"
#include "src/base/executor.h"
#include "src/base/formatted.h"

namespace inceres::internal {
namespace {

void LookUpBounds(const ceres::Problem& problem, bool may_have_bounds, std::vector<double>* bounds,
                  ParameterBlockView* block) {
  block->constant = block->constant || block->tangent_size == 0;
  block->first_bound = bounds->size();
  if (!may_have_bounds) {
    return;
  }
  block->bounds = ReadBounds(problem, block->values, block->ambient_size, block->constant, bounds);
}

void CheckValues(const ParameterBlockView& block, ProblemView* view) {
  if (!AreWritten(block.values,
                  block.ambient_size)) {  // what Ceres fills outputs with it rejects as input
    view->SetDefect(Describe(block) + " has a value that is not finite");
  }
}

// Of the blocks from begin to end, which counted them from 0.
void AppendBounds(const std::vector<double>& bounds, std::size_t begin, std::size_t end,
                  ProblemView* view) {
  for (std::size_t b = begin; b < end; ++b) {
    view->blocks[b].first_bound += view->blocks[b].manifold == nullptr ? view->bounds.size() : 0;
  }
  view->bounds.insert(view->bounds.end(), bounds.begin(), bounds.end());
}

// Looks every block up in Ceres's map once for each of its properties and twice for each of its
// parameters: most of what it takes to read a problem of many points. Manifolds are asked by one
// thread, as Ceres asks them, also for whether their blocks are constant.
void LookUpBlocks(const ceres::Problem& problem, bool have_been_looked_up, int num_threads,
                  bool may_have_bounds, ProblemView* view) {
  constexpr std::size_t kBlocksPerTask = 1024;
  const std::size_t count = view->blocks.size();
  std::vector<std::vector<double>> bounds((count + kBlocksPerTask - 1) / kBlocksPerTask);
  Executor(num_threads).For(static_cast<int>(bounds.size()), 1, [&](int begin, int end) {
    for (std::size_t b = At(begin) * kBlocksPerTask; b < std::min(count, At(end) * kBlocksPerTask);
         ++b) {
      ParameterBlockView& block = view->blocks[b];
      if (!have_been_looked_up) {
        LookUpBlock(problem, &block);
      }
      if (block.manifold == nullptr) {
        LookUpBounds(problem, may_have_bounds, &bounds[b / kBlocksPerTask], &block);
      }
    }
  });
  for (std::size_t b = 0; b < count; ++b) {
    ParameterBlockView& block = view->blocks[b];
    if (b % kBlocksPerTask == 0 && !bounds[b / kBlocksPerTask].empty()) {
      AppendBounds(bounds[b / kBlocksPerTask], b, std::min(count, b + kBlocksPerTask), view);
    }
    if (block.manifold != nullptr) {
      block.tangent_size = TangentSizeOf(*block.manifold);
      block.constant = problem.IsParameterBlockConstant(block.values);
      if (block.tangent_size > block.ambient_size) {
        view->SetDefect(Describe(block) + " has a manifold of more degrees of freedom than values");
      }
      LookUpBounds(problem, may_have_bounds, &view->bounds, &block);
    }
  }
}

// By address, as Ceres shows them, with the view's index. `touched`: empty unless residual blocks
// have shown them all.
void FindBlocks(const ceres::Problem& problem, int num_threads, ProblemView* view,
                TouchedBlocks* touched) {
  if (TouchedBlocks::Serve(At(problem.NumParameterBlocks()), view->ids.size()) &&
      touched->Find(problem, num_threads, view)) {
    touched->SortByAddress(num_threads, view);
    return;
  }
  *touched = TouchedBlocks();
  std::vector<double*> pointers;
  problem.GetParameterBlocks(&pointers);
  view->index.Build(pointers);
  view->blocks.resize(pointers.size());
  for (std::size_t b = 0; b < pointers.size(); ++b) {
    view->blocks[b].values = pointers[b];
  }
}

void ReadParameterBlocks(const ceres::Problem& problem, int num_threads, bool may_have_bounds,
                         ProblemView* view, TouchedBlocks* touched) {
  FindBlocks(problem, num_threads, view, touched);
  LookUpBlocks(problem, touched->have_been_looked_up(), num_threads, may_have_bounds, view);
  for (std::size_t b = 0; b < view->blocks.size(); ++b) {
    const ParameterBlockView& block = view->blocks[b];
    if (block.ambient_size == 0) {  // constant to Ceres, and no variable of the core's
      view->SetDefect(Describe(block) + " has no values");
    }
    CheckValues(block, view);
    if (b > 0) {
      const ParameterBlockView& previous = view->blocks[b - 1];
      if (previous.values + previous.ambient_size > block.values) {
        view->SetDefect(Describe(previous) + " overlaps " + Describe(block));
      }
    }
  }
}

void Count(const ParameterBlockView& block, ProblemTotals* totals) {
  ++totals->num_parameter_blocks;
  totals->num_parameters += block.ambient_size;
  totals->num_effective_parameters += block.tangent_size;
}

// But for what is of one residual block.
std::size_t BytesOf(const std::vector<ResidualGroup>& groups) {
  return std::accumulate(groups.begin(), groups.end(), groups.capacity() * sizeof(ResidualGroup),
                         [](std::size_t sum, const ResidualGroup& group) {
                           return sum + group.slots.capacity() * sizeof(int);
                         });
}

}  // namespace

std::string Describe(const ParameterBlockView& block) {
  return Formatted("parameter block %p of size %d", static_cast<const void*>(block.values),
                   block.ambient_size);
}

ProblemView Introspect(const ceres::Problem& problem) {
  ProblemView view;
  Introspect(problem, &view);
  return view;
}

void ProblemView::Clear() {
  blocks.clear();
  ids.clear();
  residuals.clear();
  moving.clear();
  slots.clear();
  bounds.clear();
  all = reduced = ProblemTotals();
  defect.clear();
}

std::size_t ProblemView::Bytes() const {
  return blocks.capacity() * sizeof(ParameterBlockView) +
         ids.capacity() * sizeof(ceres::ResidualBlockId) +
         residuals.capacity() * sizeof(ResidualBlockView) +
         (moving.capacity() + slots.capacity()) * sizeof(int) + bounds.capacity() * sizeof(double) +
         BytesOf(groups) + index.Bytes();
}

void Introspect(const ceres::Problem& problem, ProblemView* view, int num_threads,
                bool may_have_bounds) {
  view->Clear();
  problem.GetResidualBlocks(&view->ids);
  TouchedBlocks touched;
  ReadParameterBlocks(problem, num_threads, may_have_bounds, view, &touched);
  ReadResidualBlocks(problem, touched, num_threads, view);
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
