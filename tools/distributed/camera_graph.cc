// The camera graph, partitioned by PT-Scotch.
#include <petscmat.h>

#include <algorithm>
#include <cstddef>
#include <numeric>
#include <utility>

#include "distributed/exchange.h"
#include "tools/distributed/agree.h"
#include "tools/distributed/partition.h"

namespace inceres::tools {
namespace {

using internal::Exchange;
using internal::GatherToAll;

struct Edge {
  int from;
  int to;
  int weight;
};

// The stretch of cameras whose edges a rank has.
struct Rows {
  Rows(MPI_Comm comm, int num_cameras) : count(num_cameras) {
    MPI_Comm_size(comm, &size);
    MPI_Comm_rank(comm, &rank);
  }
  int Begin(int r) const { return static_cast<int>(std::int64_t{count} * r / size); }
  int OwnerOf(int camera) const {
    int r = static_cast<int>(std::int64_t{camera} * size / count);
    while (Begin(r + 1) <= camera) {
      ++r;
    }
    while (Begin(r) > camera) {
      --r;
    }
    return r;
  }
  int count;
  int size = 1;
  int rank = 0;
};

// visit(a, b): cameras that follow each other in a track here.
template <typename Visit>
void ForEachStep(const Tracks& tracks, const Visit& visit) {
  for (std::size_t i = 0; i + 1 < tracks.begin.size(); ++i) {
    for (std::size_t k = tracks.begin[i] + 1; k < tracks.begin[i + 1]; ++k) {
      const int a = tracks.seen[k - 1].camera;
      const int b = tracks.seen[k].camera;
      if (a != b) {
        visit(a, b);
      }
    }
  }
}

// Those of the tracks here, both directions, by ascending camera.
std::vector<Edge> CollectOwnEdges(const Tracks& tracks) {
  const int num_cameras = tracks.num_cameras();
  std::vector<std::size_t> begin(static_cast<std::size_t>(num_cameras) + 1, 0);
  const auto count = [&](int camera) { ++begin[static_cast<std::size_t>(camera) + 1]; };
  ForEachStep(tracks, [&](int a, int b) {
    count(a);
    count(b);
  });
  std::partial_sum(begin.begin(), begin.end(), begin.begin());
  std::vector<int> others(begin.back());
  std::vector<std::size_t> next(begin.begin(), begin.end() - 1);
  ForEachStep(tracks, [&](int a, int b) {
    others[next[static_cast<std::size_t>(a)]++] = b;
    others[next[static_cast<std::size_t>(b)]++] = a;
  });
  std::vector<Edge> edges;
  std::vector<int> weight(static_cast<std::size_t>(num_cameras), 0);
  for (int camera = 0; camera < num_cameras; ++camera) {
    const auto first = others.begin() + static_cast<std::ptrdiff_t>(begin[camera]);
    const auto last = others.begin() + static_cast<std::ptrdiff_t>(begin[camera + 1]);
    std::for_each(first, last, [&](int other) { ++weight[static_cast<std::size_t>(other)]; });
    std::for_each(first, last, [&](int other) {
      if (const int count_of_pair = std::exchange(weight[static_cast<std::size_t>(other)], 0)) {
        edges.push_back({camera, other, count_of_pair});
      }
    });
  }
  return edges;
}

std::vector<Edge> CollectEdges(MPI_Comm comm, const Tracks& tracks, const Rows& rows) {
  std::vector<std::vector<Edge>> to_rank(static_cast<std::size_t>(rows.size));
  for (const Edge& edge : CollectOwnEdges(tracks)) {
    to_rank[static_cast<std::size_t>(rows.OwnerOf(edge.from))].push_back(edge);
  }
  std::vector<Edge> edges = Exchange(comm, std::move(to_rank));
  std::sort(edges.begin(), edges.end(), [](const Edge& a, const Edge& b) {
    return std::make_pair(a.from, a.to) < std::make_pair(b.from, b.to);
  });
  std::vector<Edge> merged;
  for (const Edge& edge : edges) {
    if (!merged.empty() && merged.back().from == edge.from && merged.back().to == edge.to) {
      merged.back().weight += edge.weight;
    } else {
      merged.push_back(edge);
    }
  }
  return merged;
}

// PETSc frees these arrays.
PetscErrorCode MakeAdjacency(MPI_Comm comm, const std::vector<Edge>& edges, const Rows& rows,
                             Mat* graph) {
  const int first = rows.Begin(rows.rank);
  const int num_rows = rows.Begin(rows.rank + 1) - first;
  PetscInt* begins = nullptr;
  PetscInt* columns = nullptr;
  PetscInt* weights = nullptr;
  PetscCall(PetscMalloc1(static_cast<std::size_t>(num_rows) + 1, &begins));
  PetscCall(PetscMalloc1(edges.size() + 1, &columns));
  PetscCall(PetscMalloc1(edges.size() + 1, &weights));
  std::fill(begins, begins + num_rows + 1, 0);
  for (std::size_t k = 0; k < edges.size(); ++k) {
    ++begins[edges[k].from - first + 1];
    columns[k] = edges[k].to;
    weights[k] = edges[k].weight;
  }
  for (int i = 0; i < num_rows; ++i) {
    begins[i + 1] += begins[i];
  }
  PetscCall(MatCreateMPIAdj(comm, num_rows, rows.count, begins, columns, weights, graph));
  return 0;
}

PetscErrorCode PartitionGraph(MPI_Comm comm, Mat graph, std::vector<int>* own) {
  MatPartitioning partitioning = nullptr;
  IS parts = nullptr;
  PetscInt count = 0;
  const PetscInt* indices = nullptr;
  PetscCall(MatPartitioningCreate(comm, &partitioning));
  PetscCall(MatPartitioningSetAdjacency(partitioning, graph));
  PetscCall(MatPartitioningSetUseEdgeWeights(partitioning, PETSC_TRUE));
  PetscCall(MatPartitioningSetType(partitioning, MATPARTITIONINGPTSCOTCH));
  PetscCall(MatPartitioningApply(partitioning, &parts));
  PetscCall(ISGetLocalSize(parts, &count));
  PetscCall(ISGetIndices(parts, &indices));
  own->assign(indices, indices + count);
  PetscCall(ISRestoreIndices(parts, &indices));
  PetscCall(ISDestroy(&parts));
  PetscCall(MatPartitioningDestroy(&partitioning));
  return 0;
}

}  // namespace

Status PartitionCameras(MPI_Comm comm, const Tracks& tracks, std::vector<int>* part) {
  const Rows rows(comm, tracks.num_cameras());
  const std::vector<Edge> edges = CollectEdges(comm, tracks, rows);
  Mat graph = nullptr;
  std::vector<int> own;
  PetscErrorCode code = MakeAdjacency(comm, edges, rows, &graph);
  code = code == 0 ? PartitionGraph(comm, graph, &own) : code;
  static_cast<void>(MatDestroy(&graph));
  const Status status =
      Agree(comm, code == 0 ? Status::Ok()
                            : Status::Error(StatusCode::kUnavailable,
                                            "PT-Scotch could not partition the camera graph: "
                                            "PETSc error " +
                                                std::to_string(code)));
  if (status.ok()) {
    *part = GatherToAll(comm, own);
  }
  return status;
}

}  // namespace inceres::tools
