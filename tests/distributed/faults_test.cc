// What goes wrong on one rank is told on all, and nobody waits.
#include <cmath>
#include <limits>
#include <memory>
#include <stdexcept>
#include <string>
#include <vector>

#include <gtest/gtest.h>

#include "inceres/distributed/distributed_solver.h"
#include "inceres/solver/solver.h"
#include "tests/distributed/parts.h"
#include "tests/support/test_families.h"

namespace inceres::test {
namespace {

DistributedOptions Options() {
  DistributedOptions options;
  options.solver = ExactOptions();
  options.solver.max_num_iterations = 6;
  options.linear_solver = DistributedLinearSolver::kConjugateGradients;
  return options;
}

enum class Fault { kFails, kThrows, kNaN };

// A factor on camera 0 that goes wrong from the given evaluation on, on the last rank.
class FaultyPart {
 public:
  FaultyPart(Fault fault, int evaluation, int num_faults)
      : part_(Street()), before_(part_.graph().state()) {
    if (Rank() != NumRanks() - 1) {
      return;
    }
    const auto evaluate = [this, fault, evaluation, num_faults](int, const double* const* x,
                                                                double* f, double** J) {
      f[0] = 1e-3 * x[0][0];
      if (J != nullptr && J[0] != nullptr) {
        std::fill_n(J[0], 9, 0.0);
        J[0][0] = 1e-3;
      }
      const int now = num_evaluations_++;
      if (now < evaluation || now >= evaluation + num_faults) {
        return true;
      }
      if (fault == Fault::kThrows) {
        throw std::runtime_error("the map tile is missing");
      }
      if (fault == Fault::kNaN) {
        f[0] = std::numeric_limits<double>::quiet_NaN();
      }
      return fault != Fault::kFails;
    };
    const auto family = part_.graph().AddFamily(
        std::make_shared<FunctionFamily>(1, std::vector<FactorFamily::Slot>{{9, 9}}, evaluate));
    part_.graph().AddFactor(family, 0, {part_.cameras()[3]});
  }

  const GraphPart& part() const { return part_.part(); }
  bool IsUnchanged() { return part_.graph().state() == before_; }

