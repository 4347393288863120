#pragma once

#include <algorithm>
#include <cstddef>
#include <string>
#include <utility>
#include <vector>

#include <ceres/problem.h>

#include "adapters/ceres/read/ceres_version.h"
#include "adapters/ceres/read/index.h"
#include "src/base/aligned_vector.h"

namespace inceres::internal {

/// A parameter block as seen through the problem's public getters.
struct ParameterBlockView {
  double* values = nullptr;
  const UserManifold* manifold = nullptr;
  int ambient_size = 0;
  int tangent_size = 0;
  int degree = 0;         ///< residual blocks that touch it and at least one variable block
  bool constant = false;  ///< set constant by the user, or of tangent size 0
  BoundsKind bounds = BoundsKind::kNone;
  /// into ProblemView::bounds: its lower bounds, then its upper ones; if it has any
  std::size_t first_bound = 0;

  /// Whether the solver moves it: variable and touched by a residual block. Ceres calls what is
  /// left the reduced program.
  bool reduced() const { return !constant && degree > 0; }
};

/// Sizes and blocks of a residual block.
struct ResidualBlockShape {
  int num_residuals;
  int first_slot;  ///< into ProblemView::slots; neighbors of the same blocks share them
  int num_slots;
};

/// Nothing is written before it is read from the problem, which several threads do.
struct ResidualBlockView : ResidualBlockShape {
  bool fixed;  ///< touches no variable block
  /// has residuals, and distinct blocks of the sizes its cost function expects; else see `defect`
  bool sound;
  /// as many residuals of the same blocks as the residual block before: of one family
  bool like_previous;
  const ceres::CostFunction* cost;
  const ceres::LossFunction* loss;  ///< null: plain squared norm
};

/// Sizes as Ceres's summary counts them.
struct ProblemTotals {
  int num_parameter_blocks = 0;
  int num_parameters = 0;
  int num_effective_parameters = 0;
  int num_residual_blocks = 0;
  int num_residuals = 0;
};

/// Residual blocks that are looked up one after the other.
struct ResidualGroup {
  std::vector<double*> pointers;         // of one residual block
  std::vector<double*> pointers_before;  // of the one before
  std::vector<int> sorted;               // its blocks, if there are many
  std::vector<int> slots;

  /// Where so many slots go.
  int* MakeRoom(int first, int count) {
    const auto size = static_cast<std::size_t>(first) + static_cast<std::size_t>(count);
    if (slots.size() < size) {
      slots.resize(2 * size);
    }
    return slots.data() + first;
  }
};

/// All the adapter knows of a ceres::Problem: one pass through its public API. Nothing of the
/// user's but the memory of its parameter blocks and size getters is touched; no cost function is
/// evaluated.
struct ProblemView {
  static constexpr std::size_t kMaxKeptBytes = std::size_t{2} << 20;

  std::vector<ParameterBlockView> blocks;        ///< by address (the only order Ceres shows)
  std::vector<ceres::ResidualBlockId> ids;       ///< of the residual blocks, in program order
  UnwrittenVector<ResidualBlockView> residuals;  ///< in the same order
  std::vector<int> moving;            ///< residual blocks that touch a variable block, ascending
  std::vector<int> slots;             ///< block of each slot of the residual blocks, see SlotsOf
  std::vector<double> bounds;         ///< of the bounded blocks
  PointerIndex index;                 ///< address to index in `blocks`
  std::vector<ResidualGroup> groups;  ///< scratch of who reads residual blocks
  ProblemTotals all;
  ProblemTotals reduced;
  /// the first thing no solver but stock should look at (a block twice in a residual block, …);
  /// else empty
  std::string defect;

  /// Whether its memory is worth keeping: what is given back to the system is paged in anew by the
  /// next solve, which in a problem of mostly constant blocks takes as long as to read it.
  bool IsSmall() const { return Bytes() <= kMaxKeptBytes; }
  std::size_t Bytes() const;

  /// Keeps the first.
  void SetDefect(std::string text) {
    if (defect.empty()) {
      defect = std::move(text);
    }
  }

  /// Empties it; the memory stays.
  void Clear();

  /// Gives back the memory of residual blocks, slots and index, most of the view, for who has built
  /// a graph of them; unless it is small.
  void ForgetResidualBlocks() {
    if (IsSmall()) {
      return;
    }
    std::vector<ceres::ResidualBlockId>().swap(ids);
    UnwrittenVector<ResidualBlockView>().swap(residuals);
    std::vector<int>().swap(moving);
    std::vector<int>().swap(slots);
    std::vector<ResidualGroup>().swap(groups);
    index = PointerIndex();
  }
  /// The same of everything, but for the totals.
  void ForgetBlocks() {
    ForgetResidualBlocks();
    if (!IsSmall()) {
      std::vector<ParameterBlockView>().swap(blocks);
      std::vector<double>().swap(bounds);
    }
  }

  const int* SlotsOf(const ResidualBlockView& residual) const {
    return slots.data() + residual.first_slot;
  }
  /// The first slot of a residual block whose block is one of these, or -1.
  template <typename IsOne>
  int FindSlot(const ResidualBlockView& residual, const IsOne& is_one) const {
    const int* begin = SlotsOf(residual);
    const int* end = begin + residual.num_slots;
    const int* found = std::find_if(begin, end, is_one);
    return found == end ? -1 : static_cast<int>(found - begin);
  }
  const ParameterBlockView& block(int i) const { return blocks[static_cast<std::size_t>(i)]; }
  bool IsReduced(int i) const { return block(i).reduced(); }
};

/// Reads the problem. Cost: linear in slots, plus a few map lookups per parameter block inside
/// Ceres (two per bound).
ProblemView Introspect(const ceres::Problem& problem);
/// The same into the memory of an earlier view. With several threads they call Ceres's getters, and
/// the sizes of cost functions, at the same time, those of manifolds one after the other; the view
/// is the same. Without
/// may_have_bounds no block has any.
void Introspect(const ceres::Problem& problem, ProblemView* view, int num_threads = 1,
                bool may_have_bounds = true);

/// The same of a problem in which, since this view was taken, nothing but values has changed. Cost:
/// linear in parameters.
void IntrospectValues(const ceres::Problem& problem, ProblemView* view);

/// "parameter block 0x55… of size 7", for messages.
std::string Describe(const ParameterBlockView& block);

}  // namespace inceres::internal
