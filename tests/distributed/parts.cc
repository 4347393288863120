#include "tests/distributed/parts.h"

#include <utility>

#include <gtest/gtest.h>

#include "inceres/factors/bal_reprojection.h"
#include "inceres/factors/diagonal_prior.h"

namespace inceres::test {

const BalProblem& Street() {
  static const BalProblem& kStreet = *[] {
    auto* bal = new BalProblem;
    const Status status = ReadBal(INCERES_SOURCE_DIR "/bal_data/street-16-1200-pre.txt", bal);
    EXPECT_TRUE(status.ok()) << status.message;
    return bal;
  }();
  return kStreet;
}

BalPart::BalPart(const BalProblem& bal, std::shared_ptr<const Loss> loss, int idle, int rank,
                 int num_ranks)
    : cameras_(static_cast<std::size_t>(bal.num_cameras), -1),
      points_(static_cast<std::size_t>(bal.num_points), -1) {
  constexpr int kStretch = 40;  // points
  std::vector<int> workers;
  for (int r = 0; r < num_ranks; ++r) {
    if (r != idle) {
      workers.push_back(r);
    }
  }
  const auto handle = graph_.AddFamily(std::make_shared<BalReprojectionFamily>());
  family_ = handle.id;
  part_.graph = &graph_;
  for (const BalObservation& seen : bal.observations) {
    const auto stretch = static_cast<std::size_t>(seen.point / kStretch);
    if (workers[stretch % workers.size()] != rank) {
      continue;
    }
    const VariableId camera = Camera(bal, seen.camera);
    VariableId& point = points_[static_cast<std::size_t>(seen.point)];
    if (point < 0) {
      point =
          graph_.AddVariable(bal.PointData(seen.point), BalProblem::kPointSize, Role::kLandmark);
      part_.landmarks.push_back({seen.point, point});
    }
    graph_.AddFactor(handle, {seen.x, seen.y}, {camera, point}, loss);
  }
}

VariableId BalPart::Camera(const BalProblem& bal, int camera) {
  VariableId& id = cameras_[static_cast<std::size_t>(camera)];
  if (id < 0) {
    id = graph_.AddVariable(bal.CameraData(camera), BalProblem::kCameraSize, Role::kFrame);
    part_.frames.push_back({camera, id});
  }
  return id;
}

void BalPart::Anchor(const BalProblem& bal, int constant_camera) {
  const VariableId constant = cameras_[static_cast<std::size_t>(constant_camera)];
  if (constant >= 0) {
    graph_.SetConstant(constant, true);
  }
  if (Rank() == NumRanks() - 1) {
    for (int i = 0; i < bal.num_cameras; ++i) {
      Camera(bal, i);
    }
    AnchorCameras(bal, constant_camera, cameras_, &graph_);
  }
}

void AnchorCameras(const BalProblem& bal, int constant_camera,
                   const std::vector<VariableId>& cameras, FactorGraph* graph) {
  const auto priors =
      graph->AddFamily(std::make_shared<DiagonalPriorFamily>(BalProblem::kCameraSize));
  for (int i = 0; i < bal.num_cameras; ++i) {
    const VariableId id = cameras[static_cast<std::size_t>(i)];
    if (i == constant_camera) {
      graph->SetConstant(id, true);
      continue;
    }
    const double* const x = bal.CameraData(i);
    graph->AddFactor(priors,
                     {std::vector<double>(x, x + BalProblem::kCameraSize),
                      {10.0, 10.0, 10.0, 1.0, 1.0, 1.0, 0.1, 10.0, 10.0}},
                     {id});
  }
}

SolverOptions ExactOptions() {
  SolverOptions options;
  options.conjugate_gradients.preconditioner = PreconditionerKind::kSchurJacobi;
  options.conjugate_gradients.eta = 1e-12;
  options.conjugate_gradients.max_iterations = 5000;
  return options;
}

}  // namespace inceres::test