 private:
  BalPart part_;
  std::vector<double> before_;
  int num_evaluations_ = 0;
};

std::string Culprit() {
  return "rank " + std::to_string(NumRanks() - 1) + ": ";
}

TEST(Faults, AFactorThatFailsAtTheStartEndsAllWithItsName) {
  for (const Fault fault : {Fault::kFails, Fault::kNaN}) {
    FaultyPart part(fault, 0, 1000);
    const Summary summary = DistributedSolver(MPI_COMM_WORLD, Options()).Solve(part.part()).solve;
    EXPECT_EQ(summary.termination, Termination::kFailure);
    EXPECT_EQ(summary.detail.find(Culprit() + "factor 0 of function"), 0U) << summary.detail;
    EXPECT_TRUE(part.IsUnchanged());
  }
}

TEST(Faults, WhatThrowsEndsAllWithItsName) {
  for (const int evaluation : {0, 1, 2, 3}) {
    FaultyPart part(Fault::kThrows, evaluation, 1000);
    const Summary summary = DistributedSolver(MPI_COMM_WORLD, Options()).Solve(part.part()).solve;
    EXPECT_EQ(summary.termination, Termination::kFailure);
    EXPECT_EQ(summary.message.find(Culprit()), 0U) << summary.message;
    EXPECT_NE(summary.message.find("the map tile is missing"), std::string::npos);
    EXPECT_NE(summary.message.find("factor 0 of function"), std::string::npos) << summary.message;
    EXPECT_TRUE(part.IsUnchanged());
  }
}

TEST(Faults, AStepWhoseEndOneRankCannotEvaluateIsRefusedByAll) {
  for (const Fault fault : {Fault::kFails, Fault::kNaN}) {
    FaultyPart part(fault, 1, 1);
    const Summary summary = DistributedSolver(MPI_COMM_WORLD, Options()).Solve(part.part()).solve;
    EXPECT_TRUE(summary.IsSolutionUsable()) << summary.message;
    EXPECT_EQ(summary.failed_step.find(Culprit() + "factor 0 of function"), 0U);
    ASSERT_GT(summary.iterations.size(), 2U);
    EXPECT_FALSE(summary.iterations[1].step_is_successful);
    EXPECT_TRUE(summary.iterations[2].step_is_successful);
    EXPECT_LT(summary.final_cost, summary.initial_cost);
  }
}

TEST(Faults, RanksMayHaveNothing) {
  const Summary all =
      DistributedSolver(MPI_COMM_WORLD, Options()).Solve(BalPart(Street()).part()).solve;
  if (NumRanks() == 1) {
    return;
  }
  for (const int idle : {0, NumRanks() - 1}) {
    BalPart part(Street(), nullptr, idle);
    const DistributedSummary some = DistributedSolver(MPI_COMM_WORLD, Options()).Solve(part.part());
    EXPECT_NEAR(some.solve.final_cost, all.final_cost, 1e-10 * all.final_cost);
    EXPECT_EQ(some.solve.iterations.size(), all.iterations.size());
    EXPECT_EQ(some.ranks[static_cast<std::size_t>(idle)].num_factors, 0);
    EXPECT_EQ(some.ranks[static_cast<std::size_t>(idle)].num_owned_frames, 0);
  }
}

TEST(Faults, NobodyMayHaveAnything) {
  FactorGraph graph;
  GraphPart part;
  part.graph = &graph;
  const Summary summary = DistributedSolver(MPI_COMM_WORLD, Options()).Solve(part).solve;
  EXPECT_EQ(summary.termination, Termination::kConvergence) << summary.message;
  EXPECT_EQ(summary.final_cost, 0.0);
}

TEST(Faults, AFrameThatNobodySeesStaysAndOneThatIsSeenElsewhereFollows) {
  BalPart part(Street());
  const double unseen[9] = {1.0, 2.0, 3.0, 4.0, 5.0, 6.0, 7.0, 8.0, 9.0};
  const VariableId nobodys = part.graph().AddVariable(unseen, 9, Role::kFrame);
  part.part().frames.push_back({1000, nobodys});
  VariableId follower = part.cameras()[5];
  if (follower < 0) {
    follower = part.graph().AddVariable(Street().CameraData(5), 9, Role::kFrame);
    part.part().frames.push_back({5, follower});
  }
  const Summary summary = DistributedSolver(MPI_COMM_WORLD, Options()).Solve(part.part()).solve;
  ASSERT_TRUE(summary.IsSolutionUsable()) << summary.message;
  EXPECT_TRUE(std::equal(unseen, unseen + 9, part.graph().Values(nobodys)));
  double range[2] = {-part.graph().Values(follower)[3], part.graph().Values(follower)[3]};
  MPI_Allreduce(MPI_IN_PLACE, range, 2, MPI_DOUBLE, MPI_MAX, MPI_COMM_WORLD);
  EXPECT_EQ(-range[0], range[1]);
  EXPECT_NE(range[1], Street().CameraData(5)[3]);
}

void ExpectRefused(const Summary& summary, const std::string& why) {
  EXPECT_EQ(summary.termination, Termination::kFailure);
  EXPECT_NE(summary.message.find(why), std::string::npos) << summary.message;
}

TEST(Faults, RanksThatDoNotAgreeAreTold) {
  if (NumRanks() == 1) {
    return;
  }
  const bool last = Rank() == NumRanks() - 1;
  DistributedOptions options = Options();
  options.solver.function_tolerance = last ? 1e-4 : 1e-6;
  ExpectRefused(
      DistributedSolver(MPI_COMM_WORLD, options).Solve(BalPart(Street()).part()).solve,
      "function_tolerance is not the same on rank 0 and rank " + std::to_string(NumRanks() - 1));
  BalProblem moved = Street();
  moved.cameras[4] += last ? 1e-9 : 0.0;
  ExpectRefused(DistributedSolver(MPI_COMM_WORLD, Options()).Solve(BalPart(moved).part()).solve,
                "frame 0 starts from other values on rank ");
  BalPart held(Street());
  held.graph().SetConstant(held.cameras()[1], last);
  ExpectRefused(DistributedSolver(MPI_COMM_WORLD, Options()).Solve(held.part()).solve,
                "frame 1 is constant on only one of rank ");
}

TEST(Faults, WhatIsNotSupportedIsRefused) {
  const bool last = Rank() == NumRanks() - 1;
  BalPart bounded(Street());
  const double lower[3] = {-1e9, -1e9, -1e9};
  if (last) {
    bounded.graph().SetBounds(bounded.part().landmarks.front().variable, lower, nullptr);
  }
  ExpectRefused(DistributedSolver(MPI_COMM_WORLD, Options()).Solve(bounded.part()).solve,
                Culprit() + "variables with bounds");
  BalPart unlisted(Street());
  if (last) {
    unlisted.part().frames.pop_back();
  }
  ExpectRefused(DistributedSolver(MPI_COMM_WORLD, Options()).Solve(unlisted.part()).solve,
                "is not listed in GraphPart::frames");
  BalPart twice(Street());
  if (last) {
    twice.part().frames.push_back({77, twice.part().frames.front().variable});
  }
  ExpectRefused(DistributedSolver(MPI_COMM_WORLD, Options()).Solve(twice.part()).solve,
                "is listed twice");
}

TEST(Faults, OneFrameUnderTwoVariablesIsRefusedWithTheRankThatListsItTwice) {
  BalPart part(Street());
  // On the last rank alone: all others list frame 0 once.
  if (Rank() == NumRanks() - 1) {
    const VariableId second = part.graph().AddVariable(Street().CameraData(0), 9, Role::kFrame);
    part.part().frames.push_back({0, second});
  }
  ExpectRefused(DistributedSolver(MPI_COMM_WORLD, Options()).Solve(part.part()).solve,
                "frame 0 is listed twice by rank " + std::to_string(NumRanks() - 1));
}

Summary SolveStreet(const DistributedOptions& options) {
  return DistributedSolver(MPI_COMM_WORLD, options).Solve(BalPart(Street()).part()).solve;
}

TEST(Faults, OptionsWithoutEffectAreRefused) {
  DistributedOptions options = Options();
  options.solver.strategy = TrustRegionStrategyKind::kSubspaceDogleg;
  ExpectRefused(SolveStreet(options), "kSubspaceDogleg");
  options = Options();
  options.solver.conjugate_gradients.preconditioner = PreconditionerKind::kSubset;
  options.solver.conjugate_gradients.subset =
      std::make_shared<const std::vector<FactorId>>(1, FactorId{0, 0});
  ExpectRefused(SolveStreet(options), "kSubset");
  options = Options();
  options.solver.conjugate_gradients.explicit_schur_complement = true;
  ExpectRefused(SolveStreet(options), "explicit_schur_complement");
  options.linear_solver = DistributedLinearSolver::kAutomatic;
  ExpectRefused(SolveStreet(options), "explicit_schur_complement");
  for (const auto forms : {DistributedLinearSolver::kCholesky, DistributedLinearSolver::kKsp}) {
    options.linear_solver = forms;
    EXPECT_TRUE(SolveStreet(options).IsSolutionUsable());
  }
  options = Options();
  options.solver.max_memory_bytes = 1000;
  ExpectRefused(SolveStreet(options), "max_memory_bytes");
}

// As one process refuses it with an iterative model.
TEST(Faults, DoglegTakesNoInexactSteps) {
  DistributedOptions options = Options();
  options.solver.strategy = TrustRegionStrategyKind::kDogleg;
  for (const auto inexact :
       {DistributedLinearSolver::kConjugateGradients, DistributedLinearSolver::kKsp}) {
    options.linear_solver = inexact;
    ExpectRefused(SolveStreet(options), "kDogleg");
  }
  for (const auto exact :
       {DistributedLinearSolver::kCholesky, DistributedLinearSolver::kAutomatic}) {
    options.linear_solver = exact;
    EXPECT_TRUE(options.Validate().ok());
  }
}

// A resumed solve would go on otherwise than the one that wrote it.
TEST(Faults, WhatACheckpointDoesNotRememberIsRefusedWhereOneIsWritten) {
  DistributedOptions options = Options();
  options.solver.reduce_curvature_of_losses = true;
  EXPECT_TRUE(options.Validate().ok());
  options.checkpoint.path = "state";
  ExpectRefused(SolveStreet(options), "reduce_curvature_of_losses");
}

TEST(Faults, OneRanksCallbackEndsAll) {
  DistributedOptions options = Options();
  if (Rank() == NumRanks() - 1) {
    options.solver.callback = [](const IterationSummary& iteration, const double*) {
      return iteration.iteration == 2 ? ObserverAction::kTerminateSuccessfully
                                      : ObserverAction::kContinue;
    };
  }
  const Summary ended =
      DistributedSolver(MPI_COMM_WORLD, options).Solve(BalPart(Street()).part()).solve;
  EXPECT_EQ(ended.termination, Termination::kUserSuccess);
  EXPECT_EQ(ended.iterations.size(), 3U);
  if (Rank() == NumRanks() - 1) {
    options.solver.callback = [](const IterationSummary&, const double*) -> ObserverAction {
      throw std::runtime_error("no more disk");
    };
  }
  BalPart part(Street());
  const std::vector<double> before = part.graph().state();
  ExpectRefused(DistributedSolver(MPI_COMM_WORLD, options).Solve(part.part()).solve,
                Culprit() + "an exception was thrown: no more disk");
  EXPECT_EQ(part.graph().state(), before);
}

// Throws before one of the evaluations.
class ThrowingObserver final : public SolveObserver {
 public:
  ThrowingObserver(int evaluation, bool is_exception)
      : evaluation_(evaluation), is_exception_(is_exception) {}
  void BeforeEvaluation(const double* /*state*/, bool /*jacobians*/, bool /*new_point*/) override {
    if (num_evaluations_++ != evaluation_) {
      return;
    }
    if (is_exception_) {
      throw std::runtime_error("no more disk");
    }
    throw 7;
  }

