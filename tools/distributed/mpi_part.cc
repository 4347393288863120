#include "tools/distributed/mpi_part.h"

#include <algorithm>

#include "distributed/exchange.h"
#include "inceres/factors/bal_reprojection.h"

namespace inceres::tools {
namespace {

using internal::GatherToAll;

constexpr std::size_t kCameraSize = BalProblem::kCameraSize;

struct PlacedCamera {
  std::int64_t id = 0;
  double values[kCameraSize] = {};
};

}  // namespace

MpiPart::MpiPart(const Tracks& tracks, const std::shared_ptr<const Loss>& loss) {
  part.graph = &graph;
  std::vector<VariableId> cameras(tracks.cameras.size() / kCameraSize, -1);
  const auto family = graph.AddFamily(std::make_shared<BalReprojectionFamily>());
  family->Reserve(tracks.seen.size());
  // By ascending number, as one process has them: neighbors lie together.
  for (const Seen& seen : tracks.seen) {
    cameras[static_cast<std::size_t>(seen.camera)] = 0;
  }
  for (std::size_t i = 0; i < cameras.size(); ++i) {
    if (cameras[i] == 0) {
      cameras[i] =
          graph.AddVariable(tracks.cameras.data() + i * kCameraSize, kCameraSize, Role::kFrame);
      part.frames.push_back({static_cast<std::int64_t>(i), cameras[i]});
    }
  }
  std::vector<VariableId> variables;
  variables.reserve(2 * tracks.seen.size());
  for (std::size_t i = 0; i < tracks.points.size(); ++i) {
    if (tracks.begin[i] == tracks.begin[i + 1]) {
      continue;  // nothing observes it: it stays
    }
    const VariableId point =
        graph.AddVariable(tracks.points[i].values, BalProblem::kPointSize, Role::kLandmark);
    part.landmarks.push_back({tracks.points[i].id, point});
    for (std::size_t k = tracks.begin[i]; k < tracks.begin[i + 1]; ++k) {
      const Seen& seen = tracks.seen[k];
      family->Add({seen.x, seen.y});
      variables.push_back(cameras[static_cast<std::size_t>(seen.camera)]);
      variables.push_back(point);
    }
  }
  std::vector<std::shared_ptr<const Loss>> losses;
  if (loss != nullptr) {
    losses.assign(tracks.seen.size(), loss);
  }
  graph.ConnectMany(family, std::move(variables), std::move(losses));
}

void MpiPart::TakeSolution(MPI_Comm comm, Tracks* tracks) const {
  std::vector<PlacedCamera> own;
  for (const GlobalVariable& frame : part.frames) {
    PlacedCamera camera;
    camera.id = frame.id;
    std::copy_n(graph.Values(frame.variable), kCameraSize, camera.values);
    own.push_back(camera);
  }
  // the same wherever a camera is seen
  for (const PlacedCamera& camera : GatherToAll(comm, own)) {
    std::copy_n(camera.values, kCameraSize,
                tracks->cameras.begin() + camera.id * static_cast<std::ptrdiff_t>(kCameraSize));
  }
  auto next = tracks->points.begin();
  for (const GlobalVariable& landmark : part.landmarks) {  // by ascending id, as the points
    while (next->id != landmark.id) {
      ++next;
    }
    std::copy_n(graph.Values(landmark.variable), 3, next->values);
  }
}

}  // namespace inceres::tools
