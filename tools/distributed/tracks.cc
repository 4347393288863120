#include "tools/distributed/tracks.h"

#include <algorithm>
#include <numeric>
#include <utility>

#include "base/text.h"
#include "distributed/exchange.h"
#include "io/bal_binary.h"
#include "tools/distributed/agree.h"
#include "tools/distributed/bal_text_share.h"
#include "tools/distributed/mpi_process.h"

namespace inceres::tools {
namespace {

using internal::Exchange;
using internal::GatherToAll;
using internal::GatherToRoot;

using internal::BalCounts;
using internal::BalShare;

std::size_t SizeOf(MPI_Comm comm) {
  int size = 1;
  MPI_Comm_size(comm, &size);
  return static_cast<std::size_t>(size);
}

// Each rank's stretch of the points.
std::size_t HomeOf(std::int64_t point, std::int64_t num_points, std::size_t num_ranks) {
  return static_cast<std::size_t>(point * static_cast<std::int64_t>(num_ranks) / num_points);
}

// Mostly it is sorted: ranks have sent stretches of the problem, in their order.
template <typename T, typename Less>
void Sort(std::vector<T>* values, const Less& less) {
  if (!std::is_sorted(values->begin(), values->end(), less)) {
    std::sort(values->begin(), values->end(), less);
  }
}

// Sorts what has come, and finds where each point's track begins.
void Arrange(std::vector<PlacedPoint> points, std::vector<Seen> seen, Tracks* tracks) {
  Sort(&points, [](const PlacedPoint& a, const PlacedPoint& b) { return a.id < b.id; });
  Sort(&seen, [](const Seen& a, const Seen& b) {
    return a.point != b.point ? a.point < b.point : a.index < b.index;
  });
  tracks->begin.assign(1, 0);
  std::size_t next = 0;
  for (const PlacedPoint& point : points) {
    while (next < seen.size() && seen[next].point == point.id) {
      ++next;
    }
    tracks->begin.push_back(next);
  }
  tracks->points = std::move(points);
  tracks->seen = std::move(seen);
}

// A stretch of the problem's three lists, on each rank: to where it belongs.
void SpreadShare(MPI_Comm comm, const BalCounts& counts, BalShare share, Tracks* tracks) {
  const std::size_t num_ranks = SizeOf(comm);
  tracks->num_points = counts.num_points;
  tracks->num_observations = counts.num_observations;
  tracks->cameras = GatherToAll(comm, share.cameras);
  std::vector<std::vector<PlacedPoint>> points(num_ranks);
  for (std::size_t k = 0; k + 2 < share.points.size(); k += 3) {
    const std::int64_t id = share.first_point + static_cast<std::int64_t>(k / 3);
    points[HomeOf(id, counts.num_points, num_ranks)].push_back(
        {id, {share.points[k], share.points[k + 1], share.points[k + 2]}});
  }
  std::vector<std::vector<Seen>> seen(num_ranks);
  std::int64_t index = share.first_observation;
  for (const BalObservation& o : share.observations) {
    seen[HomeOf(o.point, counts.num_points, num_ranks)].push_back(
        {index++, o.camera, o.point, o.x, o.y});
  }
  share = BalShare();
  std::vector<PlacedPoint> own_points = Exchange(comm, std::move(points));
  Arrange(std::move(own_points), Exchange(comm, std::move(seen)), tracks);
}

// Rank 0 reads it all.
Status ReadWhole(MPI_Comm comm, const std::string& path, const ReadOptions& options,
                 Tracks* tracks) {
  BalProblem bal;
  const bool reads = RankOf(comm) == 0;
  Status status = Agree(comm, reads ? ReadBal(path, &bal, nullptr, options) : Status::Ok());
  if (!status.ok()) {
    return status;
  }
  TakeTracks(comm, std::move(bal), tracks);
  return status;
}

// Whether it is true on all ranks. Collective.
bool AllOf(MPI_Comm comm, bool own) {
  int all = own ? 1 : 0;
  MPI_Allreduce(MPI_IN_PLACE, &all, 1, MPI_INT, MPI_MIN, comm);
  return all != 0;
}

// The same on all ranks, as of ReadBinaryShares.
bool ReadShares(MPI_Comm comm, const std::string& path, BalCounts* counts, BalShare* share) {
  std::int64_t file_bytes = 0;
  if (!AllOf(comm, ReadBalCounts(path, counts, &file_bytes))) {
    return false;
  }
  const std::int64_t size = static_cast<std::int64_t>(SizeOf(comm));
  const std::int64_t rank = RankOf(comm);
  const auto begin_of = [&](std::int64_t r) {
    return file_bytes / size * r + file_bytes % size * r / size;
  };
  std::int64_t num_tokens = 0;
  if (!AllOf(comm, CountTokens(path, begin_of(rank), begin_of(rank + 1), &num_tokens))) {
    return false;
  }
  const std::vector<std::int64_t> all = GatherToAll(comm, std::vector<std::int64_t>{num_tokens});
  const std::int64_t first = std::accumulate(all.begin(), all.begin() + rank, std::int64_t{0});
  const std::int64_t total = std::accumulate(all.begin(), all.end(), std::int64_t{0});
  return total == NumTokens(*counts) &&
         AllOf(comm, ReadBalShare(path, *counts, begin_of(rank), first, num_tokens, share));
}

bool ReadBinaryShares(MPI_Comm comm, const std::string& path, BalCounts* counts, BalShare* share) {
  internal::BalBinaryFile file;
  bool read = file.Open(path).ok();
  if (read) {
    *counts = file.counts();
    read = file.ReadShare(RankOf(comm), static_cast<int>(SizeOf(comm)), share).ok();
  }
  return AllOf(comm, read);
}

}  // namespace

Status ReadTracks(MPI_Comm comm, const std::string& path, const ReadOptions& options,
                  Tracks* tracks) {
  const bool in_shares = !internal::EndsWith(path, ".gz") && !internal::EndsWith(path, ".bz2");
  if (in_shares) {
    BalCounts counts;
    BalShare share;
    if (internal::IsBalBinary(path) ? ReadBinaryShares(comm, path, &counts, &share)
                                    : ReadShares(comm, path, &counts, &share)) {
      SpreadShare(comm, counts, std::move(share), tracks);
      return Status::Ok();
    }
    // Whoever reads it all says in which line it is wrong.
  }
  return ReadWhole(comm, path, options, tracks);
}

void TakeTracks(MPI_Comm comm, BalProblem bal, Tracks* tracks) {
  std::int64_t counts[3] = {bal.num_cameras, bal.num_points,
                            static_cast<std::int64_t>(bal.observations.size())};
  MPI_Bcast(counts, 3, MPI_INT64_T, 0, comm);
  BalShare share;
  if (RankOf(comm) == 0) {
    share.observations = std::move(bal.observations);
    share.cameras = std::move(bal.cameras);
    share.points = std::move(bal.points);
  }
  SpreadShare(comm, {counts[0], counts[1], counts[2]}, std::move(share), tracks);
}

void MoveTracks(MPI_Comm comm, const std::vector<int>& target, Tracks* tracks) {
  std::vector<std::vector<PlacedPoint>> points(SizeOf(comm));
  std::vector<std::vector<Seen>> seen(points.size());
  for (std::size_t i = 0; i < tracks->points.size(); ++i) {
    const auto rank = static_cast<std::size_t>(target[i]);
    points[rank].push_back(tracks->points[i]);
    const auto begin = tracks->seen.begin();
    seen[rank].insert(seen[rank].end(), begin + static_cast<std::ptrdiff_t>(tracks->begin[i]),
                      begin + static_cast<std::ptrdiff_t>(tracks->begin[i + 1]));
  }
  std::vector<Seen>().swap(tracks->seen);
  std::vector<PlacedPoint> moved_points = Exchange(comm, std::move(points));
  Arrange(std::move(moved_points), Exchange(comm, std::move(seen)), tracks);
}

BalProblem GatherProblem(MPI_Comm comm, const Tracks& tracks) {
  std::vector<Seen> seen = GatherToRoot(comm, tracks.seen);
  const std::vector<PlacedPoint> points = GatherToRoot(comm, tracks.points);
  BalProblem bal;
  if (RankOf(comm) != 0) {
    return bal;
  }
  std::sort(seen.begin(), seen.end(),
            [](const Seen& a, const Seen& b) { return a.index < b.index; });
  bal.num_cameras = tracks.num_cameras();
  bal.num_points = static_cast<int>(tracks.num_points);
  bal.cameras = tracks.cameras;
  bal.points.resize(static_cast<std::size_t>(3 * tracks.num_points));
  for (const PlacedPoint& point : points) {
    std::copy_n(point.values, 3, bal.points.begin() + 3 * point.id);
  }
  for (const Seen& o : seen) {
    bal.observations.push_back({o.camera, o.point, o.x, o.y});
  }
  return bal;
}

}  // namespace inceres::tools
