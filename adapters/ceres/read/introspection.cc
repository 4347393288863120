#include "adapters/ceres/read/introspection.h"

#include <algorithm>
#include <cstdio>

#include <ceres/cost_function.h>

#include "adapters/ceres/read/index.h"
#include "adapters/ceres/read/residual_look_ups.h"
#include "inceres/problem/ambient_family.h"
#include "src/base/parallel_for.h"

namespace inceres::internal {
namespace {

void SetDefect(ProblemView* view, std::string text) {
  if (view->defect.empty()) {
    view->defect = std::move(text);
  }
}

// Without what its manifold has to say.
ParameterBlockView LookUpBlock(const ceres::Problem& problem, double* values) {
  ParameterBlockView block;
  block.values = values;
  block.ambient_size = problem.ParameterBlockSize(values);
  block.manifold = ManifoldOf(problem, values);
  block.tangent_size = block.ambient_size;
  block.constant = problem.IsParameterBlockConstant(values);
  return block;
}

void LookUpBounds(const ceres::Problem& problem, std::vector<double>* bounds,
                  ParameterBlockView* block) {
  block->constant = block->constant || block->tangent_size == 0;
  block->first_bound = bounds->size();
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
// thread, as Ceres asks them.
void LookUpBlocks(const ceres::Problem& problem, const std::vector<double*>& pointers,
                  int num_threads, ProblemView* view) {
  constexpr std::size_t kBlocksPerTask = 1024;
  const std::size_t count = pointers.size();
  std::vector<std::vector<double>> bounds((count + kBlocksPerTask - 1) / kBlocksPerTask);
  view->blocks.resize(count);
  ParallelFor(num_threads, static_cast<int>(bounds.size()), 1, [&](int begin, int end) {
    for (std::size_t b = At(begin) * kBlocksPerTask; b < std::min(count, At(end) * kBlocksPerTask);
         ++b) {
      ParameterBlockView& block = view->blocks[b];
      block = LookUpBlock(problem, pointers[b]);
      if (block.manifold == nullptr) {
        LookUpBounds(problem, &bounds[b / kBlocksPerTask], &block);
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
      LookUpBounds(problem, &view->bounds, &block);
    }
  }
}

void ReadParameterBlocks(const ceres::Problem& problem, int num_threads, ProblemView* view) {
  std::vector<double*> pointers;
  problem.GetParameterBlocks(&pointers);
  view->index.Build(pointers);
  LookUpBlocks(problem, pointers, num_threads, view);
  for (std::size_t b = 0; b < view->blocks.size(); ++b) {
    const ParameterBlockView& block = view->blocks[b];
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
  explicit ResidualReader(ProblemView* view)
      : view_(*view), last_residual_(view->blocks.size(), -1) {}

  void Run(const ceres::Problem& problem, int num_threads) {
    std::vector<ceres::ResidualBlockId> ids;
    problem.GetResidualBlocks(&ids);
    view_.residuals.reserve(ids.size());
    view_.slots.reserve(3 * ids.size());
    ResidualLookUps look_ups(problem, view_);
    while (next_ < static_cast<int>(ids.size())) {
      look_ups.Take(ids, At(next_), num_threads);
      for (const ResidualLookUp& found : look_ups.found()) {
        Read(ids[At(next_)], found);
        ++next_;
      }
    }
    Count(residual_, repeats_);
  }

 private:
  // Neighboring residual blocks with the same slots.
  struct Repeats {
    int num_residual_blocks = 0;
    int num_residuals = 0;
  };

  void Read(ceres::ResidualBlockId id, const ResidualLookUp& found) {
    const int num_residuals_before = residual_.num_residuals;
    residual_.id = id;
    residual_.cost = found.cost;
    residual_.loss = found.loss;
    residual_.num_residuals = found.num_residuals;
    if (RepeatsSlots(found)) {
      residual_.like_previous = residual_.num_residuals == num_residuals_before;
    } else {
      Count(residual_, repeats_);
      repeats_ = Repeats();
      ReadSlots(found);
    }
    ++repeats_.num_residual_blocks;
    repeats_.num_residuals += residual_.num_residuals;
    if (residual_.num_residuals <= 0) {
      SetDefect(&view_, ThisResidual() + " has no residuals");
    }
    view_.residuals.push_back(residual_);
  }

  // Names the residual block in program order, which is the order Ceres's own messages use.
  std::string ThisResidual() const { return "residual block " + std::to_string(next_); }

  // Whether the slots, which are still those of the residual block before, are right for this one
  // too; its neighbors' often are.
  bool RepeatsSlots(const ResidualLookUp& found) const {
    return next_ > 0 && found.sizes_fit && found.num_slots == residual_.num_slots &&
           AreEqual(found.blocks, view_.SlotsOf(residual_), found.num_slots);
  }

  // From the last one on, where neighbors differ first.
  static bool AreEqual(const int* a, const int* b, int count) {
    while (count > 0 && a[count - 1] == b[count - 1]) {
      --count;
    }
    return count == 0;
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
      const int* const slots = view_.SlotsOf(residual);
      for (const int* b = slots; b < slots + residual.num_slots; ++b) {
        view_.blocks[At(*b)].degree += repeats.num_residual_blocks;
      }
    }
  }

  void ReadSlots(const ResidualLookUp& found) {
    residual_.first_slot = static_cast<int>(view_.slots.size());
    residual_.num_slots = found.num_slots;
    residual_.fixed = true;
    residual_.like_previous = false;
    const std::size_t num_sizes = found.sizes_fit ? 0 : found.cost->parameter_block_sizes().size();
    if (!found.sizes_fit && num_sizes != static_cast<std::size_t>(found.num_slots)) {
      SetDefect(&view_, "the cost function of " + ThisResidual() +
                            " has changed its number of parameter blocks");
    }
    view_.slots.insert(view_.slots.end(), found.blocks, found.blocks + found.num_slots);
    for (int s = 0; s < found.num_slots; ++s) {
      residual_.fixed = residual_.fixed && view_.block(found.blocks[s]).constant;
      Meet(found.blocks[s]);
    }
    for (std::size_t k = 0; k < std::min(num_sizes, At(found.num_slots)); ++k) {
      const ParameterBlockView& block = view_.block(found.blocks[k]);
      if (found.cost->parameter_block_sizes()[k] != block.ambient_size) {
        SetDefect(&view_, "the cost function of " + ThisResidual() +
                              " expects another size than that of " + Describe(block));
      }
    }
  }

  // A block twice in one residual block shows at once.
  void Meet(int b) {
    int& last = last_residual_[At(b)];
    if (last == next_) {
      SetDefect(&view_, Describe(view_.block(b)) + " appears twice in " + ThisResidual());
    }
    last = next_;
  }

  ProblemView& view_;
  std::vector<int> last_residual_;  // per block: the last residual block seen to touch it
  int next_ = 0;                    // the residual block that is read
  ResidualBlockView residual_;      // the last one: keeps what its neighbor repeats
  Repeats repeats_;
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

void Introspect(const ceres::Problem& problem, ProblemView* view, int num_threads) {
  view->Clear();
  ReadParameterBlocks(problem, num_threads, view);
  ResidualReader(view).Run(problem, num_threads);
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
