#pragma once

#include <algorithm>
#include <cstddef>
#include <cstdint>
#include <vector>

#include "base/aligned_vector.h"
#include "inceres/status.h"
#include "linear/block_rows.h"
#include "linear/clique_order.h"
#include "linear/front_tree.h"

namespace inceres::internal {

/// A clique of the Bayes tree: rows of S that are eliminated together, its pivots, and the rows
/// that these are conditioned on, its separator, which are pivots further up. With what is kept of
/// it by who factors: columns L of the factor, update matrix U for the parent, and y = L⁻¹b.
struct Clique {
  bool is_used = false;
  Front front;                 // its shape and its parent; no children or pieces
  std::vector<int> rows;       // of S: pivots in the order of elimination, then the separator
  std::vector<int> places;     // per row: its first scalar row in the front
  int num_pivots = 0;          // rows
  std::int64_t stamp = 0;      // rises from children to parents
  std::vector<FrontRun> runs;  // the separator in the parent's front
  std::vector<int> children;

  AlignedVector<double> L, U, y;
  bool is_factored = false;     // L and U belong to S
  bool is_substituted = false;  // y belongs to L and b
};

/// Memory of cliques that are gone, for those to come, by size: what is handed out is at most a
/// quarter larger than asked for, and no more waits than is in use.
class CliqueMemory {
 public:
  /// An array of this size; its entries are anything.
  AlignedVector<double> Take(std::size_t size);
  void Give(AlignedVector<double>* array);
  /// What waits and what is in use.
  std::size_t Bytes() const { return bytes_waiting_ + bytes_in_use_; }

 private:
  std::vector<std::vector<AlignedVector<double>>> waiting_;  // by class of size
  std::size_t bytes_waiting_ = 0;
  std::size_t bytes_in_use_ = 0;
};

/// The tree of cliques of an S that grows: the elimination tree, its columns joined to fronts as
/// those of the batch factor are. What an edit of S does not reach stays as it is. A new block or
/// row dissolves the cliques of its rows and all that are above them; their rows are ordered anew,
/// beneath whose new cliques the subtrees that hung on them are hung again.
///
/// Cost of an edit: constrained AMD on what was dissolved. Deterministic. Source: Kaess et al.,
/// "iSAM2: Incremental smoothing and mapping using the Bayes tree", IJRR 31(2), 2012, algorithm 4.
class CliqueTree {
 public:
  static constexpr int kNone = -1;

  bool Has(int row) const {
    return row < static_cast<int>(rows_.size()) && rows_[row].clique != kNone;
  }
  int SizeOf(int row) const { return rows_[row].size; }
  /// That it was ordered by.
  int GroupOf(int row) const { return rows_[row].group; }
  /// The clique that has the row among its pivots.
  int CliqueOf(int row) const { return rows_[row].clique; }
  /// First scalar row of it there.
  int PlaceOf(int row) const { return rows_[row].place; }
  bool IsBefore(int row, int other) const { return rows_[row].stamp < rows_[other].stamp; }
  /// Whether the factor has a block where these two meet.
  bool AreCoupled(int row, int other) const;

  Clique& clique(int c) { return cliques_[c]; }
  const Clique& clique(int c) const { return cliques_[c]; }
  const std::vector<Clique>& cliques() const { return cliques_; }
  const std::vector<int>& roots() const { return roots_; }
  int num_rows() const { return static_cast<int>(rows_.size()); }

  /// Clears a flag of a clique and those above it, up to the first that lacks it, and lists them.
  void ClearUpwards(int c, bool Clique::*flag, std::vector<int>* cleared) {
    for (; c != kNone && cliques_[c].*flag; c = cliques_[c].front.parent) {
      cliques_[c].*flag = false;
      cleared->push_back(c);
    }
  }
  /// Children before their parents.
  void SortByStamp(std::vector<int>* cliques) const {
    std::sort(cliques->begin(), cliques->end(),
              [this](int a, int b) { return cliques_[a].stamp < cliques_[b].stamp; });
  }
  /// Takes those out of a list that were dissolved.
  void EraseUnused(std::vector<int>* cliques) const {
    cliques->erase(std::remove_if(cliques->begin(), cliques->end(),
                                  [this](int c) { return !cliques_[c].is_used; }),
                   cliques->end());
  }

  /// The clique of this row, and those above, are to be put together anew.
  void Dissolve(int row) { DissolveFrom(CliqueOf(row)); }
  /// The same for all cliques that know the row; it leaves the tree.
  void Remove(int row);
  /// The cliques that Rebuild puts together anew.
  const std::vector<int>& dissolved() const { return dissolved_; }
  /// Whether no row waits for Rebuild.
  bool IsWhole() const { return dissolved_.empty(); }

  /// Puts the rows of dissolved cliques, and these of S that the tree does not have, into new ones,
  /// `last` of them last, or the newest of those if they are many; lists the new cliques.
  /// kUnavailable when out of memory: they wait on then.
  Status Rebuild(const SymmetricBlockRows& S, const std::vector<int>& new_rows,
                 const std::vector<int>& last, std::vector<int>* new_cliques);

  /// Flops of one factorization of all of it.
  double flops() const { return flops_; }
  std::size_t Bytes() const {
    return cliques_.capacity() * sizeof(Clique) + rows_.capacity() * sizeof(Row) + memory_.Bytes() +
           list_bytes_;
  }

 private:
  struct Row {
    int clique = kNone;
    int place = 0;
    int size = 0;
    int group = 0;
    std::int64_t stamp = 0;
  };

  void DissolveFrom(int c);
  void ListLooseRows(const SymmetricBlockRows& S, const std::vector<int>& new_rows);
  void ListGraph(const SymmetricBlockRows& S, const std::vector<int>& last);
  void ListOrphans();
  void ReleaseDissolved();
  int TakeClique();
  void MakeClique(int front);
  void Hang(int child);
  void FindRuns(int parent);

  std::vector<Row> rows_;  // by row of S
  std::vector<Clique> cliques_;
  std::vector<int> free_;  // unused cliques
  CliqueMemory memory_;
  std::size_t list_bytes_ = 0;  // of the cliques' lists, and of roots_
  std::vector<int> roots_;
  std::vector<int> dissolved_;
  double flops_ = 0.0;
  std::int64_t next_stamp_ = 0;

  // Of a Rebuild.
  std::vector<int> loose_;    // rows without a clique, ascending
  std::vector<int> orphans_;  // cliques without a parent
  std::vector<int> local_;    // per row: its number among the loose ones; kNone: it has none
  std::vector<int> place_;    // per row of a front: its first scalar row there
  std::vector<int> made_;     // per front: its clique
  EliminationGraph graph_;
  CliqueOrder order_;
  SymbolicFactor factor_;
};

}  // namespace inceres::internal
