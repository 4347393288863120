// A factor with another loss, and nothing else: what is cached of it takes the new weight, and the
// factor is not linearized again.

#include <cmath>
#include <memory>
#include <string>
#include <utility>
#include <vector>

#include <gtest/gtest.h>

#include "inceres/problem/losses.h"
#include "inceres/solver/incremental_solver.h"
#include "inceres/solver/solver.h"
#include "incremental/incremental_bundle.h"
#include "incremental/incremental_system.h"
#include "incremental/whole_graph.h"
#include "support/test_families.h"

namespace inceres {
namespace {

using internal::IncrementalSystem;
using internal::RelinearizeWork;

// x_b − x_a − d of scalars; counts what is evaluated with Jacobians.
struct Differences {
  explicit Differences(std::vector<double> distances)
      : count(std::make_shared<int>(0)),
        family(std::make_shared<test::FunctionFamily>(
            1, std::vector<FactorFamily::Slot>{{1, 1}, {1, 1}},
            [counter = count, d = std::move(distances)](int i, const double* const* x, double* f,
                                                        double** J) {
              f[0] = x[1][0] - x[0][0] - d[static_cast<std::size_t>(i)];
              *counter += J != nullptr ? 1 : 0;
              for (int s = 0; s < 2 && J != nullptr; ++s) {
                if (J[s] != nullptr) {
                  J[s][0] = s == 0 ? -1.0 : 1.0;
                }
              }
              return true;
            })) {}

  std::shared_ptr<int> count;
  std::shared_ptr<test::FunctionFamily> family;
};

// A line of 40 places a step of 1 apart, and five loops, of which the last is wrong by 5.
class Line {
 public:
  static constexpr int kPlaces = 40;
  static constexpr int kLoops = 5;

  Line() : differences_(Distances()) {
    IncrementalOptions options;
    options.function_tolerance = 1e-8;
    options.batch_share = 1.0;  // what the batch solver leaves has no linearization to go on from
    solver_ = std::make_unique<IncrementalSolver>(options);
    const auto family = solver_->AddFamily(differences_.family);
    GraphEdit edit(solver_->graph());
    for (int i = 0; i < kPlaces; ++i) {
      const double start = 1.1 * i;
      edit.AddVariable(&start, 1, Role::kFrame);
    }
    edit.SetConstant(0, true);
    for (int i = 0; i < kPlaces - 1 + kLoops; ++i) {
      const int loop = i - (kPlaces - 1);
      const int from = loop < 0 ? i : 5 * loop;
      const int to = loop < 0 ? i + 1 : from + 15;
      factors_.push_back(edit.AddFactor(family, i, {from, to}));
    }
    EXPECT_TRUE(solver_->Apply(edit).ok());
  }

  FactorId Loop(int k) const { return factors_[static_cast<std::size_t>(kPlaces - 1 + k)]; }
  IncrementalSolver& solver() { return *solver_; }

  UpdateSummary SetLoss(FactorId factor, std::shared_ptr<const Loss> loss) {
    GraphEdit edit(solver_->graph());
    edit.SetLoss(factor, std::move(loss));
    EXPECT_TRUE(solver_->Apply(edit).ok());
    return solver_->Update();
  }

  // Evaluations with Jacobians since the last call.
  int TakeCount() { return std::exchange(*differences_.count, 0); }

  double BatchMinimum() const {
    FactorGraph graph = solver_->graph();
    SolverOptions options;
    options.function_tolerance = 1e-14;
    return Solve(options, &graph).final_cost;
  }

 private:
  static std::vector<double> Distances() {
    std::vector<double> distances(kPlaces - 1, 1.0);
    for (int k = 0; k < kLoops; ++k) {
      distances.push_back(k + 1 == kLoops ? 20.0 : 15.0 + 0.1 * k);
    }
    return distances;
  }

