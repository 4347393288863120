#pragma once

#include <mpi.h>

#include <climits>
#include <cstdint>
#include <cstring>
#include <exception>
#include <functional>
#include <string>
#include <type_traits>
#include <utility>
#include <vector>

#include "base/stopwatch.h"
#include "distributed/exchange.h"
#include "trust_region/agreement.h"

namespace inceres::internal {

/// Every rank has been told that one of them cannot go on: all of them throw it at the same place.
class AgreedFailure : public std::exception {
 public:
  explicit AgreedFailure(Status status) : status_(std::move(status)) {}
  const Status& status() const { return status_; }
  const char* what() const noexcept override { return status_.message.c_str(); }

 private:
  Status status_;
};

/// A sum of counts over all ranks, where the summary has an int: INT_MAX for more.
inline int SaturatedCount(double sum) {
  return sum < INT_MAX ? static_cast<int>(sum) : INT_MAX;
}

/// The ranks of an MPI communicator, of which it has a duplicate, as the trust-region loop sees
/// them. Sums are taken in the order of the ranks, by each for itself from what all have sent:
/// whatever way MPI takes, all have the same bits, and runs with the same ranks repeat.
///
/// Calls are collective. MPI's own errors end the program, as MPI does unless told otherwise: there
/// is nobody left to agree with.
class Communicator final : public Agreement {
 public:
  explicit Communicator(MPI_Comm comm);
  ~Communicator() override;
  Communicator(const Communicator&) = delete;
  Communicator& operator=(const Communicator&) = delete;

  MPI_Comm comm() const { return comm_; }
  int rank() const { return rank_; }
  int size() const { return size_; }

  Status Evaluate(const Evaluation& evaluation, double* cost) const override;
  bool All(bool own) const override;
  double Sum(double own) const override;
  double Max(double own) const override;
  ObserverAction Ask(const std::function<ObserverAction()>& observers) const override;

  /// Sums of several values, each in the order of the ranks.
  void SumAll(int count, double* values) const;
  /// Ok if all are; else that of the lowest rank that is not, with its number.
  Status Agree(const Status& own) const;
  /// The same of work here, whose exceptions are failures too.
  Status Try(const std::function<Status()>& work) const;
  /// What each rank has, in the order of the ranks; as much of each.
  std::vector<std::int64_t> Gather(const std::vector<std::int64_t>& own) const;
  /// The same of plain data, of which a rank may have more than another.
  template <typename T>
  std::vector<T> GatherAll(const std::vector<T>& own) const {
    static_assert(std::is_trivially_copyable_v<T>);
    const std::vector<char> bytes = GatherBytes(own.data(), own.size() * sizeof(T));
    std::vector<T> all(bytes.size() / sizeof(T));
    if (!all.empty()) {
      std::memcpy(all.data(), bytes.data(), bytes.size());
    }
    return all;
  }
  /// The same of numbers, counts[r] of rank r; 2³¹ and more in all end the program.
  std::vector<double> GatherParts(const std::vector<double>& own,
                                  const std::vector<std::int64_t>& counts) const;
  /// Sends to_rank[r] to each rank r; what all have sent here, in the order of the ranks. Throws
  /// std::length_error if that is 2 GiB or more.
  template <typename T>
  std::vector<T> SendToEach(std::vector<std::vector<T>> to_rank) const {
    const StageTimer timer(&messages_.seconds);
    for (std::size_t r = 0; r < to_rank.size(); ++r) {
      CountMessage(r, to_rank[r].size() * sizeof(T));
    }
    return Exchange(comm_, std::move(to_rank));
  }
  /// Where in an array the values for each rank are, or of each.
  struct Parts {
    std::vector<int> counts;
    std::vector<int> begins;
  };
  /// The same of numbers, into an array, by parts that are known on both sides.
  void SendParts(const double* sent, const Parts& to, double* received, const Parts& from) const;

  /// Ends the program on all ranks, with a message: for what nobody can be told in time.
  [[noreturn]] void Abort(const char* what) const;

  /// The first of these variables of the layout that others count.
  void LetOthersCount(std::vector<char> elsewhere) { counted_elsewhere_ = std::move(elsewhere); }
  /// Says which factor it is that throws, after one has.
  void FindThrowersBy(std::function<std::string()> find) { find_thrower_ = std::move(find); }

  /// What was sent to other ranks so far, and seconds spent in it, waiting included.
  struct Traffic {
    std::int64_t bytes = 0;
    double seconds = 0.0;
  };
  /// Of reductions, which are gatherings: what all get.
  const Traffic& reductions() const { return reductions_; }
  /// Of SendToEach and SendParts: what one rank gets.
  const Traffic& messages() const { return messages_; }

 private:
  void AllGather(const double* own, int count, double* all) const;
  std::vector<char> GatherBytes(const void* own, std::size_t size) const;
  void CountMessage(std::size_t to_rank, std::size_t bytes) const;

  MPI_Comm comm_ = MPI_COMM_NULL;
  int rank_ = 0;
  int size_ = 1;
  std::function<std::string()> find_thrower_;
  mutable std::vector<double> gathered_;
  mutable Traffic reductions_;
  mutable Traffic messages_;
};

}  // namespace inceres::internal
