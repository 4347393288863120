#include "tools/common/problem_source.h"

#include <gtest/gtest.h>

#include "tests/support/temp_dir.h"
#include "tests/tools/small_problems.h"

namespace inceres::tools {
namespace {

TEST(OpenProblem, ReadsBalAndG2o) {
  const test::TempDir directory;
  ASSERT_TRUE(WriteBal(directory.File("small.txt"), SmallBal()).ok());
  test::WriteBytes(directory.File("two.g2o"), "VERTEX_SE2 0 0 0 0\nVERTEX_SE2 1 1 0 0\nEDGE_SE2 0 1 1 0 0 1 0 0 1 0 1\n");
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

}  // namespace
}  // namespace inceres::tools
