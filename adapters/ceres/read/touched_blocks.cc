#include "adapters/ceres/read/touched_blocks.h"

#include <algorithm>
#include <cstdint>
#include <utility>

#include <ceres/cost_function.h>

#include "adapters/ceres/read/index.h"
#include "src/base/executor.h"

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

// Each thread sorts a part, and parts are merged two by two.
template <typename T>
void SortInParts(int num_threads, std::vector<T>* items) {
  constexpr std::size_t kPart = std::size_t{1} << 11;
  const std::size_t num_parts = std::clamp(items->size() / kPart, std::size_t{1}, At(num_threads));
  const auto begin_of = [&](std::size_t part) {
    return items->begin() +
           static_cast<std::ptrdiff_t>(std::min(part, num_parts) * items->size() / num_parts);
  };
  Executor(num_threads).For(static_cast<int>(num_parts), 1, [&](int begin, int end) {
    for (std::size_t part = At(begin); part < At(end); ++part) {
      std::sort(begin_of(part), begin_of(part + 1));
    }
  });
  for (std::size_t width = 1; width < num_parts; width *= 2) {
    for (std::size_t part = 0; part + width < num_parts; part += 2 * width) {
      std::inplace_merge(begin_of(part), begin_of(part + width), begin_of(part + 2 * width));
    }
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
  // It would ask a manifold for its degrees of freedom, and threads read here.
  block->constant = block->manifold == nullptr && problem.IsParameterBlockConstant(block->values);
}

// Part by part: what a part's residual blocks touch is small enough for the nearest caches. All
// parts are read before any is numbered where several threads read them.
bool TouchedBlocks::Find(const ceres::Problem& problem, int num_threads, ProblemView* view) {
  constexpr std::size_t kPart = 4096;
  const std::size_t count = At(problem.NumParameterBlocks());
  const std::size_t num_residuals = view->ids.size();
  view->index.Reserve(count);
  view->residuals.resize(num_residuals);
  blocks_.reserve(count);
  have_been_looked_up_ = num_threads == 1;
  const std::size_t num_parts = (num_residuals + kPart - 1) / kPart;
  std::vector<Part> parts(num_parts);
  std::vector<std::size_t> first_slot(num_parts + 1, 0);
  const auto for_each_part = [&](const auto& visit) {
    Executor(num_threads).For(static_cast<int>(num_parts), 1, [&](int begin, int end) {
      for (std::size_t k = At(begin); k < At(end); ++k) {
        visit(k);
      }
    });
  };
  const auto read = [&](std::size_t k) {
    parts[k].begin = k * kPart;
    parts[k].end = std::min(num_residuals, (k + 1) * kPart);
    Read(problem, view, &parts[k]);
  };
  if (num_threads > 1) {
    for_each_part(read);
  }
  for (std::size_t k = 0; k < num_parts; ++k) {
    if (num_threads == 1) {
      read(k);
    }
    if (!Number(problem, view, &parts[k])) {
      return false;
    }
    first_slot[k + 1] = first_slot[k] + parts[k].slots.size();
  }
  if (blocks_.size() != count || num_parameters_ != problem.NumParameters()) {
    return false;
  }
  slots_.resize(first_slot.back());
  for_each_part([&](std::size_t k) { Place(parts[k], first_slot[k], view); });
  return true;
}

void TouchedBlocks::Read(const ceres::Problem& problem, ProblemView* view, Part* part) {
  std::vector<double*> pointers, all_pointers;
  std::vector<int> all_sizes;
  for (std::size_t r = part->begin; r < part->end; ++r) {
    FetchAhead(problem, view->ids, r);
    const ceres::ResidualBlockId id = view->ids[r];
    ResidualBlockView& residual = view->residuals[r];
    residual.cost = problem.GetCostFunctionForResidualBlock(id);
    residual.loss = problem.GetLossFunctionForResidualBlock(id);
    residual.num_residuals = residual.cost->num_residuals();
    residual.sound = residual.num_residuals > 0;
    problem.GetParameterBlocksForResidualBlock(id, &pointers);
    const std::vector<std::int32_t>& sizes = residual.cost->parameter_block_sizes();
    part->is_sound = part->is_sound && sizes.size() == pointers.size();
    residual.first_slot = static_cast<int>(all_pointers.size());
    residual.num_slots = static_cast<int>(pointers.size());
    all_pointers.insert(all_pointers.end(), pointers.begin(), pointers.end());
    all_sizes.insert(all_sizes.end(), sizes.begin(), sizes.end());
  }
  if (!part->is_sound) {
    return;
  }
  PointerIndex index;
  index.Reserve(all_pointers.size());
  part->slots.reserve(all_pointers.size());
  for (std::size_t s = 0; s < all_pointers.size(); ++s) {
    const int b = index.FindOrAdd(all_pointers[s]);
    if (At(b) == part->blocks.size()) {
      part->blocks.push_back(all_pointers[s]);
      part->sizes.push_back(all_sizes[s]);
    }
    part->slots.push_back(b);
    part->is_sound = part->is_sound && part->sizes[At(b)] == all_sizes[s];
  }
}

// Ceres has compared the sizes of a cost function with those of its blocks when it was added. That
// none has changed since is seen by their sum, once each block has one size wherever it is met.
bool TouchedBlocks::Number(const ceres::Problem& problem, ProblemView* view, Part* part) {
  constexpr std::size_t kBlocksAhead = 8;
  part->numbers.reserve(part->blocks.size());
  for (std::size_t k = 0; k < part->blocks.size(); ++k) {
    if (k + kBlocksAhead < part->blocks.size()) {
      view->index.Fetch(part->blocks[k + kBlocksAhead]);
    }
    const int b = view->index.FindOrAdd(part->blocks[k]);
    part->numbers.push_back(b);
    if (At(b) == blocks_.size()) {
      ParameterBlockView& block = blocks_.emplace_back();
      block.values = part->blocks[k];
      block.ambient_size = part->sizes[k];
      num_parameters_ += block.ambient_size;
      if (have_been_looked_up_) {
        LookUpBlock(problem, &block);
      }
    }
    part->is_sound = part->is_sound && part->sizes[k] == blocks_[At(b)].ambient_size;
  }
  return part->is_sound;
}

void TouchedBlocks::Place(const Part& part, std::size_t first_slot, ProblemView* view) {
  std::transform(part.slots.begin(), part.slots.end(), slots_.data() + first_slot,
                 [&part](int b) { return part.numbers[At(b)]; });
  for (std::size_t r = part.begin; r < part.end; ++r) {
    view->residuals[r].first_slot += static_cast<int>(first_slot);
  }
}

void TouchedBlocks::SortByAddress(int num_threads, ProblemView* view) {
  constexpr int kGrain = 1 << 13;
  const auto for_each = [&](std::size_t size, const auto& visit) {
    Executor(num_threads).For(static_cast<int>(size), kGrain, [&](int begin, int end) {
      for (std::size_t i = At(begin); i < At(end); ++i) {
        visit(i);
      }
    });
  };
  std::vector<std::pair<double*, int>> order(blocks_.size());
  for_each(order.size(), [&](std::size_t b) {
    order[b] = {blocks_[b].values, static_cast<int>(b)};
  });
  SortInParts(num_threads, &order);
  std::vector<int> numbers(order.size());
  view->blocks.resize(order.size());
  for_each(order.size(), [&](std::size_t k) {
    const std::size_t b = At(order[k].second);
    numbers[b] = static_cast<int>(k);
    view->blocks[k] = blocks_[b];
  });
  for_each(slots_.size(), [&](std::size_t s) { slots_[s] = numbers[At(slots_[s])]; });
  view->index.Renumber(numbers, num_threads);
}

}  // namespace inceres::internal
