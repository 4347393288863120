#include "adapters/ceres/read/touched_blocks.h"

#include <algorithm>
#include <cstdint>
#include <utility>

#include <ceres/cost_function.h>

#include "adapters/ceres/read/index.h"

namespace inceres::internal {
namespace {

// Residual blocks between one that is asked for and the one that is read; its cost function, which
// it points to, half of them later.
constexpr std::size_t kAhead = 16;

void FetchAhead(const ceres::Problem& problem, const std::vector<ceres::ResidualBlockId>& ids,
                std::size_t r) {
  constexpr std::size_t kLine = 64;
  if (r + kAhead < ids.size()) {
    const auto* const residual = reinterpret_cast<const char*>(ids[r + kAhead]);
    __builtin_prefetch(residual);
    __builtin_prefetch(residual + kLine);
  }
  if (r + kAhead / 2 < ids.size()) {
    __builtin_prefetch(problem.GetCostFunctionForResidualBlock(ids[r + kAhead / 2]));
  }
}

}  // namespace

bool TouchedBlocks::Serve(std::size_t num_blocks, std::size_t num_residual_blocks) {
  constexpr std::size_t kMany = 4096;
  constexpr std::size_t kMostUses = 8;  // residual blocks for each
  return num_blocks >= kMany && num_residual_blocks <= kMostUses * num_blocks;
}

void LookUpBlock(const ceres::Problem& problem, ParameterBlockView* block) {
  if (block->ambient_size == 0) {
    block->ambient_size = problem.ParameterBlockSize(block->values);
  }
  block->manifold = ManifoldOf(problem, block->values);
  block->tangent_size = block->ambient_size;
  block->constant = problem.IsParameterBlockConstant(block->values);
}

// Ceres has compared the sizes of a cost function with those of its blocks when it was added. That
// none has changed since is seen by their sum.
bool TouchedBlocks::Find(const ceres::Problem& problem, bool looks_up, ProblemView* view) {
  const std::size_t count = At(problem.NumParameterBlocks());
  view->index.Reserve(count);
  view->residuals.resize(view->ids.size());
  blocks_.reserve(count);
  slots_.reserve(3 * view->ids.size());
  have_been_looked_up_ = looks_up;
  std::vector<double*> pointers;
  std::int64_t num_parameters = 0;
  std::size_t previous = 0;  // where the slots of the residual block before begin
  for (std::size_t r = 0; r < view->ids.size(); ++r) {
    FetchAhead(problem, view->ids, r);
    const ceres::ResidualBlockId id = view->ids[r];
    ResidualBlockView& residual = view->residuals[r];
    residual.cost = problem.GetCostFunctionForResidualBlock(id);
    residual.loss = problem.GetLossFunctionForResidualBlock(id);
    residual.num_residuals = residual.cost->num_residuals();
    problem.GetParameterBlocksForResidualBlock(id, &pointers);
    const std::vector<std::int32_t>& sizes = residual.cost->parameter_block_sizes();
    if (sizes.size() != pointers.size()) {
      return false;
    }
    residual.sound = residual.num_residuals > 0;
    const std::size_t first = slots_.size();
    for (std::size_t s = 0; s < pointers.size(); ++s) {
      // The slot of the residual block before often has the same.
      const bool is_near =
          previous + s < first && blocks_[At(slots_[previous + s])].values == pointers[s];
      const int b = is_near ? slots_[previous + s] : view->index.FindOrAdd(pointers[s]);
      slots_.push_back(b);
      if (At(b) == blocks_.size()) {
        ParameterBlockView& block = blocks_.emplace_back();
        block.values = pointers[s];
        block.ambient_size = sizes[s];
        num_parameters += sizes[s];
        if (looks_up) {
          LookUpBlock(problem, &block);
        }
      }
      residual.sound = residual.sound && sizes[s] == blocks_[At(b)].ambient_size;
    }
    residual.first_slot = static_cast<int>(first);
    residual.num_slots = static_cast<int>(pointers.size());
    previous = first;
  }
  return blocks_.size() == count && num_parameters == problem.NumParameters();
}

void TouchedBlocks::SortByAddress(ProblemView* view) {
  std::vector<std::pair<double*, int>> order(blocks_.size());
  for (std::size_t b = 0; b < blocks_.size(); ++b) {
    order[b] = {blocks_[b].values, static_cast<int>(b)};
  }
  std::sort(order.begin(), order.end());
  std::vector<int> numbers(order.size());
  view->blocks.reserve(order.size());
  for (const auto& [values, b] : order) {
    numbers[At(b)] = static_cast<int>(view->blocks.size());
    view->blocks.push_back(blocks_[At(b)]);
  }
  for (int& slot : slots_) {
    slot = numbers[At(slot)];
  }
  view->index.Renumber(numbers);
}

}  // namespace inceres::internal
