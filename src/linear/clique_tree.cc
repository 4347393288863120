#include "linear/clique_tree.h"

#include <algorithm>
#include <iterator>
#include <utility>

#include "base/growth_count.h"

namespace inceres::internal {

// The Bayes tree of the frames as a structure (docs/algorithms.md, "Reduced linear systems"; Kaess
// et al. 2012, algorithm 4): which rows of S are eliminated together, in which order, and where
// each clique's arrays are. The values are the business of BayesTree.
//
// Two facts carry it. The separator of a clique lies within the rows of its parent, so whatever
// knows a row hangs below the clique that eliminates it. And elimination depends on what is below
// only through the update matrices, so that a subtree may stay as it is, and hang elsewhere, as
// long as the rows of its separator stay coupled; that is what CliqueOrder sees to.
//
// Stamps stand for the order of elimination over all edits: they rise within a clique and from
// children to parents. New cliques get higher stamps than all others, which is right because what
// is dissolved is always a top of the tree: a clique with all that is above it.

namespace {

// Rows come last if they are no more than one in so many, else the newest of them: an order in two
// parts has more fill.
constexpr std::size_t kLastShare = 4;

// Classes of sizes, four to each power of two: the class of a size, and what all of it fits into.
// The steps of a class are an eighth to a quarter of its sizes, which bounds what is wasted.
std::size_t ClassOf(std::size_t size, std::size_t* room) {
  std::size_t step = 1, index = 0;
  while (8 * step < size) {
    step *= 2;
    index += 4;
  }
  const std::size_t steps = std::max<std::size_t>(5, (size + step - 1) / step);
  *room = steps * step;
  return index + steps - 5;
}

}  // namespace

AlignedVector<double> CliqueMemory::Take(std::size_t size) {
  std::size_t room = 0;
  // What waits in this class has room for the largest size of the class.
  const std::size_t index = ClassOf(size, &room);
  AlignedVector<double> array;
  if (index < waiting_.size() && !waiting_[index].empty()) {
    array = std::move(waiting_[index].back());
    waiting_[index].pop_back();
    bytes_waiting_ -= array.capacity() * sizeof(double);
  } else {
    array.reserve(room);
  }
  bytes_in_use_ += array.capacity() * sizeof(double);
  array.resize(size);
  return array;
}

void CliqueMemory::Give(AlignedVector<double>* array) {
  if (array->capacity() == 0) {
    return;
  }
  const std::size_t bytes = array->capacity() * sizeof(double);
  bytes_in_use_ -= bytes;
  AlignedVector<double> given;
  given.swap(*array);
  // No more memory waits than is in use: a tree that shrinks gives it back.
  if (bytes_waiting_ + bytes > bytes_in_use_) {
    return;
  }
  std::size_t room = 0;
  const std::size_t index = ClassOf(given.capacity(), &room);
  waiting_.resize(std::max(waiting_.size(), index + 1));
  bytes_waiting_ += bytes;
  waiting_[index].push_back(std::move(given));
}

// The clique of the row that is eliminated first has the other one among its rows, or nobody has.
bool CliqueTree::AreCoupled(int row, int other) const {
  const int first = IsBefore(row, other) ? row : other;
  const std::vector<int>& rows = cliques_[CliqueOf(first)].rows;
  return std::find(rows.begin(), rows.end(), first == row ? other : row) != rows.end();
}

void CliqueTree::DissolveFrom(int c) {
  // Upwards until a clique is dissolved already: then all that are above it are, too. The arrays
  // and the list of children stay until ReleaseDissolved, for the orphans are found through them.
  for (; c != kNone && cliques_[c].is_used; c = cliques_[c].front.parent) {
    Clique& clique = cliques_[c];
    clique.is_used = false;
    dissolved_.push_back(c);
    flops_ -= clique.front.flops();
  }
}

// The cliques that know a row are a subtree below the one that it is a pivot of.
void CliqueTree::Remove(int row) {
  DissolveFrom(CliqueOf(row));
  // A child that does not know the row has no descendant that does, so the search stops there.
  std::vector<int> waiting{CliqueOf(row)};
  while (!waiting.empty()) {
    const std::vector<int>& children = cliques_[waiting.back()].children;
    waiting.pop_back();
    for (const int child : children) {
      const std::vector<int>& rows = cliques_[child].rows;
      if (std::find(rows.begin(), rows.end(), row) != rows.end()) {
        DissolveFrom(child);
        waiting.push_back(child);
      }
    }
  }
  rows_[row] = Row();
}

Status CliqueTree::Rebuild(const SymmetricBlockRows& S, const std::vector<int>& new_rows,
                           const std::vector<int>& last, std::vector<int>* new_cliques) {
  new_cliques->clear();
  made_.clear();
  rows_.resize(S.num_rows());
  // Rows that have no clique are numbered from 0, for the order; the numbers are taken back below.
  local_.resize(S.num_rows(), kNone);
  place_.resize(S.num_rows());
  ListLooseRows(S, new_rows);
  ListGraph(S, last);
  ListOrphans();
  // Until here nothing has been given up: without an order the rows wait for another try.
  const Status found = loose_.empty() ? Status::Ok() : order_.Find(graph_, &factor_);
  if (found.ok()) {
    ReleaseDissolved();
    for (int f = 0; !loose_.empty() && f + 1 < static_cast<int>(factor_.front_begin.size()); ++f) {
      MakeClique(f);
    }
  }
  // Also where the order failed: the next call numbers others.
  std::for_each(loose_.begin(), loose_.end(), [this](int row) { local_[row] = kNone; });
  if (!found.ok()) {
    return found;
  }
  // Parents are known by the row they eliminate, so all cliques have to be there before one is
  // hung.
  std::for_each(made_.begin(), made_.end(), [this](int c) { Hang(c); });
  std::for_each(orphans_.begin(), orphans_.end(), [this](int c) { Hang(c); });
  std::for_each(made_.begin(), made_.end(), [this](int c) { FindRuns(c); });
  new_cliques->assign(made_.begin(), made_.end());
  return Status::Ok();
}

void CliqueTree::ListLooseRows(const SymmetricBlockRows& S, const std::vector<int>& new_rows) {
  // New rows, and the pivots of dissolved cliques but for those that have left S or the tree
  // (Remove).
  loose_ = new_rows;
  for (const int c : dissolved_) {
    const Clique& clique = cliques_[c];
    std::copy_if(clique.rows.begin(), clique.rows.begin() + clique.num_pivots,
                 std::back_inserter(loose_),
                 [&](int row) { return rows_[row].clique == c && S.size_of(row) > 0; });
  }
  // Ascending, so that the order does not depend on the history of the cliques.
  std::sort(loose_.begin(), loose_.end());
  for (std::size_t k = 0; k < loose_.size(); ++k) {
    local_[loose_[k]] = static_cast<int>(k);
  }
}

// The blocks of S between loose rows. Those with a row that still has a clique are assembled there,
// in a subtree that takes part as a whole.
void CliqueTree::ListGraph(const SymmetricBlockRows& S, const std::vector<int>& last) {
  graph_.Clear();
  for (const int row : loose_) {
    graph_.sizes.push_back(S.size_of(row));
    if (S.has_groups()) {
      graph_.groups.push_back(S.group_of(row));
    }
    for (const SymmetricBlockRows::Entry& entry : S.row(row)) {
      if (entry.column != row && local_[entry.column] != kNone) {
        graph_.edges.push_back(local_[entry.column]);
      }
    }
    graph_.edge_begin.push_back(static_cast<int>(graph_.edges.size()));
  }
  graph_.last.assign(loose_.size(), 0);
  // Putting many rows last costs more fill than the next change there would save.
  const int newest = last.empty() ? kNone : *std::max_element(last.begin(), last.end());
  const bool are_few = kLastShare * last.size() <= loose_.size();
  for (const int row : last) {
    if ((are_few || row == newest) && local_[row] != kNone) {
      graph_.last[local_[row]] = 1;
    }
  }
}

// Every row of a separator is a pivot of a clique above: those of orphans are loose.
void CliqueTree::ListOrphans() {
  orphans_.clear();
  for (const int c : dissolved_) {
    for (const int child : cliques_[c].children) {
      const Clique& orphan = cliques_[child];
      // It was dissolved itself: its children are orphans in their own right.
      if (!orphan.is_used) {
        continue;
      }
      orphans_.push_back(child);
      for (std::size_t k = orphan.num_pivots; k < orphan.rows.size(); ++k) {
        // A separator of at least one row: a clique whose parent was dissolved has one.
        graph_.members.push_back(local_[orphan.rows[k]]);
      }
      graph_.separator_begin.push_back(static_cast<int>(graph_.members.size()));
    }
  }
}

void CliqueTree::ReleaseDissolved() {
  for (const int c : dissolved_) {
    Clique& clique = cliques_[c];
    clique.children.clear();
    // Arrays go back before new cliques take theirs, often of the same sizes.
    for (AlignedVector<double>* array : {&clique.L, &clique.U, &clique.y}) {
      memory_.Give(array);
    }
    free_.push_back(c);
  }
  dissolved_.clear();
  roots_.erase(
      std::remove_if(roots_.begin(), roots_.end(), [this](int c) { return !cliques_[c].is_used; }),
      roots_.end());
}

int CliqueTree::TakeClique() {
  if (free_.empty()) {
    cliques_.emplace_back();
    return static_cast<int>(cliques_.size()) - 1;
  }
  const int c = free_.back();
  free_.pop_back();
  return c;
}

// Front f of the symbolic factor becomes a clique. Fronts come children first, so stamps ascend as
// they should.
void CliqueTree::MakeClique(int f) {
  const int c = TakeClique();
  made_.push_back(c);
  Clique& clique = cliques_[c];
  clique.is_used = true;
  clique.is_factored = clique.is_substituted = false;
  clique.front = Front();
  clique.num_pivots = factor_.front_begin[f + 1] - factor_.front_begin[f];
  clique.stamp = next_stamp_;
  const GrowthCount of_rows(clique.rows, &list_bytes_), of_places(clique.places, &list_bytes_);
  clique.rows.clear();
  clique.places.clear();
  clique.runs.clear();
  for (int k = factor_.row_begin[f]; k < factor_.row_begin[f + 1]; ++k) {
    // From a position in the order to a loose row, and from there to a row of S.
    const int row = loose_[factor_.order[factor_.rows[k]]];
    const int size = graph_.sizes[local_[row]];
    const bool is_pivot = static_cast<int>(clique.rows.size()) < clique.num_pivots;
    // The pivots' rows are padded to quads before the separator begins: below().
    const int place = is_pivot ? clique.front.width : clique.front.below() + clique.front.height;
    (is_pivot ? clique.front.width : clique.front.height) += size;
    if (is_pivot) {
      const int group = graph_.groups.empty() ? 0 : graph_.groups[local_[row]];
      rows_[row] = {c, place, size, group, next_stamp_++};
    }
    clique.rows.push_back(row);
    clique.places.push_back(place);
  }
  flops_ += clique.front.flops();
  const Front& front = clique.front;
  // The entries are anything: is_factored and is_substituted tell that nothing of it may be read.
  clique.L = memory_.Take(static_cast<std::size_t>(front.stride()) * front.width);
  clique.U = memory_.Take(static_cast<std::size_t>(front.update_stride()) * front.height);
  clique.y = memory_.Take(front.num_rows());
}

// On the clique that eliminates the first row of its separator.
void CliqueTree::Hang(int child) {
  Clique& clique = cliques_[child];
  const auto first = std::min_element(clique.rows.begin() + clique.num_pivots, clique.rows.end(),
                                      [this](int a, int b) { return IsBefore(a, b); });
  // Without a separator it is a root: S may fall apart into several components.
  clique.front.parent = first == clique.rows.end() ? kNone : CliqueOf(*first);
  std::vector<int>& list =
      clique.front.parent == kNone ? roots_ : cliques_[clique.front.parent].children;
  const GrowthCount growth(list, &list_bytes_);
  list.push_back(child);
}

// What is consecutive in both is one run.
// For all children of this clique; those that stayed may have got another parent, with other
// places.
void CliqueTree::FindRuns(int parent) {
  const Clique& above = cliques_[parent];
  for (std::size_t k = 0; k < above.rows.size(); ++k) {
    // Not cleared afterwards: of a child only rows are looked up that the parent has.
    place_[above.rows[k]] = above.places[k];
  }
  for (const int child : above.children) {
    Clique& clique = cliques_[child];
    const GrowthCount growth(clique.runs, &list_bytes_);
    clique.runs.clear();
    for (std::size_t k = clique.num_pivots; k < clique.rows.size(); ++k) {
      const int from = clique.places[k] - clique.front.below(), to = place_[clique.rows[k]];
      const int size = SizeOf(clique.rows[k]);
      // Places in the child ascend without gaps, so a run ends only where the parent has a gap or
      // another order.
      if (!clique.runs.empty() && clique.runs.back().to + clique.runs.back().length == to) {
        clique.runs.back().length += size;
      } else {
        clique.runs.push_back({from, to, size});
      }
    }
  }
}

}  // namespace inceres::internal
