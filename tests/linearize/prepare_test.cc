// A family that asks to be told what will be evaluated: it is, once an evaluation, of exactly the
// factors that follow, and nothing else comes out for it.
#include <algorithm>
#include <memory>
#include <vector>

#include <gtest/gtest.h>

#include "inceres/factors/bal_reprojection.h"
#include "inceres/solver/incremental_solver.h"
#include "inceres/solver/solver.h"
#include "support/random_values.h"

namespace inceres {
namespace {

constexpr int kCameras = 6, kPoints = 120;

// BAL reprojections that see to it that announcements are kept.
class Announced final : public FactorFamily {
 public:
  using Measurement = BalReprojectionFamily::Measurement;

  explicit Announced(bool prepares) : FactorFamily(2, {{9, 9}, {3, 3}}), prepares_(prepares) {}

  void Add(const Measurement& measurement) { inner_.Add(measurement); }
  void Place(int index, const Measurement& measurement) { inner_.Place(index, measurement); }
  int size() const override { return inner_.size(); }
  const char* Name() const override { return "announced"; }
  bool Prepares() const override { return prepares_; }
  int TaskSize() const override { return 32; }

  EvaluationFailure Prepare(const FactorBatch& batch, const std::int32_t* factors,
                            int count) const override {
    announced_.assign(factors, factors + count);
    wants_jacobians_ = batch.jacobians != nullptr;
    parameters_ = batch.parameters;
    EXPECT_TRUE(std::is_sorted(announced_.begin(), announced_.end()));
    EXPECT_EQ(batch.begin, announced_.front());
    EXPECT_EQ(batch.end, announced_.back() + 1);
    ++num_calls;
    num_announced += count;
    if (fails) {
      return {announced_[0], "told to fail"};
    }
    return {};
  }
  EvaluationFailure Evaluate(const FactorBatch& batch) const override {
    if (batch.prepared) {
      EXPECT_TRUE(prepares_);
      EXPECT_EQ(batch.jacobians != nullptr, wants_jacobians_);
      EXPECT_EQ(batch.parameters, parameters_);
      for (int i = batch.begin; i < batch.end; ++i) {
        EXPECT_TRUE(std::binary_search(announced_.begin(), announced_.end(), i)) << i;
      }
    } else if (prepares_) {
      num_unannounced += batch.end - batch.begin;
    }
    return inner_.Evaluate(batch);
  }

  bool fails = false;
  mutable int num_calls = 0;
  mutable int num_announced = 0;
  mutable int num_unannounced = 0;

 private:
  bool prepares_;
  BalReprojectionFamily inner_;
  mutable std::vector<std::int32_t> announced_;
  mutable bool wants_jacobians_ = false;
  mutable const double* const* parameters_ = nullptr;
};

// Adds a scene to a graph or an edit: cameras along x, points before them, all seen by all.
template <typename Graph>
std::vector<VariableId> AddScene(const FamilyHandle<Announced>& family, Graph* graph) {
  test::Random random(5);
  std::vector<VariableId> cameras, all;
  for (int i = 0; i < kCameras; ++i) {
    const double camera[9] = {0.01 * random.Unit(),
                              0.01 * random.Unit(),
                              0.01 * random.Unit(),
                              -0.5 * i,
                              0.1 * random.Unit(),
                              0.1 * random.Unit(),
                              500.0,
                              0.0,
                              0.0};
    cameras.push_back(graph->AddVariable(camera, 9, Role::kFrame));
    all.push_back(cameras.back());
  }
  for (int j = 0; j < kPoints; ++j) {
    const double X[3] = {3.0 * random.Unit(), 2.0 * random.Unit(), random.Between(-9.0, -5.0)};
    const double start[3] = {X[0] + 0.2 * random.Unit(), X[1] + 0.2 * random.Unit(), X[2]};
    all.push_back(graph->AddVariable(start, 3, Role::kLandmark));
    for (int i = 0; i < kCameras; ++i) {
      const double x = -500.0 * (X[0] - 0.5 * i) / X[2] + random.Unit();
      graph->AddFactor(family, {x, -500.0 * X[1] / X[2] + random.Unit()}, {cameras[i], all.back()});
    }
  }
  return all;
}

TEST(Prepare, ABatchSolveAnnouncesEachEvaluationOnceAndGivesTheSameBits) {
  std::vector<double> states[2];
  for (const bool prepares : {false, true}) {
    for (const int num_threads : {1, 2}) {
      FactorGraph graph;
      const auto family = graph.AddFamily(std::make_shared<Announced>(prepares));
      AddScene(family, &graph);
      SolverOptions options;
      options.num_threads = num_threads;
      const Summary summary = Solve(options, &graph);
      ASSERT_TRUE(summary.IsSolutionUsable()) << summary.message;
      if (prepares) {
        EXPECT_EQ(family->num_calls,
                  summary.work.num_residual_evaluations + summary.work.num_jacobian_evaluations);
        EXPECT_EQ(family->num_announced, family->num_calls * kCameras * kPoints);
        EXPECT_EQ(family->num_unannounced, 0);
      }
      std::vector<double>& state = states[prepares ? 1 : 0];
      EXPECT_TRUE(state.empty() || state == graph.state());
      state = graph.state();
    }
  }
  EXPECT_EQ(states[0], states[1]);
}

TEST(Prepare, AFailureIsThatOfTheFactorItNames) {
  FactorGraph graph;
  const auto family = graph.AddFamily(std::make_shared<Announced>(true));
  AddScene(family, &graph);
  family->fails = true;
  const Summary summary = Solve(SolverOptions(), &graph);
  EXPECT_EQ(summary.termination, Termination::kFailure);
  EXPECT_NE((summary.message + summary.detail).find("told to fail"), std::string::npos)
      << summary.message << summary.detail;
}

TEST(Prepare, AnUpdateAnnouncesTheListsItEvaluatesAndGivesTheSameBits) {
  std::vector<double> values[2];
  for (const bool prepares : {false, true}) {
    IncrementalOptions options;
    options.batch_share = 1.0;  // incrementally from the start
    IncrementalSolver solver(options);
    const auto family = solver.AddFamily(std::make_shared<Announced>(prepares));
    GraphEdit edit(solver.graph());
    const std::vector<VariableId> variables = AddScene(family, &edit);
    ASSERT_TRUE(solver.Apply(edit).ok());
    ASSERT_NE(solver.Update().termination, Termination::kFailure);
    const int before = family->num_announced;
    edit.Restart();
    const double moved[3] = {0.5, 0.5, -6.0};
    edit.SetValues(variables[kCameras], moved);
    ASSERT_TRUE(solver.Apply(edit).ok());
    ASSERT_NE(solver.Update().termination, Termination::kFailure);
    if (prepares) {
      EXPECT_GT(family->num_announced, before);
    } else {
      EXPECT_EQ(family->num_announced, 0);
    }
    for (const VariableId id : variables) {
      const double* x = solver.Values(id);
      values[prepares ? 1 : 0].insert(values[prepares ? 1 : 0].end(), x,
                                      x + solver.graph().AmbientSize(id));
    }
  }
  EXPECT_EQ(values[0], values[1]);
}

}  // namespace
}  // namespace inceres