  Differences differences_;
  std::unique_ptr<IncrementalSolver> solver_;
  std::vector<FactorId> factors_;
};

TEST(Reweighing, EvaluatesNoJacobian) {
  Line line;
  ASSERT_EQ(line.solver().Update().termination, Termination::kConvergence);
  EXPECT_GE(line.TakeCount(), Line::kPlaces - 1 + Line::kLoops);
  const std::shared_ptr<const Loss> losses[] = {std::make_shared<ScaledLoss>(nullptr, 0.3),
                                                std::make_shared<ScaledLoss>(nullptr, 0.0),
                                                std::make_shared<ScaledLoss>(nullptr, 0.7),
                                                std::make_shared<ScaledLoss>(nullptr, 0.0),
                                                std::make_shared<CauchyLoss>(0.5),
                                                std::make_shared<HuberLoss>(0.2),
                                                nullptr};
  double last = line.solver().cost();
  for (const std::shared_ptr<const Loss>& loss : losses) {
    const UpdateSummary summary = line.SetLoss(line.Loop(4), loss);
    ASSERT_EQ(summary.termination, Termination::kConvergence) << summary.message;
    EXPECT_EQ(summary.num_reweighed_factors, 1);
    EXPECT_GT(std::fabs(summary.final_cost - last), 1e-3);
    last = summary.final_cost;
    const double minimum = line.BatchMinimum();
    line.TakeCount();
    EXPECT_NEAR(summary.final_cost, minimum, 1e-7 * (1.0 + minimum));
  }
}

TEST(Reweighing, CountsNoEvaluationWhereWeightsAreAllThatChanges) {
  Line line;
  ASSERT_EQ(line.solver().Update().termination, Termination::kConvergence);
  line.TakeCount();
  for (const double weight : {0.5, 2.0, 0.25, 1e-6, 1.0, 0.0}) {
    const UpdateSummary summary =
        line.SetLoss(line.Loop(4), std::make_shared<ScaledLoss>(nullptr, weight));
    EXPECT_EQ(summary.num_relinearized_factors, 0) << weight;
    EXPECT_EQ(summary.num_reweighed_factors, 1) << weight;
    EXPECT_EQ(line.TakeCount(), 0) << weight;
  }
  // Back from none: the line has moved since, and only this factor does not know how far.
  const UpdateSummary back = line.SetLoss(line.Loop(4), nullptr);
  EXPECT_EQ(back.num_relinearized_factors, 1);
  EXPECT_EQ(line.TakeCount(), 1);
}

// What is turned off, or gone, couples nothing: S is as if it had never come. What is back does.
TEST(Reweighing, WhatIsTurnedOffHasNoBlockInS) {
  Line line;
  ASSERT_EQ(line.solver().Update().termination, Termination::kConvergence);
  const std::size_t all = line.solver().Structure().blocks.size();
  ASSERT_EQ(all, static_cast<std::size_t>(Line::kPlaces - 2 + Line::kLoops - 1));  // 0 is constant
  for (const double weight : {0.0, 0.5, 0.0, 1.0}) {
    for (const int loop : {0, 2}) {  // of place 0, and of 10 and 25
      const UpdateSummary summary =
          line.SetLoss(line.Loop(loop), std::make_shared<ScaledLoss>(nullptr, weight));
      ASSERT_EQ(summary.termination, Termination::kConvergence) << summary.message;
      const double minimum = line.BatchMinimum();
      EXPECT_NEAR(summary.final_cost, minimum, 1e-7 * (1.0 + minimum));
    }
    EXPECT_EQ(line.solver().Structure().blocks.size(), weight == 0.0 ? all - 1 : all) << weight;
  }
  GraphEdit edit(line.solver().graph());
  edit.RemoveFactor(line.Loop(3));
  ASSERT_TRUE(line.solver().Apply(edit).ok());
  const UpdateSummary summary = line.solver().Update();
  ASSERT_EQ(summary.termination, Termination::kConvergence) << summary.message;
  EXPECT_EQ(line.solver().Structure().blocks.size(), all - 1);
  EXPECT_NEAR(summary.final_cost, line.BatchMinimum(), 1e-7 * (1.0 + summary.final_cost));
}

// The minimum of a problem whose factors bend is the batch solver's, whatever weights came and
// went.
TEST(Reweighing, EndsAtTheBatchMinimum) {
  IncrementalOptions options;
  options.function_tolerance = 1e-9;
  options.max_num_iterations = 200;
  options.batch_share = 1.0;
  test::IncrementalBundle bundle(options, 8);
  bundle.Grow(10, 60, 4);
  ASSERT_EQ(bundle.solver.Update().termination, Termination::kConvergence);
  const std::vector<FactorId> views = bundle.Views();
  for (const double weight : {0.4, 0.0, 2.0, 0.0, 1.0}) {
    for (std::size_t k = 0; k < views.size(); k += 7) {
      bundle.SetLoss(views[k], std::make_shared<ScaledLoss>(nullptr, weight));
    }
    for (std::size_t k = 1; k < views.size(); k += 7) {
      bundle.SetLoss(views[k], std::make_shared<CauchyLoss>(0.1 + weight));
    }
    bundle.Apply();
    const UpdateSummary summary = bundle.solver.Update();
    ASSERT_EQ(summary.termination, Termination::kConvergence) << summary.message;
    EXPECT_GT(summary.num_reweighed_factors, 0);
    const double minimum = bundle.SolveInBatch(/*from_values_held=*/true).final_cost;
    EXPECT_LE(summary.final_cost - minimum, 1e-6 * minimum) << weight;
  }
}

// f = x² + y at (1, 2), with this loss from the start.
class Bend {
 public:
  explicit Bend(std::shared_ptr<const Loss> loss)
      : family_(
            graph_.AddFamily(test::ScalarFamily([](double x, double y) { return x * x + y; },
                                                [](double x, double) { return 2.0 * x; }, 1.0))),
        system_(graph_, 1) {
    const double start[] = {1.0, 2.0};
    const VariableId x = graph_.AddVariable(start, 1, Role::kFrame);
    const VariableId y = graph_.AddVariable(start + 1, 1, Role::kFrame);
    graph_.AddFactor(family_, 0, {x, y});
    graph_.SetLoss(family_.id, 0, std::move(loss));
    AddWholeGraph(&system_);
    EXPECT_TRUE(Relinearize().ok());
  }

