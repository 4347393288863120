#include "linear/resumed_solver.h"

#include <algorithm>
#include <numeric>

#include "linear/group_order.h"
#include "linear/not_positive_definite.h"

namespace inceres::internal {

// The envelope factor that is resumed (docs/algorithms.md, "Reduced linear systems", resuming;
// Kaess et al. 2012, algorithm 7, for the wildfire). What is right is kept as leading rows, each a
// number:
//
//     num_exact_        rows of L that belong to S
//     num_current_y_    rows of y = L⁻¹b that belong to L and b
//     num_passed_on_    rows of L as they were at the last Solve
//
// A change lowers them, a factorization or a substitution raises them again. Since row i depends on
// rows up to i alone, one number is enough, and what a call does not reach keeps its bits.
//
// Backwards it is the other way round: x_i depends on the rows behind i. reached_before_ is the
// first row that something changed since the last Solve was coupled to. Going back from the last
// row, the substitution may end when no changed row reaches further up; passed_on_ holds the x that
// the rows above have seen, so that small changes add up until they are passed on.
//
// An order that has aged is replaced from num_exact_ on only: what is before it stays factored.

namespace {

// Flops a block of S to be refactored below which another order is not looked for. Looking takes
// about a tenth of the time of so many. A chain of frames, each of 6 and coupled to 15 others,
// takes a third of it.
constexpr double kLookFlops = 1e4;

// What else an entry of L takes, as flops that one could do meanwhile: the ends of its dot product,
// and waiting for the entries before it. Blocks of 3 take 27 ns whatever the rows' length up to 20
// blocks, those of 6 74 ns.
constexpr double kEntryFlops = 30.0;
double CostOf(const RowWork& work) {
  return work.flops + kEntryFlops * work.entries;
}

// How much dearer than another order the present one has to be. What changes next is a guess, and
// an order that is hardly better now may be worse then: on a path of 600 cameras with four laps and
// loops the Updates took 4.0e11 flops without reordering, 2.7e11, 2.4e11 and 2.2e11 with factors of
// 1.05, 1.25 and 1.6 (497, 156 and 24 reorderings).
constexpr double kAging = 1.6;

}  // namespace

// The number of places if none of the rows has one.
int ResumedSolver::FirstPlace(const Rows& rows) const {
  int first = order_.num_places();
  // Rows have their places in any order, so each of them is looked at.
  ForEachRow(rows, packing_.num_rows(), [this, &first](int row) {
    const int place = order_.place(row);
    first = place >= 0 ? std::min(first, place) : first;
  });
  return first;
}

ResumedSolver::Plan ResumedSolver::PlanFor(const ReducedMatrix& A, const Rows& changed) {
  // Before the order follows S, so that a row that has left still tells where it was.
  num_exact_ = std::min({num_exact_, FirstPlace(changed), cholesky_.num_valid_rows()});
  // Rows that have gone leave the order behind num_exact_, new ones come at its end.
  order_.Follow(*A.rows(), num_exact_);
  KeepGroups(*A.rows());
  // What is computed from rows of L is worth no more than they are.
  num_current_y_ = std::min(num_current_y_, num_exact_);
  num_passed_on_ = std::min(num_passed_on_, num_exact_);
  // Where a row has gone or come back, x of the rows behind it is no longer where it was. Only x
  // has this packing; L, y and the copies of x are by places.
  if (packing_.Follow(*A.rows())) {
    ForgetSolution();
  }
  plan_ = Predict(A, FirstPlace(changed));
  if (OrderMayHaveAged(*A.rows())) {
    Reorder(A, changed);
  }
  return plan_;
}

// Up to the first row that is out of its place the order stands, and the factor with it.
void ResumedSolver::KeepGroups(const SymmetricBlockRows& S) {
  if (!S.has_groups()) {
    return;
  }
  tail_ = order_.rows();
  SortByGroup(S, &tail_);
  const auto first = std::mismatch(tail_.begin(), tail_.end(), order_.rows().begin()).first;
  if (first != tail_.end()) {
    num_exact_ = std::min(num_exact_, static_cast<int>(first - tail_.begin()));
    tail_.erase(tail_.begin(), first);
    order_.SetTail(tail_);
  }
}

ResumedSolver::Plan ResumedSolver::Predict(const ReducedMatrix& A, int first_changed) {
  const auto work_from = [&](int place) {
    return EnvelopeWork(*A.rows(), A.constant(), order_, place, &workspace_);
  };
  const RowWork work = work_from(num_exact_);
  // The same change once more begins where it begins, not where earlier misses have left L.
  return {work.flops, CostOf(work),
          CostOf(first_changed <= num_exact_ ? work : work_from(first_changed))};
}

bool ResumedSolver::OrderMayHaveAged(const SymmetricBlockRows& S) const {
  std::size_t blocks = 0;
  for (int place = num_exact_; place < order_.num_places(); ++place) {
    blocks += S.row(order_.row(place)).size();
  }
  // By the blocks of S alone the factorization would be cheap: where it is not, fill is to blame.
  return plan_.flops > kLookFlops * static_cast<double>(blocks);
}

void ResumedSolver::Reorder(const ReducedMatrix& A, const Rows& changed) {
  tail_.assign(order_.rows().begin() + num_exact_, order_.rows().end());
  // If most of the rows have changed, these tell nothing of where the next change will be.
  if (changed.rows != nullptr && 2 * changed.rows->size() <= tail_.size()) {
    last_ = *changed.rows;
  } else {
    last_.assign(1, *std::max_element(tail_.begin(), tail_.end()));  // the newest
  }
  // Tried in place and taken back if it is no better: both orders have the same rows.
  std::vector<int>& fresh_tail = workspace_;
  fresh_tail = ordering_.Reorder(*A.rows(), order_, num_exact_, last_);
  SortByGroup(*A.rows(), &fresh_tail);
  order_.SetTail(fresh_tail);
  const Plan fresh = Predict(A, FirstPlace(changed));
  if (kAging * (fresh.cost + fresh.again) < plan_.cost + plan_.again) {
    plan_ = fresh;
    ++reorderings_;
  } else {
    order_.SetTail(tail_);
  }
}

Status ResumedSolver::FactorizeAsPlanned(const ReducedMatrix& A) {
  work_ = Work();
  work_.forward_rows = work_.solved_rows = 0;
  work_.factor_flops = plan_.flops;
  work_.reorderings = reorderings_;
  reorderings_ = 0;
  for (int i = num_exact_; i < cholesky_.num_rows(); ++i) {
    reached_before_ = std::min(
        reached_before_, cholesky_.FirstColumn(i));  // a row held now may have been coupled to many
  }
  // By places, as the factor wants it; before num_exact_ it is as it was.
  damping_.resize(packing_.size());
  int offset = cholesky_.offsets()[num_exact_];
  for (int place = num_exact_; place < order_.num_places(); ++place) {
    const int row = order_.row(place);
    std::copy(A.diagonal() + packing_[row], A.diagonal() + packing_[row + 1],
              damping_.begin() + offset);
    offset += packing_[row + 1] - packing_[row];
  }
  const bool is_definite =
      cholesky_.Factorize(*A.rows(), order_, damping_.data(), num_exact_, A.constant());
  work_.factored_rows = cholesky_.num_valid_rows() - num_exact_;
  // After a failure the rows before the bad pivot are right, and the next call begins there.
  num_exact_ = cholesky_.num_valid_rows();
  factored_ = is_definite ? Status::Ok() : NotPositiveDefinite(order_.row(num_exact_), &work_);
  return factored_;
}

// The x that the caller holds is another solver's from now on.
void ResumedSolver::MissSolve(const Rows& changed_b) {
  num_current_y_ = std::min(num_current_y_, FirstPlace(changed_b));
  ForgetSolution();
}

// Returns the first row of y that may have changed.
int ResumedSolver::SubstituteForward(const double* b, const Rows& changed_b) {
  const int num_rows = order_.num_places();
  const std::vector<int>& offsets = cholesky_.offsets();
  // y follows from b in the order of places: everything behind a changed row changes.
  const int first = std::min(num_current_y_, FirstPlace(changed_b));
  GrowTo(offsets.back());
  for (int place = first; place < num_rows; ++place) {
    const double* b_row = b + packing_[order_.row(place)];
    std::copy(b_row, b_row + offsets[place + 1] - offsets[place], b_.begin() + offsets[place]);
  }
  cholesky_.ForwardSubstitute(b_.data(), first, y_.data());
  num_current_y_ = num_rows;
  num_current_squares_ = std::min(num_current_squares_, first);
  work_.forward_rows = num_rows - first;
  return first;
}

Status ResumedSolver::SolveForGain(const double* b, const Rows& changed_b, double* gain) {
  if (!factored_.ok()) {
    return factored_;
  }
  // y is up to date now, so a Solve that follows would not see that these rows have changed.
  reached_before_ = std::min(reached_before_, SubstituteForward(b, changed_b));
  // Sums over leading rows are kept: those of rows that stay are not summed again.
  const std::vector<int>& offsets = cholesky_.offsets();
  squares_.resize(static_cast<std::size_t>(order_.num_places()) + 1, 0.0);
  for (int place = num_current_squares_; place < order_.num_places(); ++place) {
    const auto y_row = y_.begin() + offsets[place];
    squares_[place + 1] = std::inner_product(y_row, y_row + (offsets[place + 1] - offsets[place]),
                                             y_row, squares_[place]);
  }
  num_current_squares_ = order_.num_places();
  *gain = 0.5 * squares_.back();
  return Status::Ok();
}

Status ResumedSolver::Solve(const double* b, const Rows& changed_b, const Truncation& truncation,
                            double* x) {
  if (!factored_.ok()) {
    return factored_;
  }
  const int num_rows = order_.num_places();
  const std::vector<int>& offsets = cholesky_.offsets();
  const int first = SubstituteForward(b, changed_b);
  // The wildfire: row by row backwards, as far up as a change reaches.
  int filled = offsets.back();  // rest_ is set up from here on
  int reached = std::min(
      first, reached_before_);  // the first row that must be found anew, as far as is known
  int place = num_rows;
  while (place > reached) {
    --place;
    // rest_ is y less what later rows contribute: filled from y only as far up as rows reach.
    CopyRest(offsets[cholesky_.FirstColumn(place)], &filled);
    cholesky_.BackSubstituteRow(place, rest_.data(), x_.data());
    const int begin = offsets[place], size = offsets[place + 1] - begin;
    // A row of L that is another passes on whatever its x is; the rows above used the old one.
    if (place >= num_passed_on_ || HasChanged(truncation, packing_[order_.row(place)],
                                              x_.data() + begin, passed_on_.data() + begin, size)) {
      std::copy_n(x_.begin() + begin, size, passed_on_.begin() + begin);
      // The rows up to its first column get another rest, and are found anew.
      reached = std::min(reached, cholesky_.FirstColumn(place));
    }
  }
  num_passed_on_ = num_rows;
  reached_before_ = num_rows;
  work_.solved_rows = num_rows - place;
  HandOut(place, x);
  return Status::Ok();
}

// The row's alignment gap is written to as well: it may reach into the row before.
void ResumedSolver::CopyRest(int first_scalar, int* filled) {
  const int begin = std::min(*filled, first_scalar / kQuad * kQuad);
  std::copy(y_.begin() + begin, y_.begin() + *filled, rest_.begin() + begin);
  *filled = begin;
}

// The rows of x from this place on, to where the caller has them.
void ResumedSolver::HandOut(int first_place, double* x) {
  solved_.clear();
  for (int place = first_place; place < order_.num_places(); ++place) {
    const int row = order_.row(place);
    solved_.push_back(row);
    std::copy_n(x_.begin() + cholesky_.offsets()[place], packing_[row + 1] - packing_[row],
                x + packing_[row]);
  }
  std::sort(solved_.begin(), solved_.end());
  // ReducedSolver::Rows wants ids that ascend.
  work_.solved = {solved_.empty() ? order_.num_places() : solved_.front(), &solved_};
}

void ResumedSolver::GrowTo(int size) {
  if (static_cast<int>(y_.size()) < size) {
    b_.resize(size);
    y_.resize(size);
    rest_.resize(size);
    x_.resize(size);
    passed_on_.resize(size);
  }
}

std::size_t ResumedSolver::Bytes() const {
  return cholesky_.Bytes() +
         sizeof(double) * (damping_.capacity() + b_.capacity() + y_.capacity() + rest_.capacity() +
                           x_.capacity() + passed_on_.capacity() + squares_.capacity());
}

}  // namespace inceres::internal
