#include "distributed/communicator.h"

#include <algorithm>
#include <climits>
#include <cstdio>
#include <cstdlib>
#include <limits>
#include <new>
#include <numeric>

#include "base/stopwatch.h"

namespace inceres::internal {

// What the ranks agree on. The trust-region loop runs on every rank and branches by costs, norms
// and statuses; ranks stay together only if these are the same to the bit on all. So there is no
// MPI_Allreduce of floating-point numbers, whose order of sums is MPI's own: each rank gathers the
// numbers of all and sums them itself, by ascending rank. That is size − 1 numbers sent for each
// one reduced, which pays as long as they are few.
//
// Failures travel the same way: a rank that cannot go on takes part in the next agreement and says
// so, and all leave together with the message of the lowest rank. Nothing may throw between two
// collective calls on one rank alone, or the others wait forever; where it can happen nevertheless,
// the caller ends the program (Abort).
//
// `gathered_` is kept between calls, since reductions come once an iteration of conjugate
// gradients.

namespace {

// What a rank says of its own part, beside a value.
constexpr double kFine = 0.0;
constexpr double kThrew = -1.0;  // any other number: the StatusCode of a failure

// Runs what may throw; *threw tells whether it did.
template <typename Work>
Status Guarded(const Work& work, bool* threw) {
  *threw = true;
  try {
    Status status = work();
    *threw = false;
    return status;
  } catch (const std::bad_alloc&) {
    return Status::Error(StatusCode::kUnavailable, "out of memory");
  } catch (const std::exception& exception) {
    return Status::Error(StatusCode::kEvaluationFailed,
                         std::string("an exception was thrown: ") + exception.what());
  } catch (...) {
    return Status::Error(StatusCode::kEvaluationFailed,
                         "something was thrown that is no std::exception");
  }
}

}  // namespace

// A duplicate: messages of the caller on its own communicator never meet those of a solve.
Communicator::Communicator(MPI_Comm comm) {
  MPI_Comm_dup(comm, &comm_);
  MPI_Comm_rank(comm_, &rank_);
  MPI_Comm_size(comm_, &size_);
}

// A solver may be destroyed after MPI_Finalize, in static storage say; then MPI may not be called.
Communicator::~Communicator() {
  int finalized = 0;
  MPI_Finalized(&finalized);
  if (finalized == 0) {
    MPI_Comm_free(&comm_);
  }
}

// The one reduction: counted as what this rank has for each of the others.
void Communicator::AllGather(const double* own, int count, double* all) const {
  const StageTimer timer(&reductions_.seconds);
  MPI_Allgather(own, count, MPI_DOUBLE, all, count, MPI_DOUBLE, comm_);
  reductions_.bytes += static_cast<std::int64_t>(sizeof(double)) * count * (size_ - 1);
}

// gathered_[r · count + k]: value k of rank r. Summed by ascending r, from the value of rank 0 on
// and not from zero, so that one rank gets its own bits back.
void Communicator::SumAll(int count, double* values) const {
  gathered_.resize(static_cast<std::size_t>(count) * static_cast<std::size_t>(size_));
  AllGather(values, count, gathered_.data());
  for (int k = 0; k < count; ++k) {
    double sum = gathered_[static_cast<std::size_t>(k)];
    for (int r = 1; r < size_; ++r) {
      sum += gathered_[static_cast<std::size_t>(r) * static_cast<std::size_t>(count) +
                       static_cast<std::size_t>(k)];
    }
    values[k] = sum;
  }
}

double Communicator::Sum(double own) const {
  SumAll(1, &own);
  return own;
}

// NaN must win on all ranks: a comparison with it is false, and the result would depend on where it
// stands.
double Communicator::Max(double own) const {
  gathered_.resize(static_cast<std::size_t>(size_));
  AllGather(&own, 1, gathered_.data());
  double largest = gathered_[0];
  for (const double value : gathered_) {
    // what is no number wins, wherever it is
    largest = value > largest || value != value ? value : largest;
  }
  return largest;
}

// As the maximum of zeros and ones: one number from each rank.
bool Communicator::All(bool own) const {
  return Max(own ? 0.0 : 1.0) == 0.0;
}

// The code costs one reduction; only after a failure are there two broadcasts from the lowest rank
// that failed: its length, and its message. `own` is sent even if it is Ok here.
Status Communicator::Agree(const Status& own) const {
  gathered_.resize(static_cast<std::size_t>(size_));
  const double code = own.ok() ? kFine : static_cast<double>(own.code);
  AllGather(&code, 1, gathered_.data());
  const auto failed =
      std::find_if(gathered_.begin(), gathered_.end(), [](double c) { return c != kFine; });
  if (failed == gathered_.end()) {
    return Status::Ok();
  }
  const auto of_rank = static_cast<int>(failed - gathered_.begin());
  const auto agreed = static_cast<StatusCode>(*failed);
  std::string message = own.message;
  // On other ranks than of_rank it is overwritten.
  int length = static_cast<int>(std::min<std::size_t>(message.size(), INT_MAX));
  MPI_Bcast(&length, 1, MPI_INT, of_rank, comm_);
  message.resize(static_cast<std::size_t>(length));
  MPI_Bcast(message.data(), length, MPI_CHAR, of_rank, comm_);
  return Status::Error(agreed, "rank " + std::to_string(of_rank) + ": " + message);
}

// For set-up and files, where an exception is a failure like any other.
Status Communicator::Try(const std::function<Status()>& work) const {
  bool threw = false;
  const Status own = Guarded(work, &threw);
  return Agree(own);
}

// A failure is for the loop to judge: it may try a shorter step. An exception ends the solve.
// One reduction carries the cost and the outcome of each rank. A failing factor at a trial point is
// ordinary, and costs two broadcasts more; an exception makes all ranks throw AgreedFailure here.
Status Communicator::Evaluate(const Evaluation& evaluation, double* cost) const {
  double own_cost = 0.0;
  bool threw = false;
  Status own = Guarded([&] { return evaluation(&own_cost); }, &threw);
  // The second number tells the others what became of the first one.
  const double said[2] = {own.ok() ? own_cost : 0.0, threw      ? kThrew
                                                     : own.ok() ? kFine
                                                                : static_cast<double>(own.code)};
  gathered_.resize(2 * static_cast<std::size_t>(size_));
  AllGather(said, 2, gathered_.data());
  bool anyone_threw = false;
  bool all_fine = true;
  double sum = 0.0;
  for (std::size_t r = 0; r < gathered_.size(); r += 2) {
    // As SumAll: from rank 0 on.
    sum = r == 0 ? gathered_[0] : sum + gathered_[r];
    anyone_threw = anyone_threw || gathered_[r + 1] == kThrew;
    all_fine = all_fine && gathered_[r + 1] == kFine;
  }
  if (all_fine) {
    *cost = sum;
    return Status::Ok();
  }
  if (anyone_threw) {
    if (threw && find_thrower_) {
      // Evaluates factors one by one, on this rank alone: nothing in it is collective.
      own.message += ", of " + find_thrower_();
    }
    // Failures without an exception do not count now: the lowest rank that threw is named.
    throw AgreedFailure(Agree(threw ? own : Status::Ok()));
  }
  return Agree(own);
}

// Observers are the user's, and may throw on one rank. ObserverAction is ordered by how far it
// goes: of two verdicts the larger number is that of all, and an exception goes farther than any.
ObserverAction Communicator::Ask(const std::function<ObserverAction()>& observers) const {
  ObserverAction own = ObserverAction::kContinue;
  const auto ask = [&] {
    own = observers();
    return Status::Ok();
  };
  bool threw = false;
  const Status status = Guarded(ask, &threw);
  constexpr double kFarthest = std::numeric_limits<double>::infinity();
  const double verdict = Max(threw ? kFarthest : static_cast<double>(own));
  if (verdict == kFarthest) {
    throw AgreedFailure(Agree(status));
  }
  return static_cast<ObserverAction>(static_cast<int>(verdict));
}

// What a rank has for itself is no message.
void Communicator::CountMessage(std::size_t to_rank, std::size_t bytes) const {
  messages_.bytes += static_cast<int>(to_rank) == rank_ ? 0 : static_cast<std::int64_t>(bytes);
}

void Communicator::SendParts(const double* sent, const Parts& to, double* received,
                             const Parts& from) const {
  const StageTimer timer(&messages_.seconds);
  for (std::size_t r = 0; r < to.counts.size(); ++r) {
    CountMessage(r, static_cast<std::size_t>(to.counts[r]) * sizeof(double));
  }
  // In parentheses as in exchange.h: PETSc's macro of this name counts the bytes as well.
  (MPI_Alltoallv)(sent, to.counts.data(), to.begins.data(), MPI_DOUBLE, received,
                  from.counts.data(), from.begins.data(), MPI_DOUBLE, comm_);
}

// The message comes first, since MPI may kill this process at once.
void Communicator::Abort(const char* what) const {
  std::fprintf(stderr, "inceres: rank %d cannot go on, and ends the program: %s\n", rank_, what);
  std::fflush(stderr);
  MPI_Abort(comm_, 1);
  std::abort();  // MPI_Abort does not return
}

// For set-up and checkpoints; not counted among the reductions. All ranks give as many numbers.
std::vector<std::int64_t> Communicator::Gather(const std::vector<std::int64_t>& own) const {
  std::vector<std::int64_t> all(own.size() * static_cast<std::size_t>(size_));
  const auto count = static_cast<int>(own.size());
  MPI_Allgather(own.data(), count, MPI_INT64_T, all.data(), count, MPI_INT64_T, comm_);
  return all;
}

// Parts of different lengths that all ranks know already, so that no counts are exchanged. MPI
// takes counts and places as int.
std::vector<double> Communicator::GatherParts(const std::vector<double>& own,
                                              const std::vector<std::int64_t>& counts) const {
  const StageTimer timer(&reductions_.seconds);
  const std::int64_t total = std::accumulate(counts.begin(), counts.end(), std::int64_t{0});
  if (total > INT_MAX) {  // the same on all ranks
    throw std::length_error("the ranks have more than 2³¹ numbers to sum at once");
  }
  const std::vector<int> sizes(counts.begin(), counts.end());
  // Exclusive prefix sums: the last size is not needed.
  std::vector<int> begins(counts.size(), 0);
  std::partial_sum(sizes.begin(), sizes.end() - 1, begins.begin() + 1);
  std::vector<double> all(static_cast<std::size_t>(total));
  MPI_Allgatherv(own.data(), static_cast<int>(own.size()), MPI_DOUBLE, all.data(), sizes.data(),
                 begins.data(), MPI_DOUBLE, comm_);
  reductions_.bytes += static_cast<std::int64_t>(own.size() * sizeof(double)) * (size_ - 1);
  return all;
}

// Two gatherings: lengths, which only each rank knows of itself, then bytes. The limit of MPI's int
// is met by all ranks at once, so it can be an agreed failure.
std::vector<char> Communicator::GatherBytes(const void* own, std::size_t size) const {
  const std::vector<std::int64_t> sizes = Gather({static_cast<std::int64_t>(size)});
  const std::int64_t total = std::accumulate(sizes.begin(), sizes.end(), std::int64_t{0});
  if (total > INT_MAX) {  // the same on all ranks
    throw AgreedFailure(Status::Error(
        StatusCode::kInvalidArgument,
        "the ranks together see their frames too often: " + std::to_string(total) + " bytes"));
  }
  std::vector<int> counts(sizes.begin(), sizes.end());
  std::vector<int> begins(counts.size(), 0);
  std::partial_sum(counts.begin(), counts.end() - 1, begins.begin() + 1);
  std::vector<char> all(static_cast<std::size_t>(total));
  MPI_Allgatherv(own, static_cast<int>(size), MPI_BYTE, all.data(), counts.data(), begins.data(),
                 MPI_BYTE, comm_);
  return all;
}

}  // namespace inceres::internal
