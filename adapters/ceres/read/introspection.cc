#include "adapters/ceres/read/introspection.h"

#include <algorithm>
#include <cstdint>
#include <cstdio>
#include <numeric>

#include <ceres/cost_function.h>

#include "adapters/ceres/read/index.h"
#include "adapters/ceres/read/residual_look_ups.h"
#include "adapters/ceres/read/touched_blocks.h"
#include "inceres/problem/ambient_family.h"
#include "src/base/parallel_for.h"

namespace inceres::internal {
namespace {

void SetDefect(ProblemView* view, std::string text) {
  if (view->defect.empty()) {
    view->defect = std::move(text);
  }
}

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
    SetDefect(view, Describe(block) + " has a value that is not finite");
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
  ParallelFor(num_threads, static_cast<int>(bounds.size()), 1, [&](int begin, int end) {
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
        SetDefect(view, Describe(block) + " has a manifold of more degrees of freedom than values");
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
      SetDefect(view, Describe(block) + " has no values");
    }
    CheckValues(block, view);
    if (b > 0) {
      const ParameterBlockView& previous = view->blocks[b - 1];
      if (previous.values + previous.ambient_size > block.values) {
        SetDefect(view, Describe(previous) + " overlaps " + Describe(block));
      }
    }
  }
}

class ResidualReader {
 public:
  explicit ResidualReader(ProblemView* view) : view_(*view) {}

  void Run(const ceres::Problem& problem, const TouchedBlocks& touched, int num_threads) {
    count_ = static_cast<int>(view_.ids.size());
    view_.residuals.resize(view_.ids.size());
    view_.moving.reserve(view_.ids.size());
    view_.slots.reserve(std::max(3 * view_.ids.size(), touched.slots().size()));
    ResidualLookUps look_ups(problem, touched.slots(), &view_);
    while (next_ < count_) {
      const int num_groups = look_ups.Take(next_, num_threads);
      for (int group = 0; group < num_groups; ++group) {
        ReadGroup(look_ups.SlotsOf(group));
      }
    }
    view_.all.num_residual_blocks = count_;
    view_.reduced.num_residual_blocks = static_cast<int>(view_.moving.size());
  }

 private:
  // Run by run of residual blocks that are like the one before.
  void ReadGroup(const std::vector<int>& slots) {
    const int first_slot = static_cast<int>(view_.slots.size());
    view_.slots.insert(view_.slots.end(), slots.begin(), slots.end());
    ResidualBlockView* const residuals = view_.residuals.data();
    const int end = std::min(next_ + ResidualLookUps::kGroup, count_);
    while (next_ < end) {
      ResidualBlockView& first = residuals[next_];
      first.first_slot += first_slot;
      if (!first.sound) {
        FindDefect(first);
      }
      int run_end = next_ + 1;
      for (; run_end < end && residuals[run_end].like_previous; ++run_end) {
        residuals[run_end].first_slot = first.first_slot;
      }
      view_.all.num_residuals += first.num_residuals * (run_end - next_);
      if (!first.fixed) {
        Move(first, run_end);
      }
      next_ = run_end;
    }
  }

  // Those from next_ on, all like this one.
  void Move(const ResidualBlockView& residual, int end) {
    const int count = end - next_;
    const std::size_t num_before = view_.moving.size();
    view_.moving.resize(num_before + At(count));
    std::iota(view_.moving.begin() + static_cast<std::ptrdiff_t>(num_before), view_.moving.end(),
              next_);
    view_.reduced.num_residuals += residual.num_residuals * count;
    const int* const slots = view_.SlotsOf(residual);
    for (int s = 0; s < residual.num_slots; ++s) {
      view_.blocks[At(slots[s])].degree += count;
    }
  }

  void FindDefect(const ResidualBlockView& residual) {
    // In program order, which is the order Ceres's own messages use.
    const std::string name = "residual block " + std::to_string(next_);
    const std::vector<std::int32_t>& sizes = residual.cost->parameter_block_sizes();
    const int* const slots = view_.SlotsOf(residual);
    if (sizes.size() != At(residual.num_slots)) {
      SetDefect(&view_,
                "the cost function of " + name + " has changed its number of parameter blocks");
    }
    for (int s = 0; s < residual.num_slots; ++s) {
      if (std::find(slots, slots + s, slots[s]) != slots + s) {
        SetDefect(&view_, Describe(view_.block(slots[s])) + " appears twice in " + name);
      }
    }
    for (std::size_t s = 0; s < std::min(sizes.size(), At(residual.num_slots)); ++s) {
      const ParameterBlockView& block = view_.block(slots[s]);
      if (sizes[s] != block.ambient_size) {
        SetDefect(&view_, "the cost function of " + name + " expects another size than that of " +
                              Describe(block));
      }
    }
    if (residual.num_residuals <= 0) {
      SetDefect(&view_, name + " has no residuals");
    }
  }

  ProblemView& view_;
  int count_ = 0;
  int next_ = 0;  // the residual block that is read
};

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
  ResidualReader(view).Run(problem, touched, num_threads);
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
