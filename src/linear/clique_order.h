#pragma once

#include <vector>

#include "inceres/linear/reduced_solver.h"
#include "inceres/status.h"
#include "linear/symbolic_factor.h"

namespace inceres::internal {

/// The part of a symmetric matrix that is to be eliminated anew, once what is not has been: its
/// variables, the blocks of the matrix between them, and the separators of the subtrees that stay,
/// each of which couples all of its variables.
struct EliminationGraph {
  std::vector<int> sizes;                        // scalars of each variable
  std::vector<int> edge_begin{0}, edges;         // per variable: coupled ones of a lower number
  std::vector<int> separator_begin{0}, members;  // per subtree: variables
  std::vector<char> last;   // per variable: it is to come after all others of its group
  std::vector<int> groups;  // per variable; empty: all are in one

  int num_variables() const { return static_cast<int>(sizes.size()); }
  int num_subtrees() const { return static_cast<int>(separator_begin.size()) - 1; }
  void Clear();
};

/// An order of its variables by constrained AMD, and its fronts. A subtree takes part as a variable
/// that comes before all others: eliminating it couples its separator. kUnavailable when out of
/// memory. Sources: Amestoy, Davis & Duff, ACM TOMS 30(3), 2004; Kaess et al., "iSAM2", IJRR 31(2),
/// 2012, section 3.3 (what was touched last comes last, for that is where the next change will be).
class CliqueOrder {
 public:
  Status Find(const EliminationGraph& graph, SymbolicFactor* factor);

 private:
  bool OrderByCamd(const EliminationGraph& graph);
  void ListPattern(const EliminationGraph& graph);
  template <typename Visit>
  void ForEachStarEdge(const EliminationGraph& graph, const Visit& visit) const;

  std::vector<int> columns_begin_, columns_, constraints_, permutation_;
  std::vector<int> order_, position_;
  BlockPattern pattern_;
};

}  // namespace inceres::internal