 private:
  const int evaluation_;
  const bool is_exception_;
  int num_evaluations_ = 0;
};

TEST(Faults, AnObserverThatThrowsEndsAll) {
  for (const int evaluation : {0, 1, 2}) {
    for (const bool is_exception : {true, false}) {
      ThrowingObserver observer(evaluation, is_exception);
      DistributedOptions options = Options();
      options.solver.observer = Rank() == NumRanks() - 1 ? &observer : nullptr;
      BalPart part(Street());
      const std::vector<double> before = part.graph().state();
      const Summary summary = DistributedSolver(MPI_COMM_WORLD, options).Solve(part.part()).solve;
      EXPECT_EQ(summary.termination, Termination::kFailure);
      EXPECT_EQ(summary.message,
                Culprit() + (is_exception ? "an exception was thrown: no more disk"
                                          : "something was thrown that is no std::exception"));
      EXPECT_EQ(part.graph().state(), before);
    }
  }
}

// The line, whose Plus throws at one of its calls.
class ThrowingManifold final : public Manifold {
 public:
  explicit ThrowingManifold(int call) : call_(call) {}
  int AmbientSize() const override { return 1; }
  int TangentSize() const override { return 1; }
  bool Plus(const double* x, const double* delta, double* x_plus_delta) const override {
    if (num_calls_++ == call_) {
      throw std::runtime_error("the chart is missing");
    }
    x_plus_delta[0] = x[0] + delta[0];
    return true;
  }
  bool PlusJacobian(const double* /*x*/, double* jacobian) const override {
    jacobian[0] = 1.0;
    return true;
  }

