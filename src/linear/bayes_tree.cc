#include "linear/bayes_tree.h"

#include <algorithm>
#include <functional>
#include <limits>
#include <numeric>
#include <string>

#include "linear/dense_panel.h"
#include "linear/front_elimination.h"

namespace inceres::internal {
namespace {

// Calls visit(row of the block, its entry, the other row) for the blocks off the diagonal.
template <typename Visit>
void ForEachBlockOf(const SymmetricBlockRows& S, int row, const Visit& visit) {
  for (const SymmetricBlockRows::Entry& entry : S.row(row)) {
    if (entry.column != row) {
      visit(row, entry, entry.column);
    }
  }
  for (const int below : S.below(row)) {
    visit(below, SymmetricBlockRows::Entry{row, S.Find(below, row)}, below);
  }
}

void ListNeighbors(const SymmetricBlockRows& S, int row, std::vector<int>* neighbors) {
  neighbors->clear();
  for (const SymmetricBlockRows::Entry& entry : S.row(row)) {
    if (entry.column != row) {
      neighbors->push_back(entry.column);
    }
  }
  neighbors->insert(neighbors->end(), S.below(row).begin(), S.below(row).end());
}

bool IsLeftOut(const ReducedMatrix& A, int row, int column) {
  return A.constant() != nullptr && (A.constant()[row] != 0 || A.constant()[column] != 0);
}

// Adds to, or takes from, an ascending list.
void AddTo(std::vector<int>* list, int value) {
  const auto at = std::lower_bound(list->begin(), list->end(), value);
  if (at == list->end() || *at != value) {
    list->insert(at, value);
  }
}
void TakeFrom(std::vector<int>* list, int value) {
  const auto at = std::lower_bound(list->begin(), list->end(), value);
  if (at != list->end() && *at == value) {
    list->erase(at);
  }
}

}  // namespace

void BayesTree::Follow(const SymmetricBlockRows& S, const Rows& changed) {
  rows_.resize(std::max(rows_.size(), static_cast<std::size_t>(S.num_rows())));
  const auto add = [this](int row) {
    if (!rows_[row].is_pending) {
      rows_[row].is_pending = true;
      pending_.push_back(row);
    }
  };
  if (changed.rows != nullptr) {
    std::for_each(changed.rows->begin(), changed.rows->end(), add);
    return;
  }
  for (int row = std::max(0, changed.first_row); row < S.num_rows(); ++row) {
    add(row);
  }
}

Status BayesTree::PlanFor(const ReducedMatrix& A) {
  const SymmetricBlockRows& S = *A.rows();
  std::sort(pending_.begin(), pending_.end());
  if (version_ != S.version()) {
    FollowPacking(S);
    touched_.clear();
    ForgetLostRows(S);
    TakeUpNewBlocks(S);
    Status rebuilt = RebuildTree(S);
    if (!rebuilt.ok()) {
      return rebuilt;
    }
    version_ = S.version();
  }
  for (const int row : pending_) {
    rows_[row].is_pending = false;
    if (S.size_of(row) > 0) {
      FindChangedBlocks(A, row);
    }
  }
  pending_.clear();
  flops_ = 0.0;
  for (const int c : stale_) {
    flops_ += tree_.clique(c).front.flops();
  }
  return Status::Ok();
}

// Where a row has gone or come back, x of the rows behind it is no longer where it was.
void BayesTree::FollowPacking(const SymmetricBlockRows& S) {
  const std::size_t known = offsets_.size();
  offsets_.resize(static_cast<std::size_t>(S.num_rows()) + 1);
  int offset = 0;
  for (int row = 0; row < S.num_rows(); ++row) {
    offset += S.size_of(row);
    solution_is_lost_ |= static_cast<std::size_t>(row) + 1 < known && offsets_[row + 1] != offset;
    offsets_[row + 1] = offset;
  }
  x_.resize(offset);
  passed_on_.resize(offset, std::numeric_limits<double>::quiet_NaN());  // unlike any x
}

void BayesTree::Forget(int row) {
  for (const int neighbor : rows_[row].neighbors) {
    TakeFrom(&rows_[neighbor].neighbors, row);
  }
  rows_[row].neighbors.clear();
  tree_.Remove(row);
}

// A row that has gone, or has come back as another, or without a block that it had.
void BayesTree::ForgetLostRows(const SymmetricBlockRows& S) {
  for (const int row : pending_) {
    if (!tree_.Has(row)) {
      continue;
    }
    ListNeighbors(S, row, &neighbors_);
    const std::vector<int>& known = rows_[row].neighbors;
    if (S.size_of(row) != tree_.SizeOf(row) ||
        !std::includes(neighbors_.begin(), neighbors_.end(), known.begin(), known.end())) {
      Forget(row);
    }
  }
}

void BayesTree::TakeUpNewBlocks(const SymmetricBlockRows& S) {
  for (const int row : pending_) {
    if (S.size_of(row) == 0) {
      continue;
    }
    if (!tree_.Has(row)) {
      AddTo(&new_rows_, row);
    }
    ListNeighbors(S, row, &neighbors_);
    if (neighbors_ == rows_[row].neighbors) {
      continue;
    }
    for (const int other : neighbors_) {
      const std::vector<int>& known = rows_[row].neighbors;
      if (!std::binary_search(known.begin(), known.end(), other)) {
        TakeUpNeighbor(row, other);
      }
    }
    rows_[row].neighbors = neighbors_;
  }
}

// The block is new. Where the factor has a place for it the tree may stay as it is.
void BayesTree::TakeUpNeighbor(int row, int other) {
  AddTo(&rows_[other].neighbors, row);
  touched_.push_back(row);
  touched_.push_back(other);
  const bool both = tree_.Has(row) && tree_.Has(other);
  if (both && tree_.AreCoupled(row, other)) {
    MarkStale(tree_.CliqueOf(tree_.IsBefore(row, other) ? row : other));
    return;
  }
  for (const int end : {row, other}) {
    if (tree_.Has(end)) {
      tree_.Dissolve(end);
    }
  }
}

Status BayesTree::RebuildTree(const SymmetricBlockRows& S) {
  if (tree_.IsWhole() && new_rows_.empty()) {
    return Status::Ok();
  }
  const auto is_dissolved = [this](int c) { return !tree_.clique(c).is_used; };
  for (std::vector<int>* list : {&stale_, &unsubstituted_}) {
    list->erase(std::remove_if(list->begin(), list->end(), is_dissolved), list->end());
  }
  Status rebuilt = tree_.Rebuild(S, new_rows_, new_rows_.empty() ? touched_ : new_rows_, &made_);
  if (rebuilt.ok()) {
    new_rows_.clear();
    stale_.insert(stale_.end(), made_.begin(), made_.end());
    unsubstituted_.insert(unsubstituted_.end(), made_.begin(), made_.end());
  }
  return rebuilt;
}

// A block lies in the columns of that of its rows which is eliminated first.
void BayesTree::FindChangedBlocks(const ReducedMatrix& A, int row) {
  const SymmetricBlockRows& S = *A.rows();
  const int own = tree_.CliqueOf(row);
  if (!assembled_.HasDiagonal(row, A.diagonal() + offsets_[row], S.size_of(row)) ||
      !assembled_.Has(S, row, S.row(row).back(), IsLeftOut(A, row, row))) {
    MarkStale(own);
  }
  ForEachBlockOf(S, row, [&](int i, const SymmetricBlockRows::Entry& block, int other) {
    const int c = tree_.IsBefore(row, other) ? own : tree_.CliqueOf(other);
    if (tree_.clique(c).is_factored &&
        !assembled_.Has(S, i, block, IsLeftOut(A, i, block.column))) {
      MarkStale(c);
    }
  });
}

void BayesTree::MarkStale(int c) {
  for (; c != CliqueTree::kNone && tree_.clique(c).is_factored; c = tree_.clique(c).front.parent) {
    tree_.clique(c).is_factored = false;
    stale_.push_back(c);
  }
}

void BayesTree::SortByStamp(std::vector<int>* cliques) const {
  std::sort(cliques->begin(), cliques->end(),
            [this](int a, int b) { return tree_.clique(a).stamp < tree_.clique(b).stamp; });
}

Status BayesTree::FactorizeAsPlanned(const ReducedMatrix& A) {
  work_ = Work();
  work_.factored_rows = work_.forward_rows = work_.solved_rows = 0;
  work_.factor_flops = flops_;
  SortByStamp(&stale_);
  factored_ = Status::Ok();
  std::size_t done = 0;
  for (; done < stale_.size(); ++done) {
    const int failed = Eliminate(A, stale_[done]);
    if (failed >= 0) {
      factored_ = Status::Error(
          StatusCode::kSingular,
          "the reduced system is not positive definite at block row " + std::to_string(failed));
      break;
    }
    Clique& clique = tree_.clique(stale_[done]);
    clique.is_factored = true;
    work_.factored_rows += clique.num_pivots;
    MarkUnsubstituted(stale_[done]);
  }
  stale_.erase(stale_.begin(), stale_.begin() + static_cast<std::ptrdiff_t>(done));
  return factored_;
}

void BayesTree::Assemble(const ReducedMatrix& A, int c) {
  const SymmetricBlockRows& S = *A.rows();
  Clique& clique = tree_.clique(c);
  const Front& front = clique.front;
  place_.resize(S.num_rows());
  for (std::size_t k = 0; k < clique.rows.size(); ++k) {
    place_[clique.rows[k]] = clique.places[k];
  }
  const auto take = [&](int i, const SymmetricBlockRows::Entry& block) {
    const bool left_out = IsLeftOut(A, i, block.column);
    assembled_.Take(S, i, block, left_out);
    if (!left_out) {
      PlaceBlock(S.values(block.offset), PadToQuad(S.size_of(block.column)), S.size_of(i),
                 S.size_of(block.column), place_[i], place_[block.column], clique.L.data(),
                 front.stride());
    }
  };
  for (int k = 0; k < clique.num_pivots; ++k) {
    const int row = clique.rows[k], size = S.size_of(row);
    take(row, S.row(row).back());
    ForEachBlockOf(S, row, [&](int i, const SymmetricBlockRows::Entry& block, int other) {
      if (tree_.IsBefore(row, other)) {
        take(i, block);
      }
    });
    const double* diagonal = A.diagonal() + offsets_[row];
    assembled_.TakeDiagonal(row, diagonal, size);
    double* pivot = clique.L.data() + place_[row] * (std::ptrdiff_t{front.stride()} + 1);
    for (int j = 0; j < size; ++j, pivot += front.stride() + 1) {
      *pivot += diagonal[j];
    }
  }
}

int BayesTree::Eliminate(const ReducedMatrix& A, int c) {
  Clique& clique = tree_.clique(c);
  const Front& front = clique.front;
  ZeroFront(front, clique.L.data(), clique.U.data());
  Assemble(A, c);
  for (const int child : clique.children) {
    const Clique& below = tree_.clique(child);
    AddUpdateMatrix(below.front, below.U.data(), below.runs.data(),
                    static_cast<int>(below.runs.size()), front, clique.L.data(), clique.U.data());
  }
  const int failed = EliminateFront(front, clique.L.data(), clique.U.data(), executor_);
  if (failed < 0) {
    return failed;
  }
  int k = 0;
  while (k + 1 < clique.num_pivots && clique.places[k + 1] <= failed) {
    ++k;
  }
  return clique.rows[k];
}

void BayesTree::MissSolve(const Rows& changed_b) {
  MarkChangedB(changed_b);
  solution_is_lost_ = true;
}

void BayesTree::MarkUnsubstituted(int c) {
  for (; c != CliqueTree::kNone && tree_.clique(c).is_substituted;
       c = tree_.clique(c).front.parent) {
    tree_.clique(c).is_substituted = false;
    unsubstituted_.push_back(c);
  }
}

void BayesTree::MarkChangedB(const Rows& changed_b) {
  const auto mark = [this](int row) {
    if (tree_.Has(row)) {
      MarkUnsubstituted(tree_.CliqueOf(row));
    }
  };
  if (changed_b.rows != nullptr) {
    std::for_each(changed_b.rows->begin(), changed_b.rows->end(), mark);
    return;
  }
  for (int row = std::max(0, changed_b.first_row); row < tree_.num_rows(); ++row) {
    mark(row);
  }
}

Status BayesTree::Solve(const double* b, const Rows& changed_b, const Truncation& truncation,
                        double* x) {
  MarkChangedB(changed_b);
  if (!factored_.ok()) {
    return factored_;
  }
  SubstituteForward(b);
  SubstituteBackward(truncation, x);
  return Status::Ok();
}

Status BayesTree::SolveForGain(const double* b, const Rows& changed_b, double* gain) {
  MarkChangedB(changed_b);
  if (!factored_.ok()) {
    return factored_;
  }
  SubstituteForward(b);
  *gain = 0.0;
  for (const Clique& clique : tree_.cliques()) {
    if (clique.is_used) {
      const auto end = clique.y.begin() + clique.front.below();
      *gain += 0.5 * std::inner_product(clique.y.begin(), end, clique.y.begin(), 0.0);
    }
  }
  return Status::Ok();
}

void BayesTree::SubstituteForward(const double* b) {
  SortByStamp(&unsubstituted_);
  is_fresh_.resize(tree_.cliques().size(), 0);
  work_.forward_rows = 0;
  for (const int c : unsubstituted_) {
    Clique& clique = tree_.clique(c);
    clique.is_substituted = true;
    is_fresh_[c] = 1;
    work_.forward_rows += clique.num_pivots;
    std::fill(clique.y.begin(), clique.y.end(), 0.0);
    for (int k = 0; k < clique.num_pivots; ++k) {
      const int row = clique.rows[k];
      std::copy_n(b + offsets_[row], tree_.SizeOf(row), clique.y.begin() + clique.places[k]);
    }
    for (const int child : clique.children) {
      const Clique& below = tree_.clique(child);
      const double* update = below.y.data() + below.front.below();
      for (const FrontRun& run : below.runs) {
        std::transform(update + run.from, update + run.from + run.length, clique.y.begin() + run.to,
                       clique.y.begin() + run.to, std::plus<>());
      }
    }
    SolveFrontForward(clique.front, clique.L.data(), clique.y.data());
  }
  unsubstituted_.clear();
}

void BayesTree::SubstituteBackward(const Truncation& truncation, double* x) {
  ++num_solves_;
  solved_.clear();
  const auto is_root_to_solve = [this](int c) { return solution_is_lost_ || is_fresh_[c] != 0; };
  waiting_.clear();
  std::copy_if(tree_.roots().begin(), tree_.roots().end(), std::back_inserter(waiting_),
               is_root_to_solve);
  while (!waiting_.empty()) {
    const int c = waiting_.back();
    waiting_.pop_back();
    SolveClique(c, truncation, x);
    PushChildren(c);
  }
  solution_is_lost_ = false;
  std::fill(is_fresh_.begin(), is_fresh_.end(), 0);
  std::sort(solved_.begin(), solved_.end());
  work_.solved_rows = static_cast<int>(solved_.size());
  work_.solved = {solved_.empty() ? tree_.num_rows() : solved_.front(), &solved_};
}

// x₁ = L₁⁻ᵀ (y₁ − L₂ᵀ x₂)
void BayesTree::SolveClique(int c, const Truncation& truncation, double* x) {
  const Clique& clique = tree_.clique(c);
  const Front& front = clique.front;
  workspace_.resize(std::max(workspace_.size(), static_cast<std::size_t>(front.num_rows())));
  std::copy_n(clique.y.begin(), front.below(), workspace_.begin());
  for (std::size_t k = clique.num_pivots; k < clique.rows.size(); ++k) {
    const int row = clique.rows[k];
    std::copy(x_.begin() + offsets_[row], x_.begin() + offsets_[row + 1],
              workspace_.begin() + clique.places[k]);
  }
  std::fill(workspace_.begin() + front.below() + front.height,
            workspace_.begin() + front.num_rows(), 0.0);
  SolveFrontBackward(front, clique.L.data(), workspace_.data());
  for (int k = 0; k < clique.num_pivots; ++k) {
    const int row = clique.rows[k], begin = offsets_[row], end = offsets_[row + 1];
    std::copy_n(workspace_.begin() + clique.places[k], end - begin, x_.begin() + begin);
    std::copy(x_.begin() + begin, x_.begin() + end, x + begin);
    solved_.push_back(row);
    if (solution_is_lost_ || HasChanged(begin, end, truncation)) {
      std::copy(x_.begin() + begin, x_.begin() + end, passed_on_.begin() + begin);
      rows_[row].moved = num_solves_;
    }
  }
}

// y or an x above has changed. What the child does not know, those below it do not.
void BayesTree::PushChildren(int c) {
  for (const int child : tree_.clique(c).children) {
    const Clique& clique = tree_.clique(child);
    const bool reached = solution_is_lost_ || is_fresh_[child] != 0 ||
                         std::any_of(clique.rows.begin() + clique.num_pivots, clique.rows.end(),
                                     [this](int row) { return rows_[row].moved == num_solves_; });
    if (reached) {
      waiting_.push_back(child);
    }
  }
}

bool BayesTree::HasChanged(int begin, int end, const Truncation& truncation) const {
  if (truncation.threshold <= 0.0) {
    return !std::equal(x_.begin() + begin, x_.begin() + end, passed_on_.begin() + begin);
  }
  double change = 0.0;
  for (int k = begin; k < end; ++k) {
    const double difference = x_[k] - passed_on_[k];
    change += truncation.weights[k] * difference * difference;
  }
  return !(change <= truncation.threshold);
}

std::size_t BayesTree::Bytes() const {
  std::size_t bytes = tree_.Bytes() + assembled_.Bytes() + rows_.capacity() * sizeof(Row) +
                      (x_.capacity() + passed_on_.capacity()) * sizeof(double);
  for (const Row& row : rows_) {
    bytes += row.neighbors.capacity() * sizeof(int);
  }
  return bytes;
}

}  // namespace inceres::internal
