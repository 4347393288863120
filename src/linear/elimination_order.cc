#include "linear/elimination_order.h"

#include "linear/automatic_solver.h"
#include "linear/dense_cholesky.h"
#include "linear/lagged_pcg.h"
#include "linear/path_cholesky.h"
#include "linear/sparse_cholesky.h"

namespace inceres::internal {

// What reports tell of the order of a factor, and tests hold against the groups that were asked
// for. Each solver keeps its order in its own way: by places of the pattern, by places of rows that
// live on, or by the stamps of cliques.

namespace {

// Stamps rise from children to parents, so cliques by their stamps are in the order of elimination.
std::vector<int> OrderOf(const CliqueTree& tree) {
  std::vector<int> cliques;
  for (int c = 0; c < static_cast<int>(tree.cliques().size()); ++c) {
    if (tree.clique(c).is_used) {
      cliques.push_back(c);
    }
  }
  tree.SortByStamp(&cliques);
  std::vector<int> rows;
  for (const int c : cliques) {
    const Clique& clique = tree.clique(c);
    rows.insert(rows.end(), clique.rows.begin(), clique.rows.begin() + clique.num_pivots);
  }
  return rows;
}

}  // namespace

std::vector<int> EliminationOrderOf(const ReducedSolver& solver) {
  if (const auto* dense = dynamic_cast<const DenseCholesky*>(&solver)) {
    return dense->order();
  }
  if (const auto* sparse = dynamic_cast<const SparseCholesky*>(&solver)) {
    return sparse->tree().order;
  }
  if (const auto* paths = dynamic_cast<const PathCholesky*>(&solver)) {
    return paths->order();
  }
  // Its preconditioner is such a factor.
  const auto* iterative = dynamic_cast<const LaggedPcg*>(&solver);
  return iterative != nullptr ? EliminationOrderOf(iterative->factor()) : std::vector<int>();
}

std::vector<int> EliminationOrderOf(const ReducedSolver& solver, const SymmetricBlockRows& S) {
  if (const auto* automatic = dynamic_cast<const AutomaticSolver*>(&solver)) {
    return EliminationOrderOf(*automatic->chosen(), S);
  }
  if (const auto* tree = dynamic_cast<const BayesTree*>(&solver)) {
    return OrderOf(tree->tree());
  }
  if (const auto* resumed = dynamic_cast<const ResumedSolver*>(&solver)) {
    return resumed->order().rows();
  }
  // The others know the living rows only, as the pattern numbers them.
  std::vector<int> order = EliminationOrderOf(solver);
  for (int& row : order) {
    row = S.pattern_rows()[row];
  }
  return order;
}

}  // namespace inceres::internal
