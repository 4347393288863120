// Suspects of a living graph: wrong loops lose their weight as they come, and get it back when they
// are corrected.
#include <memory>
#include <string>
#include <vector>

#include <gtest/gtest.h>

#include "inceres/factors/planar_relative_pose.h"
#include "inceres/io/g2o_graph.h"
#include "inceres/problem/losses.h"
#include "inceres/problem/rotation.h"
#include "robust/gnc_worlds.h"

namespace inceres {
namespace {

using test::PoseGraphWorld;

// Plays a planar world to a living solver, pose by pose; a loop comes with its later pose, and a
// wrong one not before the first pose for those.
class LivingWorld {
 public:
  explicit LivingWorld(const PoseGraphWorld& world, int first_for_wrong = 0,
                       double function_tolerance = IncrementalOptions().function_tolerance)
      : world_(world),
        first_for_wrong_(first_for_wrong),
        solver_(SolverOptionsWith(function_tolerance)),
        gnc_(Options(), &solver_) {
    family_ = solver_.AddFamily(std::make_shared<PlanarRelativePoseFamily>());
  }

  GncSummary AddPose(int i) {
    GraphEdit edit(solver_.graph());
    std::vector<double> start(world_.truth.PoseData(0), world_.truth.PoseData(0) + 3);
    if (i > 0) {
      const PoseGraphEdge& odometry = world_.truth.edges[static_cast<std::size_t>(i) - 1];
      ComposePlanarPoses(solver_.Values(i - 1), odometry.measurement.data(), start.data());
    }
    edit.AddVariable(start.data(), 3, Role::kFrame);
    if (i == 0) {
      edit.SetConstant(0, true);
    }
    std::vector<FactorId> loops;
    for (std::size_t k = 0; k < world_.truth.edges.size(); ++k) {
      const PoseGraphEdge& edge = world_.truth.edges[k];
      if (edge.to == i && (i >= first_for_wrong_ || !IsWrongEdge(k))) {
        const bool is_loop = k >= world_.truth.ids.size() - 1;
        const FactorId id = AddEdge(edge, is_loop ? loop_loss_ : nullptr, &edit);
        edges_.push_back({k, id});
        if (is_loop) {
          loops.push_back(id);
        }
      }
    }
    EXPECT_TRUE(solver_.Apply(edit).ok());
    for (const FactorId& id : loops) {
      gnc_.Watch(id);
    }
    return gnc_.Update();
  }

  FactorId AddEdge(const PoseGraphEdge& edge, const std::shared_ptr<const Loss>& loss,
                   GraphEdit* edit) {
    PlanarRelativePoseFamily::Measurement measurement;
    EXPECT_TRUE(ToMeasurement(edge, &measurement));
    return edit->AddFactor(family_, measurement, {edge.from, edge.to}, loss);
  }

  bool IsWrongEdge(std::size_t edge) const {
    return edge >= world_.truth.edges.size() - static_cast<std::size_t>(world_.num_wrong);
  }

  bool IsWrong(FactorId id) const {
    for (const auto& [edge, factor] : edges_) {
      if (factor.index == id.index) {
        return IsWrongEdge(edge);
      }
    }
    return false;
  }

  static IncrementalOptions SolverOptionsWith(double function_tolerance) {
    IncrementalOptions options;
    options.function_tolerance = function_tolerance;
    return options;
  }

  static GncOptions Options() {
    GncOptions options;
    options.inlier_probability = 0.9999;
    return options;
  }

