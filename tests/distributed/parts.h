#pragma once

#include <mpi.h>

#include <memory>
#include <utility>
#include <vector>

#include "inceres/distributed/distributed_solver.h"
#include "inceres/io/bal.h"
#include "inceres/problem/factor_graph.h"

namespace inceres::test {

inline int Rank() {
  int rank = 0;
  MPI_Comm_rank(MPI_COMM_WORLD, &rank);
  return rank;
}

inline int NumRanks() {
  int size = 1;
  MPI_Comm_size(MPI_COMM_WORLD, &size);
  return size;
}

/// The street that comes with the sources; read once.
const BalProblem& Street();

/// What a rank has of a BAL problem that all of them have read: every so-many-th stretch of points,
/// with the cameras they are seen by. Rank `idle`, if any, has nothing.
class BalPart {
 public:
  explicit BalPart(const BalProblem& bal, std::shared_ptr<const Loss> loss = nullptr, int idle = -1)
      : BalPart(bal, std::move(loss), idle, Rank(), NumRanks()) {}
  /// Of a rank among so many.
  BalPart(const BalProblem& bal, std::shared_ptr<const Loss> loss, int idle, int rank,
          int num_ranks);

  /// Holds a camera constant, and gives the others a prior each: factors between frames, on the
  /// last rank alone, whether it sees the frames or not.
  void Anchor(const BalProblem& bal, int constant_camera);

  FactorGraph& graph() { return graph_; }
  const GraphPart& part() const { return part_; }
  GraphPart& part() { return part_; }
  FamilyId family() const { return family_; }
  /// Of the cameras and points here, by the numbers of the problem; −1: not here.
  const std::vector<VariableId>& cameras() const { return cameras_; }
  const std::vector<VariableId>& points() const { return points_; }

 private:
  VariableId Camera(const BalProblem& bal, int camera);

  FactorGraph graph_;
  GraphPart part_;
  FamilyId family_ = -1;
  std::vector<VariableId> cameras_;
  std::vector<VariableId> points_;
};

/// Anchor of a whole problem; `cameras` by the numbers of the problem.
void AnchorCameras(const BalProblem& bal, int constant_camera,
                   const std::vector<VariableId>& cameras, FactorGraph* graph);

/// Steps as exact as a direct solver's.
SolverOptions ExactOptions();

}  // namespace inceres::test
