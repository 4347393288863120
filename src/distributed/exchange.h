#pragma once

#include <mpi.h>

#include <climits>
#include <cstdint>
#include <stdexcept>
#include <type_traits>
#include <vector>

namespace inceres::internal {

// Names of MPI in parentheses: where PETSc's headers came first they are macros, which count what
// is sent, to the own rank too, and these templates would differ from one source to the other.

/// Sends to_rank[r] to each rank r; what all ranks have sent here, in the order of the ranks.
/// Throws std::length_error if that is 2 GiB or more. Collective.
template <typename T>
std::vector<T> Exchange(MPI_Comm comm, std::vector<std::vector<T>> to_rank) {
  static_assert(std::is_trivially_copyable_v<T>);
  const std::size_t num_ranks = to_rank.size();
  std::vector<int> sizes(num_ranks), begins(num_ranks), received(num_ranks), places(num_ranks);
  std::int64_t total = 0;
  for (std::size_t r = 0; r < num_ranks; ++r) {
    begins[r] = static_cast<int>(total);
    total += static_cast<std::int64_t>(to_rank[r].size() * sizeof(T));
    if (total > INT_MAX) {
      throw std::length_error("a rank would send 2 GiB or more at once: use more ranks");
    }
    sizes[r] = static_cast<int>(to_rank[r].size() * sizeof(T));
  }
  std::vector<T> sent;
  sent.reserve(static_cast<std::size_t>(total) / sizeof(T));
  for (std::vector<T>& part : to_rank) {
    sent.insert(sent.end(), part.begin(), part.end());
    std::vector<T>().swap(part);
  }
  (MPI_Alltoall)(sizes.data(), 1, MPI_INT, received.data(), 1, MPI_INT, comm);
  std::int64_t incoming = 0;
  for (std::size_t r = 0; r < num_ranks; ++r) {
    places[r] = static_cast<int>(incoming);
    incoming += received[r];
    if (incoming > INT_MAX) {
      throw std::length_error("a rank would receive 2 GiB or more at once: use more ranks");
    }
  }
  std::vector<T> result(static_cast<std::size_t>(incoming) / sizeof(T));
  (MPI_Alltoallv)(sent.data(), sizes.data(), begins.data(), MPI_BYTE, result.data(),
                  received.data(), places.data(), MPI_BYTE, comm);
  return result;
}

/// What each rank has, on all, in the order of the ranks.
template <typename T>
std::vector<T> GatherToAll(MPI_Comm comm, const std::vector<T>& own) {
  int size = 1;
  MPI_Comm_size(comm, &size);
  return Exchange(comm, std::vector<std::vector<T>>(static_cast<std::size_t>(size), own));
}

/// The same, on rank 0 alone; elsewhere nothing.
template <typename T>
std::vector<T> GatherToRoot(MPI_Comm comm, const std::vector<T>& own) {
  int size = 1;
  MPI_Comm_size(comm, &size);
  std::vector<std::vector<T>> to_rank(static_cast<std::size_t>(size));
  to_rank[0] = own;
  return Exchange(comm, to_rank);
}

}  // namespace inceres::internal