  PoseGraphWorld world_;
  int first_for_wrong_;
  IncrementalSolver solver_;
  LivingGnc gnc_;
  FamilyHandle<PlanarRelativePoseFamily> family_;
  std::vector<std::pair<std::size_t, FactorId>> edges_;
  std::shared_ptr<const Loss> loop_loss_;  // that loops come with
};

TEST(LivingGnc, FindsWrongLoopsAsTheyCome) {
  LivingWorld living(PoseGraphWorld(2, 200, 40, 30, 0.01, 21));
  GncSummary summary;
  for (int i = 0; i < 200; ++i) {
    summary = living.AddPose(i);
    ASSERT_EQ(summary.termination, Termination::kConvergence) << i << ": " << summary.message;
  }
  ASSERT_EQ(static_cast<int>(summary.verdicts.size()), living.gnc_.num_suspects());
  int num_lost = 0;
  for (const GncVerdict& verdict : summary.verdicts) {
    EXPECT_EQ(verdict.weight, verdict.inlier ? 1.0 : 0.0);
    if (living.IsWrong(verdict.factor)) {
      EXPECT_FALSE(verdict.inlier) << verdict.factor.index;
    } else {
      num_lost += verdict.inlier ? 0 : 1;
    }
  }
  EXPECT_LE(num_lost, 2);
}

TEST(LivingGnc, LooksAtNothingElseWhereNothingIsInDoubt) {
  LivingWorld living(PoseGraphWorld(2, 120, 40, 0, 0.01, 2));
  for (int i = 0; i < 120; ++i) {
    living.AddPose(i);
  }
  const GncSummary summary = living.gnc_.Update();
  EXPECT_EQ(summary.rounds.size(), 1u);
  EXPECT_EQ(summary.rounds[0].num_relinearized_factors, 0);
  EXPECT_EQ(summary.num_outliers, 0);
}

// Where it is plain that a loop is wrong nothing moves for it: poses and rounds are those of a
// graph that it never came to, but for second looks whenever there are twice as many. Solved so far
// that what either leaves undone does not show.
TEST(LivingGnc, MovesNothingForALoopThatIsPlainlyWrong) {
  LivingWorld living(PoseGraphWorld(2, 120, 40, 30, 0.01, 4), 60, 1e-8);
  LivingWorld without(PoseGraphWorld(2, 120, 40, 30, 0.01, 4), 120, 1e-8);
  int num_looks = 0;
  for (int i = 0; i < 120; ++i) {
    const GncSummary summary = living.AddPose(i);
    const GncSummary expected = without.AddPose(i);
    ASSERT_EQ(summary.termination, Termination::kConvergence) << summary.message;
    num_looks += summary.rounds.size() != expected.rounds.size() ? 1 : 0;
    for (VariableId id = 0; id <= i; ++id) {
      for (int k = 0; k < 3; ++k) {
        ASSERT_NEAR(living.solver_.Values(id)[k], without.solver_.Values(id)[k], 1e-4) << i;
      }
    }
  }
  EXPECT_GT(living.gnc_.num_suspects(), without.gnc_.num_suspects() + 10);
  EXPECT_LE(num_looks, 4);
}

// The measurement of one wrong loop is put right: its history begins anew, the others' do not.
TEST(LivingGnc, TakesASuspectInAgainOnceItIsEdited) {
  LivingWorld living(PoseGraphWorld(2, 120, 40, 10, 0.01, 4));
  GncSummary summary;
  for (int i = 0; i < 120; ++i) {
    summary = living.AddPose(i);
  }
  FactorId wrong;
  for (const GncVerdict& verdict : summary.verdicts) {
    wrong = living.IsWrong(verdict.factor) && !verdict.inlier ? verdict.factor : wrong;
  }
  ASSERT_GE(wrong.index, 0);
  const VariableId* ends = living.solver_.graph().Variables(wrong.family, wrong.index);
  double inverse[3];
  PlanarRelativePoseFamily::Measurement right = living.family_->measurement(wrong.index);
  InvertPlanarPose(living.solver_.Values(ends[0]), inverse);
  ComposePlanarPoses(inverse, living.solver_.Values(ends[1]), right.motion);
  GraphEdit edit(living.solver_.graph());
  edit.SetMeasurement(wrong, living.family_, right);
  ASSERT_TRUE(living.solver_.Apply(edit).ok());
  living.gnc_.Reset(wrong);
  const GncSummary after = living.gnc_.Update();
  EXPECT_EQ(after.num_outliers, summary.num_outliers - 1);
  EXPECT_EQ(living.solver_.graph().loss(wrong.family, wrong.index), nullptr);
}

// Losses that suspects come with, or get beside their histories, are replaced, whatever the weight:
// the world without them ends with the same bits.
TEST(LivingGnc, ReplacesLossesOfSuspects) {
  const PoseGraphWorld world(2, 60, 20, 4, 0.01, 4);
  LivingWorld plain(world);
  LivingWorld with_losses(world);
  with_losses.loop_loss_ = std::make_shared<HuberLoss>(1e-3);
  for (int i = 0; i < 60; ++i) {
    plain.AddPose(i);
    with_losses.AddPose(i);
  }
  // And one that is edited later.
  FactorId right;
  for (const GncVerdict& verdict : with_losses.gnc_.Update().verdicts) {
    right = verdict.inlier ? verdict.factor : right;
  }
  ASSERT_GE(right.index, 0);
  GraphEdit edit(with_losses.solver_.graph());
  edit.SetLoss(right, std::make_shared<HuberLoss>(1e-3));
  ASSERT_TRUE(with_losses.solver_.Apply(edit).ok());
  plain.gnc_.Update();
  const GncSummary expected = plain.gnc_.Update();
  const GncSummary summary = with_losses.gnc_.Update();
  ASSERT_EQ(summary.verdicts.size(), expected.verdicts.size());
  int num_full = 0;
  for (std::size_t k = 0; k < summary.verdicts.size(); ++k) {
    const GncVerdict& verdict = summary.verdicts[k];
    EXPECT_EQ(verdict.weight, expected.verdicts[k].weight);
    const Loss* const loss =
        with_losses.solver_.graph().loss(verdict.factor.family, verdict.factor.index);
    EXPECT_EQ(loss == nullptr, verdict.weight == 1.0);
    num_full += verdict.weight == 1.0 ? 1 : 0;
  }
  EXPECT_GT(num_full, 10);
  EXPECT_NEAR(summary.final_cost, expected.final_cost, 1e-6 * expected.final_cost);
}

// A suspect that is reset is one that has just come, with the weight of its error now.
TEST(LivingGnc, AResetSuspectIsAsOneThatHasJustCome) {
  LivingWorld reset(PoseGraphWorld(2, 60, 20, 6, 0.01, 4));
  LivingWorld watched(PoseGraphWorld(2, 60, 20, 6, 0.01, 4));
  for (int i = 0; i < 60; ++i) {
    reset.AddPose(i);
    watched.AddPose(i);
  }
  int num_outliers = 0;
  for (const GncVerdict& verdict : watched.gnc_.Update().verdicts) {
    num_outliers += verdict.inlier ? 0 : 1;
    watched.gnc_.Forget(verdict.factor);
    watched.gnc_.Watch(verdict.factor);
  }
  EXPECT_GT(num_outliers, 2);
  for (const GncVerdict& verdict : reset.gnc_.Update().verdicts) {
    reset.gnc_.Reset(verdict.factor);
  }
  const GncSummary expected = watched.gnc_.Update();
  const GncSummary summary = reset.gnc_.Update();
  ASSERT_EQ(summary.rounds.size(), expected.rounds.size());
  for (std::size_t k = 0; k < summary.rounds.size(); ++k) {
    EXPECT_EQ(summary.rounds[k].mu, expected.rounds[k].mu) << k;
    EXPECT_EQ(summary.rounds[k].num_none, expected.rounds[k].num_none) << k;
    EXPECT_EQ(summary.rounds[k].cost, expected.rounds[k].cost) << k;
  }
}

// Whether the new variable has the id of a removed one is nothing to go by: held by a suspect alone
// it has no place without it.
TEST(LivingGnc, AVariableWithARemovedOnesIdIsNew) {
  std::vector<GncSummary> summaries;
  for (const bool takes_id : {false, true}) {
    LivingWorld living(PoseGraphWorld(2, 30, 10, 0, 0.01, 4));
    for (int i = 0; i < 30; ++i) {
      living.AddPose(i);
    }
    if (takes_id) {
      GraphEdit removal(living.solver_.graph());
      removal.RemoveVariable(29);
      ASSERT_TRUE(living.solver_.Apply(removal).ok());
      for (const auto& [edge, factor] : living.edges_) {
        living.gnc_.Forget(
            living.solver_.graph().HasFactor(factor.family, factor.index) ? FactorId() : factor);
      }
      ASSERT_TRUE(living.gnc_.Update().IsSolutionUsable());
    }
    GraphEdit edit(living.solver_.graph());
    const double start[3] = {50.0, -20.0, 1.0};
    const VariableId added = edit.AddVariable(start, 3, Role::kFrame);
    ASSERT_EQ(added, takes_id ? 29 : 30);
    PoseGraphEdge edge = living.world_.truth.edges[0];
    edge.from = 15;
    edge.to = added;
    const FactorId suspect = living.AddEdge(edge, nullptr, &edit);
    ASSERT_TRUE(living.solver_.Apply(edit).ok());
    living.gnc_.Watch(suspect);
    summaries.push_back(living.gnc_.Update());
    EXPECT_EQ(summaries.back().termination, Termination::kConvergence);
    EXPECT_TRUE(summaries.back().verdicts.back().inlier);
  }
  EXPECT_EQ(summaries[1].rounds.size(), summaries[0].rounds.size());
}

TEST(LivingGnc, NamesASuspectThatIsGoneUntilItIsForgotten) {
  LivingWorld living(PoseGraphWorld(2, 60, 20, 0, 0.01, 4));
  for (int i = 0; i < 60; ++i) {
    living.AddPose(i);
  }
  const FactorId gone = living.edges_.back().second;
  GraphEdit edit(living.solver_.graph());
  edit.RemoveFactor(gone);
  ASSERT_TRUE(living.solver_.Apply(edit).ok());
  const GncSummary refused = living.gnc_.Update();
  EXPECT_EQ(refused.termination, Termination::kFailure);
  EXPECT_NE(refused.message.find("is not in the graph"), std::string::npos) << refused.message;
  living.gnc_.Forget(gone);
  EXPECT_TRUE(living.gnc_.Update().IsSolutionUsable());
}

TEST(LivingGnc, TellsWhatIsWrongWithTheOptions) {
  IncrementalSolver solver{IncrementalOptions()};
  GncOptions options;
  options.step = 0.5;
  LivingGnc gnc(options, &solver);
  const GncSummary summary = gnc.Update();
  EXPECT_EQ(summary.termination, Termination::kFailure);
  EXPECT_NE(summary.message.find("step"), std::string::npos);
}

}  // namespace
}  // namespace inceres
