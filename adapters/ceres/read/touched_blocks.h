#pragma once

#include <cstddef>
#include <cstdint>
#include <vector>

#include <ceres/problem.h>

#include "adapters/ceres/read/introspection.h"
#include "src/base/aligned_vector.h"

namespace inceres::internal {

/// The parameter blocks of a problem as its residual blocks show them, and what these have to say
/// of themselves, in one pass over them.
///
/// Ceres shows parameter blocks by address, node by node of its map. Of many blocks most nodes are
/// not in the cache, and each is waited for before it is known where the next one is. What residual
/// blocks point to, mostly all of them, can be asked for some at a time.
class TouchedBlocks {
 public:
  /// Whether that is the faster way for so many parameter blocks and residual blocks.
  static bool Serve(std::size_t num_blocks, std::size_t num_residual_blocks);

  /// Reads the residual blocks whose ids the view has. Writes to the view their costs, losses,
  /// numbers of residuals and of slots, where in slots() these begin, and whether they are `sound`
  /// but for blocks that are there twice. False if a parameter block is touched by none, or a cost
  /// function has other sizes than when it was added: then nothing of this is of use.
  ///
  /// One thread looks parameter blocks up as it meets them, when most of what there is of them has
  /// just come to the cache. Several read residual blocks at the same time.
  bool Find(const ceres::Problem& problem, int num_threads, ProblemView* view);
  /// Gives the view its blocks, by address. Now slots() and the view's index go by that order.
  void SortByAddress(int num_threads, ProblemView* view);

  /// Of all residual blocks; empty before Find.
  const UnwrittenVector<int>& slots() const { return slots_; }
  /// Whether parameter blocks are, but for their bounds and what their manifolds have to say.
  bool have_been_looked_up() const { return have_been_looked_up_; }

 private:
  // Residual blocks that follow each other, and the parameter blocks that they touch, in the order
  // in which these are met.
  struct Part {
    std::size_t begin = 0;  // residual blocks
    std::size_t end = 0;
    std::vector<double*> blocks;
    std::vector<int> sizes;    // of these
    std::vector<int> numbers;  // of these among all blocks
    std::vector<int> slots;    // of the residual blocks, by these
    bool is_sound = true;      // each block has one size
  };

  static void Read(const ceres::Problem& problem, ProblemView* view, Part* part);
  bool Number(const ceres::Problem& problem, ProblemView* view, Part* part);
  void Place(const Part& part, std::size_t first_slot, ProblemView* view);

  std::vector<ParameterBlockView> blocks_;  // in the order in which they are met
  UnwrittenVector<int> slots_;
  std::int64_t num_parameters_ = 0;  // of these blocks
  bool have_been_looked_up_ = false;
};

/// Asks for all of a block but its bounds and what its manifold has to say; for its size only if
/// that is not known yet, but 0.
void LookUpBlock(const ceres::Problem& problem, ParameterBlockView* block);

/// Reads the residual blocks into a view that has its parameter blocks and the ids of its residual
/// blocks. `touched`: what has been read of them, or empty. The view is the same with any number of
/// threads. In residual_reader.cc.
void ReadResidualBlocks(const ceres::Problem& problem, const TouchedBlocks& touched,
                        int num_threads, ProblemView* view);

}  // namespace inceres::internal
