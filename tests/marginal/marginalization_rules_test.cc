#include <algorithm>

#include <gtest/gtest.h>

#include "inceres/solver/marginalization.h"
#include "marginal/linear_world.h"
#include "support/random_graph.h"

namespace inceres::test {
namespace {

using Ids = std::vector<VariableId>;

// Four frames, each tied to the next, and landmarks by who sees them.
class Rules : public testing::Test {
 protected:
  Rules() {
    for (int i = 0; i < 4; ++i) {
      frames_.push_back(random_.AddFrame(3));
      random_.Connect(3, {frames_.back()});
      if (i > 0) {
        random_.Connect(3, {frames_[static_cast<std::size_t>(i) - 1], frames_.back()});
      }
    }
    old_ = Landmark({0, 1});
    long_ = Landmark({0, 1, 2, 3});
    once_ = Landmark({0});
    young_ = Landmark({2, 3});
    only_second_ = Landmark({2});
    constant_ = Landmark({0, 3});
    random_.graph().SetConstant(constant_, true);
    anchored_ = random_.AddLandmark(1);
    for (int i = 1; i < 4; ++i) {  // the anchor is frame 0, in every factor
      random_.Connect(2, {frames_[0], frames_[static_cast<std::size_t>(i)], anchored_});
    }
  }

  VariableId Landmark(const std::vector<int>& frames) {
    const VariableId id = random_.AddLandmark(2);
    for (const int i : frames) {
      random_.Connect(2, {frames_[static_cast<std::size_t>(i)], id});
    }
    return id;
  }
  FactorGraph& graph() { return random_.graph(); }

  // The pairs (frame, landmark) whose factors are dropped.
  std::vector<std::pair<VariableId, VariableId>> Dropped(const MarginalizationRequest& request) {
    std::vector<std::pair<VariableId, VariableId>> pairs;
    for (const FactorId& factor : request.dropped_factors) {
      const VariableId* ids = graph().Variables(factor.family, factor.index);
      pairs.emplace_back(ids[0], ids[graph().family(factor.family).num_slots() - 1]);
    }
    std::sort(pairs.begin(), pairs.end());
    return pairs;
  }

  RandomGraph random_{3};
  Ids frames_;
  VariableId old_, long_, once_, young_, only_second_, constant_, anchored_;
};

TEST_F(Rules, TheOldestFrameTakesItsLandmarksAlong) {
  const MarginalizationRequest request = OldestFrameRule(graph(), {frames_[0]});
  EXPECT_EQ(request.marginalized, (Ids{frames_[0], old_, long_, anchored_}));
  EXPECT_EQ(request.dropped, Ids{once_});
  EXPECT_TRUE(request.dropped_factors.empty());
  MarginalizationSummary summary = Marginalize(request, MarginalizationOptions(), &graph());
  ASSERT_TRUE(summary.status.ok()) << summary.status.message;
  EXPECT_EQ(summary.kept, (Ids{frames_[1], frames_[2], frames_[3]}));
  EXPECT_TRUE(graph().HasVariable(constant_));
}

TEST_F(Rules, AFrameThatIsNotThereIsNamedByMarginalize) {
  const MarginalizationRequest request = OldestFrameRule(graph(), {12345678});
  EXPECT_EQ(request.marginalized, Ids{12345678});
  EXPECT_NE(
      Marginalize(request, MarginalizationOptions(), &graph()).status.message.find("12345678"),
      std::string::npos);
}

// Such a constant is fine where nothing is asked by it.
TEST_F(Rules, AKeptConstantHasTheDegreesOfFreedomOfItsSlots) {
  FactorGraph graph;
  const auto ties = graph.AddFamily(
      std::make_shared<LinearFamily>(3, std::vector<FactorFamily::Slot>{{3, 3}, {3, 3}}));
  const double up[3] = {0.0, 0.0, 1.0};
  const VariableId frame = graph.AddVariable(up, 3, Role::kFrame);
  const VariableId constant =
      graph.AddVariable(up, 3, Role::kFrame, std::make_shared<SphereManifold>(3));
  graph.SetConstant(constant, true);
  graph.AddFactor(ties, {Eigen::MatrixXd::Identity(3, 6), Eigen::MatrixXd::Zero(3, 1)},
                  {frame, constant});
  MarginalizationRequest request;
  request.marginalized = {frame};
  MarginalizationOptions options;
  options.keep_constants = true;
  const MarginalizationSummary refused = Marginalize(request, options, &graph);
  EXPECT_EQ(refused.status.code, StatusCode::kInvalidArgument);
  EXPECT_EQ(refused.offenders, Ids{constant});
  options.keep_constants = false;
  EXPECT_TRUE(Marginalize(request, options, &graph).status.ok());
}

TEST_F(Rules, TheSecondNewestFrameLeavesItsViewsBehind) {
  const MarginalizationRequest request = SecondNewestFrameRule(graph(), {frames_[2]});
  EXPECT_EQ(request.marginalized, Ids{frames_[2]});
  EXPECT_EQ(request.dropped, Ids{only_second_});
  const std::vector<std::pair<VariableId, VariableId>> expected = {
      {frames_[0], anchored_}, {frames_[2], long_}, {frames_[2], young_}};
  EXPECT_EQ(Dropped(request), expected);
  MarginalizationSummary summary = Marginalize(request, MarginalizationOptions(), &graph());
  ASSERT_TRUE(summary.status.ok()) << summary.status.message;
  EXPECT_EQ(summary.kept, (Ids{frames_[1], frames_[3]}));
  EXPECT_EQ(summary.num_factors, 3);  // two ties and a prior
}

TEST_F(Rules, AKeyframeLeavesLandmarksThatAreStillSeen) {
  const MarginalizationRequest request = KeyframeRule(graph(), {frames_[0]}, {frames_[3]});
  // The anchored one is still seen too, but could not stay without its anchor.
  EXPECT_EQ(request.marginalized, (Ids{frames_[0], old_, anchored_}));
  EXPECT_EQ(request.dropped, Ids{once_});
  const std::vector<std::pair<VariableId, VariableId>> expected = {{frames_[0], long_}};
  EXPECT_EQ(Dropped(request), expected);
  MarginalizationSummary summary = Marginalize(request, MarginalizationOptions(), &graph());
  ASSERT_TRUE(summary.status.ok()) << summary.status.message;
  EXPECT_TRUE(graph().HasVariable(long_));
  EXPECT_EQ(summary.kept, (Ids{frames_[1], frames_[2], frames_[3]}));
}

}  // namespace
}  // namespace inceres::test
