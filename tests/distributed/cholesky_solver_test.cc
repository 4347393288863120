// The reduced system factored by MUMPS: solved where it is positive definite, and only there.
#include <cstddef>
#include <cstdlib>
#include <memory>
#include <new>
#include <string>
#include <vector>

#include <gtest/gtest.h>

#include "base/stopwatch.h"
#include "distributed/assembled_system.h"
#include "distributed/communicator.h"
#include "distributed/distributed_model.h"
#include "distributed/reduced_system.h"
#include "distributed/shared_frames.h"
#include "tests/distributed/parts.h"

namespace {

// What is as large as this is denied; 0: nothing.
std::size_t denied_bytes = 0;

}  // namespace

// All forms of one kind: a sanitizer tells memory that one kind has given and another takes back;
// and none inline, where the compiler would tell it.
#define INCERES_NOINLINE __attribute__((noinline))
INCERES_NOINLINE void* operator new(std::size_t size) {
  void* const memory =
      denied_bytes > 0 && size >= denied_bytes ? nullptr : std::malloc(size > 0 ? size : 1);
  if (memory == nullptr) {
    throw std::bad_alloc();
  }
  return memory;
}
INCERES_NOINLINE void* operator new(std::size_t size, const std::nothrow_t& /*tag*/) noexcept {
  return std::malloc(size > 0 ? size : 1);
}
INCERES_NOINLINE void operator delete(void* memory) noexcept {
  std::free(memory);
}
INCERES_NOINLINE void operator delete(void* memory, std::size_t /*size*/) noexcept {
  std::free(memory);
}
INCERES_NOINLINE void operator delete(void* memory, const std::nothrow_t& /*tag*/) noexcept {
  std::free(memory);
}

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

// What a rank fails at by itself is agreed on before the ranks exchange anything.
TEST(AssembledSystem, ARankWithoutMemoryForItsSharesEndsAll) {
  const LinearizedPart part;
  const internal::LandmarkIncidences incidences(part.evaluator);
  const internal::FramePlans plans(part.evaluator, incidences);
  const internal::Hessian hessian(part.evaluator, incidences, plans);
  const internal::Elimination elimination(part.evaluator, incidences, plans, hessian);
  internal::FrameExchange exchange(part.ranks, part.frames, part.frames.moving(),
                                   internal::FramePlace::kTangent);
  const internal::RankedParts parts{part.ranks, part.frames, part.evaluator, incidences,
                                    plans,      hessian,     elimination};
  const internal::ReducedSystem system(parts, &exchange);
  const int last = NumRanks() - 1;
  for (const auto form :
       {internal::AssembledSystem::Form::kUpper, internal::AssembledSystem::Form::kWhole}) {
    Status status;
    // Of some ten shares at once.
    denied_bytes = Rank() == last ? 512 : 0;
    try {
      const internal::AssembledSystem S(form, system);
    } catch (const internal::AgreedFailure& failure) {
      status = failure.status();
    }
    denied_bytes = 0;
    EXPECT_EQ(status.code, StatusCode::kUnavailable);
    EXPECT_EQ(status.message, "rank " + std::to_string(last) + ": out of memory");
    const internal::AssembledSystem again(form, system);
    EXPECT_GT(again.Bytes(), 0);
  }
}

TEST(CholeskySolver, KnowsWhatMumpsWantsMoreOf) {
  for (const int code : {-8, -9, -11, -14, -15, -17, -20}) {
    EXPECT_EQ(internal::MumpsFailureOf(code), internal::MumpsFailure::kSpaceTooSmall) << code;
  }
  for (const int code : {-5, -7, -13, -19}) {
    EXPECT_EQ(internal::MumpsFailureOf(code), internal::MumpsFailure::kOutOfMemory) << code;
  }
  for (const int code : {-6, -10, 0, 4}) {
    EXPECT_EQ(internal::MumpsFailureOf(code), internal::MumpsFailure::kOther) << code;
  }
}

}  // namespace
}  // namespace inceres::test