 private:
  const int call_;
  mutable int num_calls_ = 0;
};

// A landmark that is one number, which a camera sees.
class SeenNumberFamily final : public AmbientFamily<SeenNumberFamily> {
 public:
  using Measurement = int;  // ignored

  // At which call Recenter throws; −1: it does not.
  explicit SeenNumberFamily(int call) : AmbientFamily(1, {{9, 9}, {1, 1}}), call_(call) {}
  void Add(Measurement) { ++size_; }
  void Place(int index, Measurement) { size_ += index == size_ ? 1 : 0; }
  int size() const override { return size_; }
  const char* Name() const override { return "seen number"; }
  bool Recenters() const override { return true; }
  bool Recenter(int /*factor*/, const double* const* /*parameters*/) const override {
    if (num_calls_++ == call_) {
      throw std::runtime_error("the chart is missing");
    }
    return false;
  }
  bool EvaluateOne(int /*i*/, const double* const* x, double* f, double** J) const {
    f[0] = x[1][0] + 1e-3 * x[0][0];
    if (J != nullptr && J[0] != nullptr) {
      std::fill_n(J[0], 9, 0.0);
      J[0][0] = 1e-3;
    }
    if (J != nullptr && J[1] != nullptr) {
      J[1][0] = 1.0;
    }
    return true;
  }

 private:
  const int call_;
  int size_ = 0;
  mutable int num_calls_ = 0;
};

TEST(Faults, AManifoldOrAFamilyThatThrowsBetweenEvaluationsEndsAll) {
  for (const bool is_manifold : {true, false}) {
    for (const int call : {0, 1}) {
      BalPart part(Street());
      if (Rank() == NumRanks() - 1) {
        const double start = 1.0;
        const VariableId number =
            part.graph().AddVariable(&start, 1, Role::kLandmark,
                                     std::make_shared<ThrowingManifold>(is_manifold ? call : -1));
        const auto family =
            part.graph().AddFamily(std::make_shared<SeenNumberFamily>(is_manifold ? -1 : call));
        part.graph().AddFactor(family, 0, {part.cameras()[3], number});
      }
      const std::vector<double> before = part.graph().state();
      ExpectRefused(DistributedSolver(MPI_COMM_WORLD, Options()).Solve(part.part()).solve,
                    Culprit() + "an exception was thrown: the chart is missing");
      EXPECT_EQ(part.graph().state(), before);
    }
  }
}

TEST(Faults, ASolverGoesOnAfterAFailure) {
  DistributedSolver solver(MPI_COMM_WORLD, Options());
  FaultyPart faulty(Fault::kThrows, 2, 1000);
  EXPECT_FALSE(solver.Solve(faulty.part()).solve.IsSolutionUsable());
  EXPECT_TRUE(solver.Solve(BalPart(Street()).part()).solve.IsSolutionUsable());
}

}  // namespace
}  // namespace inceres::test
