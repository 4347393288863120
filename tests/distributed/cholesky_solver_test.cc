// The reduced system factored by MUMPS: solved where it is positive definite, and only there.
#include <vector>

#include <gtest/gtest.h>

#include "base/stopwatch.h"
#include "distributed/communicator.h"
#include "distributed/distributed_model.h"
#include "distributed/shared_frames.h"
#include "tests/distributed/parts.h"

namespace inceres::test {
namespace {

BalProblem Street() {
  BalProblem bal;
  const Status status = ReadBal(INCERES_SOURCE_DIR "/bal_data/street-16-1200-pre.txt", &bal);
  EXPECT_TRUE(status.ok()) << status.message;
  return bal;
}

DistributedOptions Factored() {
  DistributedOptions options;
  options.linear_solver = DistributedLinearSolver::kCholesky;
  return options;
}

// The linear model of a part at its start.
struct LinearizedPart {
  LinearizedPart()
      : part(Street()),
        ranks(MPI_COMM_WORLD),
        layout(*part.part().graph, /*eliminate_landmarks=*/true),
        executor(1),
        evaluator(*part.part().graph, layout, executor) {
    double cost = 0.0;
    EXPECT_TRUE(frames.Agree(ranks, part.part(), layout).ok());
    EXPECT_TRUE(evaluator.EvaluateJacobians(/*known_point=*/false, &cost).ok());
    Status status;
    model =
        std::make_unique<internal::DistributedModel>(Factored(), ranks, frames, evaluator, &status);
    EXPECT_TRUE(status.ok()) << status.message;
    model->TimeInto(&seconds, &clock);
    model->Refresh();
  }

  // With so much more damping on the first entry of one frame than Levenberg's.
  Status Solve(std::int64_t frame, double more) {
    std::vector<double> damping(model->Diagonal());
    for (double& entry : damping) {
      entry *= 1e-4;
    }
    for (std::size_t i = 0; i < frames.moving().size(); ++i) {
      if (frames.moving()[i].id == frame) {
        damping[static_cast<std::size_t>(layout.packed_offset[i])] += more;
      }
    }
    step.assign(damping.size(), 0.0);
    return model->Solve(damping.data(), step.data());
  }

  BalPart part;
  internal::Communicator ranks;
  internal::Layout layout;
  internal::Executor executor;
  internal::Evaluator evaluator;
  internal::SharedFrames frames;
  internal::StageClock clock;
  StageSeconds seconds;
  std::unique_ptr<internal::DistributedModel> model;
  std::vector<double> step;
};

// MUMPS factors indefinite matrices too: one eigenvalue below zero is one negative pivot.
TEST(CholeskySolver, AnIndefiniteSystemIsSingularAndTheNextOneIsSolvedAsBefore) {
  LinearizedPart part;
  ASSERT_TRUE(part.Solve(5, 0.0).ok());
  const std::vector<double> step = part.step;
  for (const std::int64_t frame : {0, 7, 15}) {
    const Status indefinite = part.Solve(frame, -1e12);
    EXPECT_EQ(indefinite.code, StatusCode::kSingular) << indefinite.message;
    EXPECT_NE(indefinite.message.find("not positive definite"), std::string::npos);
    ASSERT_TRUE(part.Solve(5, 0.0).ok());
    EXPECT_EQ(part.step, step);
  }
}

}  // namespace
}  // namespace inceres::test
