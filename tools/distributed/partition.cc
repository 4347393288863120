#include "tools/distributed/partition.h"

#include <algorithm>
#include <numeric>
#include <utility>

#include "distributed/exchange.h"
#include "tools/distributed/agree.h"

namespace inceres::tools {
namespace {

using internal::Exchange;

double WorkOf(const Tracks& tracks, std::size_t point, double per_square) {
  const auto n = static_cast<double>(tracks.begin[point + 1] - tracks.begin[point]);
  return 1.0 + n + per_square * n * n;
}

// The middle one of the positions of the cameras that see a point.
int KeyOf(const Tracks& tracks, std::size_t point, const std::vector<int>& position,
          std::vector<int>* workspace) {
  std::vector<int>& seen_from = *workspace;
  seen_from.clear();
  for (std::size_t k = tracks.begin[point]; k < tracks.begin[point + 1]; ++k) {
    seen_from.push_back(position[static_cast<std::size_t>(tracks.seen[k].camera)]);
  }
  if (seen_from.empty()) {
    return 0;
  }
  const auto middle = seen_from.begin() + static_cast<std::ptrdiff_t>(seen_from.size() / 2);
  std::nth_element(seen_from.begin(), middle, seen_from.end());
  return *middle;
}

// Cuts the points, in the order of key, then rank, then place, where the sum of their work passes
// a share of the whole.
std::vector<int> CutByWork(MPI_Comm comm, const Tracks& tracks, const std::vector<int>& position,
                           double per_square) {
  int size = 1;
  int rank = 0;
  MPI_Comm_size(comm, &size);
  MPI_Comm_rank(comm, &rank);
  std::vector<double> own(static_cast<std::size_t>(tracks.num_cameras()), 0.0);
  std::vector<int> keys(tracks.points.size());
  std::vector<int> workspace;
  for (std::size_t i = 0; i < keys.size(); ++i) {
    keys[i] = KeyOf(tracks, i, position, &workspace);
    own[static_cast<std::size_t>(keys[i])] += WorkOf(tracks, i, per_square);
  }
  std::vector<double> before(own.size(), 0.0);  // of each key, on lower ranks
  std::vector<double> all(own.size(), 0.0);
  const int count = tracks.num_cameras();
  MPI_Exscan(own.data(), before.data(), count, MPI_DOUBLE, MPI_SUM, comm);
  if (rank == 0) {
    std::fill(before.begin(), before.end(), 0.0);
  }
  MPI_Allreduce(own.data(), all.data(), count, MPI_DOUBLE, MPI_SUM, comm);
  const double total = std::accumulate(all.begin(), all.end(), 0.0);
  double sum = 0.0;
  for (std::size_t key = 0; key < all.size(); ++key) {
    before[key] += sum;
    sum += all[key];
  }
  std::vector<int> target(keys.size());
  for (std::size_t i = 0; i < keys.size(); ++i) {
    double& at = before[static_cast<std::size_t>(keys[i])];
    const double middle = at + 0.5 * WorkOf(tracks, i, per_square);
    at += WorkOf(tracks, i, per_square);
    target[i] = std::clamp(static_cast<int>(middle / total * size), 0, size - 1);
  }
  return target;
}

std::int64_t CountCopies(MPI_Comm comm, const Tracks& tracks, const std::vector<int>& target) {
  int size = 1;
  MPI_Comm_size(comm, &size);
  const auto num_cameras = static_cast<std::size_t>(tracks.num_cameras());
  std::vector<bool> sees(num_cameras * static_cast<std::size_t>(size), false);  // by rank
  for (std::size_t i = 0; i < target.size(); ++i) {
    const std::size_t first = num_cameras * static_cast<std::size_t>(target[i]);
    for (std::size_t k = tracks.begin[i]; k < tracks.begin[i + 1]; ++k) {
      sees[first + static_cast<std::size_t>(tracks.seen[k].camera)] = true;
    }
  }
  std::vector<std::vector<int>> to_rank(static_cast<std::size_t>(size));
  for (std::size_t k = 0; k < sees.size(); ++k) {
    if (sees[k]) {
      to_rank[k / num_cameras].push_back(static_cast<int>(k % num_cameras));
    }
  }
  std::vector<char> is_here(num_cameras, 0);
  for (const int camera : Exchange(comm, std::move(to_rank))) {
    is_here[static_cast<std::size_t>(camera)] = 1;
  }
  std::int64_t copies = std::count(is_here.begin(), is_here.end(), 1);
  MPI_Allreduce(MPI_IN_PLACE, &copies, 1, MPI_INT64_T, MPI_SUM, comm);
  return copies;
}

double ImbalanceOf(MPI_Comm comm, const Tracks& tracks, const std::vector<int>& target,
                   double per_square) {
  int size = 1;
  MPI_Comm_size(comm, &size);
  std::vector<double> work(static_cast<std::size_t>(size), 0.0);
  for (std::size_t i = 0; i < target.size(); ++i) {
    work[static_cast<std::size_t>(target[i])] += WorkOf(tracks, i, per_square);
  }
  MPI_Allreduce(MPI_IN_PLACE, work.data(), size, MPI_DOUBLE, MPI_SUM, comm);
  const double total = std::accumulate(work.begin(), work.end(), 0.0);
  return total > 0.0 ? *std::max_element(work.begin(), work.end()) * size / total : 1.0;
}

}  // namespace

Status PartitionTracks(MPI_Comm comm, const Tracks& tracks, const std::string& by,
                       double per_square, Partition* partition) {
  int size = 1;
  MPI_Comm_size(comm, &size);
  *partition = Partition();
  std::vector<int> position(static_cast<std::size_t>(tracks.num_cameras()));
  std::iota(position.begin(), position.end(), 0);
  if (by != "ptscotch" || size == 1) {
    partition->by = "order";
    partition->target = CutByWork(comm, tracks, position, per_square);
    partition->num_frame_copies = CountCopies(comm, tracks, partition->target);
  }
  if (by != "order" && size > 1) {
    const Status status = PartitionCameras(comm, tracks, &position);
    if (!status.ok()) {
      return status;
    }
    std::vector<int> target = CutByWork(comm, tracks, position, per_square);
    const std::int64_t copies = CountCopies(comm, tracks, target);
    if (partition->target.empty() && partition->by.empty()) {
      partition->num_frame_copies = copies + 1;
    }
    if (copies < partition->num_frame_copies) {
      partition->by = "ptscotch";
      partition->target = std::move(target);
      partition->num_frame_copies = copies;
    }
  }
  partition->imbalance = ImbalanceOf(comm, tracks, partition->target, per_square);
  return Status::Ok();
}

}  // namespace inceres::tools
