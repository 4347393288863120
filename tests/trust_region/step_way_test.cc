// Which way a step is predicted to take least: from connections alone, and what the solver makes of
// it.
#include "trust_region/step_way.h"

#include <algorithm>
#include <cmath>
#include <memory>
#include <string>
#include <vector>

#include <gtest/gtest.h>

#include "base/memory_budget.h"
#include "inceres/solver/solver.h"
#include "schur/scene_shape.h"
#include "support/core_pipeline.h"
#include "support/random_graph.h"
#include "support/street_graph.h"
#include "trust_region/iterative_model.h"

namespace inceres::internal {
namespace {

using test::CorePipeline;
using test::MakeStreetGraph;
using test::RandomGraph;
using test::StreetGraphOptions;

StreetGraphOptions Street(int num_cameras, bool split = false) {
  StreetGraphOptions options;
  options.num_cameras = num_cameras;
  options.split = options.shared_focal = split;
  return options;
}

// Frames of six, and landmarks that any ten of them see: S is full where there are many.
std::unique_ptr<RandomGraph> MakeCollection(int num_frames, int num_landmarks) {
  auto collection = std::make_unique<RandomGraph>(3);
  std::vector<VariableId> frames;
  for (int i = 0; i < num_frames; ++i) {
    frames.push_back(collection->AddFrame(6));
  }
  for (int l = 0; l < num_landmarks; ++l) {
    const VariableId landmark = collection->AddLandmark(3);
    int frame = collection->random().Below(num_frames);
    for (int k = 0; k < 10; ++k) {
      collection->Connect(2, {frames[static_cast<std::size_t>(frame)], landmark}, nullptr, 0.01);
      frame = (frame + 1 + collection->random().Below(num_frames / 10)) % num_frames;
    }
  }
  return collection;
}

struct Connections {
  explicit Connections(const FactorGraph& graph)
      : executor(1),
        layout(graph, /*eliminate_landmarks=*/true),
        evaluator(graph, layout, executor) {}
  Executor executor;
  Layout layout;
  Evaluator evaluator;
};

TEST(SceneShape, CountsWhatThePlansHave) {
  for (const bool split : {false, true}) {
    const auto street = MakeStreetGraph(Street(40, split));
    const CorePipeline core(street->graph);
    const SceneShape scene(core.evaluator, core.incidences);
    EXPECT_EQ(scene.num_products(), static_cast<double>(core.plans.schur.terms.size()));
    const BlockPattern pattern = scene.Pattern();
    EXPECT_EQ(pattern.columns, core.plans.pattern.columns);
    EXPECT_EQ(pattern.row_begin, core.plans.pattern.row_begin);
    EXPECT_EQ(pattern.value_begin, core.plans.pattern.value_begin);
    EXPECT_EQ(pattern.offsets, core.plans.pattern.offsets);
    // each landmark from four cameras: three further with each step
    EXPECT_EQ(scene.FindExtent().length, 13) << "a focal length that all share leads nowhere";
  }
}

// The frames lie along a street, in an order of which this knows nothing.
TEST(SceneShape, AnEnvelopeIsAnUpperBoundOfTheFactor) {
  for (const bool split : {false, true}) {
    const auto street = MakeStreetGraph(Street(400, split));
    const Connections street_scene(street->graph);
    const LandmarkIncidences incidences(street_scene.evaluator);
    const SceneShape scene(street_scene.evaluator, incidences);
    const SceneShape::Extent extent = scene.FindExtent();
    std::vector<int> sorted = extent.order;
    std::sort(sorted.begin(), sorted.end());
    for (std::size_t k = 0; k < sorted.size(); ++k) {
      ASSERT_EQ(sorted[k], static_cast<int>(k)) << "each frame once";
    }
    EXPECT_EQ(sorted.size(), static_cast<std::size_t>(street_scene.layout.num_frames));
    ReducedPrediction analyzed;
    ASSERT_TRUE(PredictReducedSolver(scene.Pattern(), &analyzed).ok());
    const ReducedPrediction envelope = scene.PredictEnvelope(extent);
    EXPECT_GE(envelope.cost, analyzed.cost);
    EXPECT_GE(envelope.bytes, analyzed.bytes);
    EXPECT_LT(envelope.cost, PredictFullSystem(scene.size()).cost) << "of use";
    const StepCosts costs = PredictSteps(street_scene.evaluator);
    EXPECT_EQ(costs.factor_is_bound, true);
    EXPECT_EQ(costs.Cheapest(), StepWay::kFactor);
  }
}

TEST(SceneShape, SamplesTheFill) {
  const auto street = MakeStreetGraph(Street(200));
  const CorePipeline core(street->graph);
  const SceneShape scene(core.evaluator, core.incidences);
  const double fill =
      static_cast<double>(2 * core.plans.pattern.columns.size() - 200) / (200.0 * 200.0);
  EXPECT_NEAR(scene.TakeSample().fill, fill, 0.05 * fill);
  // one chunk: each block is written once
  const double products = scene.num_products() * 2.0 - 200.0 * 48.0;
  EXPECT_NEAR(scene.TakeSample().writes_per_product, fill * 200.0 * 200.0 / products, 0.05);
}

TEST(SceneShape, TakesTheLongestOfSeveralScenes) {
  RandomGraph graph(1);
  graph.AddFrame(6);  // nobody sees it: it has no place
  std::vector<VariableId> frames;
  for (int i = 0; i < 12; ++i) {
    frames.push_back(graph.AddFrame(6));
    graph.Connect(3, {frames.back()});
  }
  for (std::size_t i = 3; i < 11; ++i) {
    graph.Connect(6, {frames[i], frames[i + 1]});
  }
  const VariableId landmark = graph.AddLandmark(3);
  graph.Connect(2, {frames[0], landmark});
  graph.Connect(2, {frames[1], landmark});
  const Connections scene(graph.graph());
  const LandmarkIncidences incidences(scene.evaluator);
  EXPECT_EQ(SceneShape(scene.evaluator, incidences).FindExtent().length, 8);
}

TEST(StepWay, AFactorWhereItIsSmallOrSparse) {
  const auto small = MakeStreetGraph(Street(10));
  EXPECT_EQ(PredictSteps(Connections(small->graph).evaluator).Cheapest(), StepWay::kFactor);
  const auto street = MakeStreetGraph(Street(1500));
  const StepCosts costs = PredictSteps(Connections(street->graph).evaluator);
  EXPECT_EQ(costs.Cheapest(), StepWay::kFactor);
  EXPECT_LT(costs[StepWay::kTwoLevelOnS], costs[StepWay::kBlocksOnS]) << "a long way";
}

TEST(StepWay, ConjugateGradientsWhereSIsFull) {
  const auto collection = MakeCollection(1500, 4500);
  const StepCosts costs = PredictSteps(Connections(collection->graph()).evaluator);
  EXPECT_EQ(costs.Cheapest(), StepWay::kBlocks);
  EXPECT_GT(costs[StepWay::kFactor], costs[StepWay::kBlocks]);
}

TEST(StepWay, NoSWhereThereIsNoMemoryForIt) {
  const auto street = MakeStreetGraph(Street(1500));
  const Connections scene(street->graph);
  Connections limited(street->graph);
  MemoryBudget budget(100000);
  limited.evaluator.set_memory_budget(&budget);
  const StepCosts costs = PredictSteps(limited.evaluator);
  EXPECT_EQ(costs.Cheapest(), StepWay::kTwoLevel);
  EXPECT_TRUE(std::isinf(costs[StepWay::kFactor]));
  EXPECT_EQ(budget.taken(), 0);
}

TEST(StepWay, TheSolverGoesIt) {
  const auto collection = MakeCollection(1500, 4500);
  SolverOptions options;
  options.max_num_iterations = 3;
  options.reduced_solver = ReducedSolverKind::kAutomaticInexact;
  options.conjugate_gradients.eta = 1e-6;
  const std::vector<double> start = collection->graph().state();
  const Summary chosen = Solve(options, &collection->graph());
  EXPECT_NE(chosen.reduced_solver.find("by products"), std::string::npos) << chosen.reduced_solver;
  EXPECT_GT(chosen.work.num_conjugate_gradients, chosen.work.num_linear_solves) << chosen.message;
  collection->graph().mutable_state() = start;
  options.linear_model = LinearModelKind::kIterativeSchur;
  options.conjugate_gradients.preconditioner = PreconditionerKind::kSchurJacobi;
  const Summary named = Solve(options, &collection->graph());
  EXPECT_EQ(named.final_cost, chosen.final_cost);
  collection->graph().mutable_state() = start;
  options.linear_model = LinearModelKind::kAutomatic;
  options.strategy = TrustRegionStrategyKind::kDogleg;
  options.max_num_iterations = 0;
  const Summary dogleg = Solve(options, &collection->graph());
  EXPECT_EQ(dogleg.reduced_solver.find("conjugate"), std::string::npos) << "not with Dog-Leg";
}

TEST(StepWay, LandmarksFollowEveryStepThatItTakes) {
  const auto street = MakeStreetGraph(Street(60));
  const CorePipeline core(street->graph);
  for (const Unfinished unfinished : {Unfinished::kMovesAll, Unfinished::kAsCeres}) {
    ConjugateGradientsOptions options = OptionsOf(StepWay::kTwoLevelOnS, {});
    EXPECT_TRUE(options.explicit_schur_complement);
    EXPECT_EQ(options.preconditioner, PreconditionerKind::kTwoLevel);
    options.eta = 1e-12;
    options.max_iterations = 1;
    Status status;
    IterativeModel model(options, unfinished, core.evaluator, &status);
    ASSERT_TRUE(status.ok()) << status.message;
    StageSeconds seconds;
    StageClock clock;
    model.TimeInto(&seconds, &clock);
    model.Refresh();
    const auto size = static_cast<std::size_t>(core.layout.size());
    std::vector<double> step(size, 0.0);
    const std::vector<double> damping(size, 1.0);
    ASSERT_TRUE(model.Solve(damping.data(), step.data()).ok());
    const bool stay = unfinished == Unfinished::kAsCeres;
    EXPECT_EQ(model.left_out_landmarks(), stay);
    EXPECT_NE(step.front(), 0.0);
    EXPECT_EQ(step.back() == 0.0, stay);
  }
}

}  // namespace
}  // namespace inceres::internal