  Status SetLoss(std::shared_ptr<const Loss> loss) {
    GraphEdit edit(graph_);
    edit.SetLoss({family_.id, 0, -1}, std::move(loss));
    EXPECT_TRUE(system_.Apply(edit).ok());
    return Relinearize();
  }
  Status Relinearize() {
    const Status status = system_.Relinearize(0.0, RebuildPolicy::kNever, &work_);
    return status;
  }
  void MoveX(double step) {
    system_.step().SetFrame(0, &step);
    double change = 0.0;
    double predicted = 0.0;
    EXPECT_TRUE(system_.step().Evaluate(&change, &predicted).ok());
    system_.Accept();
  }

  IncrementalSystem& system() { return system_; }
  int num_linearized() const { return work_.num_factors; }

 private:
  FactorGraph graph_;
  FamilyHandle<test::FunctionFamily> family_;
  IncrementalSystem system_;
  RelinearizeWork work_;
};

void ExpectSame(Bend* bend, Bend* fresh) {
  internal::IncrementalSchur& schur = bend->system().schur();
  internal::IncrementalSchur& other = fresh->system().schur();
  EXPECT_NEAR(bend->system().cost(), fresh->system().cost(), 1e-14 * fresh->system().cost());
  for (int i = 0; i < 2; ++i) {
    EXPECT_NEAR(schur.b(i)[0], other.b(i)[0], 1e-13);
    EXPECT_NEAR(schur.FrameDiagonal(i)[0], other.FrameDiagonal(i)[0], 1e-13);
  }
  const auto offset = schur.S().row(1).front().offset;
  EXPECT_NEAR(schur.S().values(offset)[0], other.S().values(offset)[0], 1e-13);
}

TEST(Reweighing, MakesTheSystemThatLinearizingMakes) {
  const std::shared_ptr<const Loss> losses[] = {
      std::make_shared<HuberLoss>(0.5), std::make_shared<ScaledLoss>(nullptr, 0.0),
      std::make_shared<CauchyLoss>(1.0), std::make_shared<ScaledLoss>(nullptr, 7.0), nullptr};
  Bend bend(std::make_shared<TukeyLoss>(10.0));
  for (const std::shared_ptr<const Loss>& loss : losses) {
    ASSERT_TRUE(bend.SetLoss(loss).ok());
    EXPECT_EQ(bend.num_linearized(), 0);
    Bend fresh(loss);
    ExpectSame(&bend, &fresh);
  }
}

TEST(Reweighing, LinearizesWhatCameWithoutWeight) {
  Bend bend(std::make_shared<ScaledLoss>(nullptr, 0.0));
  ASSERT_TRUE(bend.SetLoss(nullptr).ok());
  EXPECT_EQ(bend.num_linearized(), 1) << "there is no Jacobian to go back to";
  Bend fresh(nullptr);
  ExpectSame(&bend, &fresh);
}

// While a factor has no weight its old linearization errs by nothing; once it has, by all that it
// has moved since, and more so with more weight.
TEST(Reweighing, KnowsTheAgeOfWhatHadNoWeight) {
  Bend bend(nullptr);
  ASSERT_TRUE(bend.SetLoss(std::make_shared<ScaledLoss>(nullptr, 0.0)).ok());
  bend.MoveX(0.5);
  const internal::IncrementalFamily& family = bend.system().families()[0];
  EXPECT_EQ(family.weighed().SquaredError(0), 0.0);
  ASSERT_TRUE(bend.SetLoss(std::make_shared<ScaledLoss>(nullptr, 0.5)).ok());
  EXPECT_EQ(bend.num_linearized(), 0);
  const double half = family.weighed().SquaredError(0);
  EXPECT_NEAR(half, 0.5 * 1.25 * 1.25, 1e-12) << "x² + y went from 3 to 4.25";
  ASSERT_TRUE(bend.SetLoss(std::make_shared<ScaledLoss>(nullptr, 4.0)).ok());
  EXPECT_NEAR(family.weighed().SquaredError(0), 8.0 * half, 1e-12);
}

// And leaves the factor to the linearization, which names it.
TEST(Reweighing, TakesNoWeightThatIsNone) {
  Bend bend(nullptr);
  const Status status = bend.SetLoss(test::LossOfSlope(std::nan("")));
  EXPECT_EQ(status.code, StatusCode::kEvaluationFailed);
  EXPECT_NE(status.message.find("first derivative"), std::string::npos) << status.message;
}

}  // namespace
}  // namespace inceres
