#include "tools/problems/problem_source.h"

#include <memory>
#include <string>
#include <vector>

#include <ceres/solver.h>
#include <gtest/gtest.h>

#include "inceres/io/vio_sequence.h"
#include "inceres/solver/solver.h"
#include "tests/support/temp_dir.h"
#include "tests/tools/small_problems.h"
#include "tools/problems/ceres_loss.h"
#include "tools/problems/loss_spec.h"
#include "tools/sim/vio_scene.h"

namespace inceres::tools {
namespace {

TEST(OpenProblem, ReadsBalAndG2o) {
  const test::TempDir directory;
  ASSERT_TRUE(WriteBal(directory.File("small.txt"), SmallBal()).ok());
  test::WriteBytes(directory.File("two.g2o"),
                   "VERTEX_SE2 0 0 0 0\nVERTEX_SE2 1 1 0 0\nEDGE_SE2 0 1 1 0 0 1 0 0 1 0 1\n");
  std::unique_ptr<ProblemSource> source;
  Status status = OpenProblem("bal:" + directory.File("small.txt"), &source);
  ASSERT_TRUE(status.ok()) << status.message;
  EXPECT_EQ(source->Describe(), "4 cameras, 30 points, 120 observations");
  EXPECT_TRUE(source->HasLandmarks());
  status = OpenProblem("g2o:" + directory.File("two.g2o"), &source);
  ASSERT_TRUE(status.ok()) << status.message;
  EXPECT_EQ(source->Describe(), "2 poses in 2D, 1 edges");
  EXPECT_FALSE(source->HasLandmarks());
  std::unique_ptr<FactorGraph> graph;
  EXPECT_EQ(source->MakeGraph(LossSpec{}, &graph).code, StatusCode::kInvalidArgument);
}

TEST(OpenProblem, NamesWhatIsWrong) {
  std::unique_ptr<ProblemSource> source;
  for (const char* text : {"", "bal", "bal:", "toro:file"}) {
    EXPECT_EQ(OpenProblem(text, &source).code, StatusCode::kInvalidArgument) << text;
  }
  for (const char* text : {"bal:/nowhere/a.txt", "g2o:/nowhere/a.txt"}) {
    const Status status = OpenProblem(text, &source);
    EXPECT_EQ(status.code, StatusCode::kIo) << text;
    EXPECT_NE(status.message.find("/nowhere/a.txt"), std::string::npos) << status.message;
  }
}

TEST(OpenProblem, KnowsPresetsAndFilesOfVisualInertialSequences) {
  const test::TempDir directory;
  VioSceneOptions options;
  VioSequence sequence;
  ASSERT_TRUE(GetVioScenePreset("cubic", &options).ok());
  ASSERT_TRUE(GenerateVioScene(options, &sequence).ok());
  ASSERT_TRUE(WriteVioSequence(directory.File("cubic"), sequence).ok());
  std::vector<double> start;
  for (const std::string& name : {std::string("cubic"), directory.File("cubic")}) {
    std::unique_ptr<ProblemSource> source;
    const Status status = OpenProblem("vio:" + name, &source);
    ASSERT_TRUE(status.ok()) << status.message;
    EXPECT_EQ(source->Describe(), "50 frames, 163 points, 789 observations, 49 IMU factors");
    EXPECT_TRUE(source->HasLandmarks());
    ProblemSource::CeresInstance instance;
    ASSERT_TRUE(source->MakeCeresInstance(LossSpec{}, &instance).ok());
    EXPECT_TRUE(start.empty() || start == instance.parameters)
        << "what was written is what is simulated";
    start = instance.parameters;
  }
  std::unique_ptr<ProblemSource> source;
  const Status status = OpenProblem("vio:/nowhere/a.vio", &source);
  EXPECT_EQ(status.code, StatusCode::kIo);
  EXPECT_NE(status.message.find("/nowhere/a.vio"), std::string::npos) << status.message;
  sequence.frames.resize(1);
  sequence.frames[0].observations.clear();
  sequence.points.clear();
  ASSERT_TRUE(WriteVioSequence(directory.File("one.vio"), sequence).ok());
  EXPECT_NE(
      OpenProblem("vio:" + directory.File("one.vio"), &source).message.find("two or more frames"),
      std::string::npos);
}

// Stock and ours minimize one function: the same cost, and the same gradient, to the last digits.
TEST(VioSource, CeresAndTheCoreHaveTheSameProblem) {
  std::unique_ptr<ProblemSource> source;
  ASSERT_TRUE(OpenProblem("vio:cubic", &source).ok());
  for (const LossSpec& loss : {LossSpec{}, LossSpec{LossSpec::Kind::kHuber, 1.0}}) {
    ProblemSource::CeresInstance instance;
    std::unique_ptr<FactorGraph> graph;
    ASSERT_TRUE(source->MakeCeresInstance(loss, &instance).ok());
    ASSERT_TRUE(source->MakeGraph(loss, &graph).ok());
    EXPECT_EQ(source->ParametersOf(*graph), instance.parameters);
    EXPECT_EQ(instance.problem->NumResidualBlocks(), 789 + 49);
    EXPECT_EQ(graph->num_factors(), 789 + 49);
    EXPECT_EQ(instance.landmarks_first->GroupSize(0), 163);
    ceres::Solver::Options stock;
    stock.max_num_iterations = 0;
    ceres::Solver::Summary expected;
    ceres::Solve(stock, instance.problem.get(), &expected);
    SolverOptions options;
    options.max_num_iterations = 0;
    const Summary summary = Solve(options, graph.get());
    EXPECT_NEAR(summary.initial_cost, expected.initial_cost, 1e-12 * expected.initial_cost);
    const double gradient_norm = expected.iterations[0].gradient_norm;
    EXPECT_GT(gradient_norm, 1.0);
    EXPECT_NEAR(summary.iterations[0].gradient_norm, gradient_norm, 1e-10 * gradient_norm);
  }
  ProblemSource::CeresInstance instance;
  ASSERT_TRUE(source->MakeCeresInstance(LossSpec{}, &instance).ok());
  EXPECT_EQ(source->Difference(instance.parameters, instance.parameters).Largest(), 0.0);
  std::vector<double> a = instance.parameters;
  a[7] += 1.0;  // the first pose comes after the camera
  EXPECT_GT(source->Difference(a, instance.parameters).positions, 0.01);
}

TEST(BalSource, EveryInstanceStartsFromTheFile) {
  const BalSource source(SmallBal());
  ProblemSource::CeresInstance first;
  ASSERT_TRUE(source.MakeCeresInstance(LossSpec{}, &first).ok());
  const std::vector<double> start = first.parameters;
  first.parameters[0] += 1.0;
  ProblemSource::CeresInstance second;
  ASSERT_TRUE(source.MakeCeresInstance(LossSpec{}, &second).ok());
  EXPECT_EQ(second.parameters, start);
  EXPECT_EQ(second.landmarks_first->NumElements(), 34);
  EXPECT_EQ(second.landmarks_first->GroupSize(0), 30);
  EXPECT_EQ(source.WithParameters(start).cameras, source.bal().cameras);
  EXPECT_EQ(source.WithParameters(start).points, source.bal().points);
}

TEST(BalSource, GraphHoldsTheSameProblem) {
  BalProblem bal = SmallBal();
  bal.num_points += 1;
  bal.points.insert(bal.points.end(), 3, 0.5);  // nobody sees this point
  const BalSource source(bal);
  ProblemSource::CeresInstance instance;
  ASSERT_TRUE(source.MakeCeresInstance(LossSpec{}, &instance).ok());
  std::unique_ptr<FactorGraph> graph;
  ASSERT_TRUE(source.MakeGraph(LossSpec{LossSpec::Kind::kHuber, 1.0}, &graph).ok());
  EXPECT_TRUE(graph->Validate().ok()) << graph->Validate().message;
  EXPECT_EQ(graph->num_factors(), 120);
  EXPECT_TRUE(graph->HasLosses(0));
  EXPECT_EQ(source.ParametersOf(*graph), instance.parameters);
  EXPECT_FALSE(graph->IsConstant(0));
  EXPECT_TRUE(graph->IsConstant(34));
}

TEST(BalSource, DifferenceIsZeroForTheSameParameters) {
  const BalSource source(SmallBal());
  ProblemSource::CeresInstance instance;
  ASSERT_TRUE(source.MakeCeresInstance(LossSpec{}, &instance).ok());
  EXPECT_LT(source.Difference(instance.parameters, instance.parameters).Largest(), 1e-13);
}

TEST(ParseLoss, ReadsWhatToStringWrites) {
  for (const char* text : {"none", "huber:1.5", "cauchy:0.1", "huber:1e-07"}) {
    LossSpec spec;
    const Status status = ParseLoss(text, &spec);
    ASSERT_TRUE(status.ok()) << status.message;
    EXPECT_EQ(ToString(spec), text);
  }
}

TEST(ParseLoss, NamesWhatIsWrongAndChangesNothing) {
  for (const char* text : {"", "huber", "huber:", "huber:0", "huber:-1", "huber:nan", "huber:1x",
                           "tukey:1", "none:1", "cauchy:inf"}) {
    LossSpec spec{LossSpec::Kind::kHuber, 3.0};
    const Status status = ParseLoss(text, &spec);
    EXPECT_EQ(status.code, StatusCode::kInvalidArgument) << text;
    EXPECT_NE(status.message.find("'" + std::string(text) + "'"), std::string::npos)
        << status.message;
    EXPECT_EQ(ToString(spec), "huber:3");
  }
}

TEST(MakeLoss, CeresAndCoreAgree) {
  for (const char* text : {"huber:1.5", "cauchy:0.7"}) {
    LossSpec spec;
    ASSERT_TRUE(ParseLoss(text, &spec).ok());
    for (const double s : {0.0, 0.3, 2.25, 40.0}) {
      double ceres_rho[3];
      double core_rho[3];
      MakeCeresLoss(spec)->Evaluate(s, ceres_rho);
      MakeCoreLoss(spec)->Evaluate(s, core_rho);
      for (int k = 0; k < 3; ++k) {
        EXPECT_NEAR(ceres_rho[k], core_rho[k], 1e-15 * (1.0 + std::abs(ceres_rho[k])))
            << text << " at " << s;
      }
    }
  }
  EXPECT_EQ(MakeCeresLoss({}), nullptr);
  EXPECT_EQ(MakeCoreLoss({}), nullptr);
}

}  // namespace
}  // namespace inceres::tools
