// Frames of a living problem in groups: the factor keeps to them whatever is edited, and an Update
// ends where it would have ended.
#include <algorithm>
#include <map>
#include <set>
#include <string>
#include <vector>

#include <gtest/gtest.h>

#include "inceres/solver/incremental_solver.h"
#include "incremental/incremental_bundle.h"
#include "linear/group_pairs.h"

namespace inceres::test {
namespace {

IncrementalOptions Options(ReducedSolverKind kind) {
  IncrementalOptions options;
  options.batch_share = 2.0;
  options.reduced_solver = kind;
  return options;
}

// By rows of S. A frame that is not in the order, for one, is misplaced.
int CountMisplacedFrames(const IncrementalSolver& solver) {
  const ReducedStructure structure = solver.Structure();
  std::map<VariableId, int> row_of;
  std::vector<int> groups;
  for (std::size_t row = 0; row < structure.frames.size(); ++row) {
    const VariableId id = structure.frames[row];
    groups.push_back(id < 0 ? 0 : solver.graph().elimination_group(id));
    row_of[id] = static_cast<int>(row);
  }
  row_of.erase(-1);
  std::vector<std::set<int>> neighbors(structure.frames.size());
  for (const ReducedStructure::Block& block : structure.blocks) {
    neighbors[static_cast<std::size_t>(block.row)].insert(block.column);
    neighbors[static_cast<std::size_t>(block.column)].insert(block.row);
  }
  std::vector<int> order;
  for (const VariableId id : structure.elimination_order) {
    order.push_back(row_of.at(id));
  }
  return internal::CountMisplaced(order, neighbors, groups) +
         static_cast<int>(row_of.size() - order.size());
}

// One change, of which every third is of a group alone.
void EditSomething(IncrementalBundle* bundle) {
  Random& random = bundle->random();
  const auto frame = [&] {
    const std::vector<VariableId>& frames = bundle->frames();
    return frames[static_cast<std::size_t>(random.Below(static_cast<int>(frames.size())))];
  };
  switch (random.Below(6)) {
    case 0:
      bundle->Grow(1, 2, 3);
      bundle->edit().SetEliminationGroup(bundle->frames().back(), random.Below(3));
      break;
    case 1:
      bundle->edit().SetEliminationGroup(bundle->AddFrame(), random.Below(3));
      break;
    case 2:
      bundle->AddLandmark({bundle->frames().front(), bundle->frames().back()});
      break;
    case 3:
      bundle->RemoveVariable(bundle->landmarks().front());
      break;
    default:
      bundle->edit().SetEliminationGroup(frame(), random.Below(3));
  }
  bundle->ChangeMeasurement(bundle->Views().back());
  bundle->Apply();
}

class GroupedUpdates : public testing::TestWithParam<ReducedSolverKind> {};

TEST_P(GroupedUpdates, KeepToTheOrderAndEndAtTheOptimum) {
  for (unsigned seed = 1; seed <= 4; ++seed) {
    IncrementalBundle bundle(Options(GetParam()), seed);
    bundle.Grow(8, 20, 3);
    for (const VariableId id : bundle.frames()) {
      bundle.edit().SetEliminationGroup(id, bundle.random().Below(3));
    }
    bundle.Apply();
    for (int round = 0; round < 12; ++round) {
      const UpdateSummary summary = bundle.solver.Update();
      ASSERT_EQ(summary.termination, Termination::kConvergence) << summary.message;
      if (summary.num_factored_rows > 0) {
        ASSERT_EQ(CountMisplacedFrames(bundle.solver), 0) << "seed " << seed << ", " << round;
      }
      ASSERT_LE(summary.final_cost,
                bundle.FreshMinimum(Options(GetParam()), /*from_values_held=*/true) * (1.0 + 2e-6))
          << "seed " << seed << ", round " << round;
      EditSomething(&bundle);
    }
  }
}

INSTANTIATE_TEST_SUITE_P(Kinds, GroupedUpdates,
                         testing::Values(ReducedSolverKind::kAutomatic, ReducedSolverKind::kResumed,
                                         ReducedSolverKind::kDense, ReducedSolverKind::kSparse));

// The last one comes last, whatever else is new: what its covariance needs of the factor is its
// end.
TEST(GroupedUpdate, AFrameOfTheHighestGroupStaysAtTheEnd) {
  IncrementalBundle bundle(Options(ReducedSolverKind::kAutomatic), 3);
  bundle.Grow(6, 14, 3);
  const VariableId camera = bundle.frames()[1];
  bundle.edit().SetEliminationGroup(camera, 9);
  bundle.Apply();
  bundle.solver.Update();
  for (int round = 0; round < 5; ++round) {
    bundle.Grow(1, 3, 3);
    bundle.solver.Update();
    const std::vector<VariableId> order = bundle.solver.Structure().elimination_order;
    ASSERT_FALSE(order.empty());
    EXPECT_EQ(order.back(), camera);
  }
}

TEST(GroupedUpdate, BelowZeroAndWhatIsNotThereAreRefusedByName) {
  IncrementalBundle bundle(Options(ReducedSolverKind::kAutomatic), 3);
  bundle.Grow(3, 4, 3);
  const auto refusal = [&bundle](VariableId id, int group) {
    GraphEdit edit(bundle.solver.graph());
    edit.SetEliminationGroup(id, group);
    return bundle.solver.Apply(edit).message;
  };
  const VariableId frame = bundle.frames().front();
  EXPECT_EQ(refusal(frame, -1), "SetEliminationGroup: variable " + std::to_string(frame) +
                                    " is given the group -1; groups are 0 or above");
  EXPECT_NE(refusal(4711, 1).find("variable 4711 does not exist"), std::string::npos);
  EXPECT_EQ(refusal(frame, 1), "");
}

}  // namespace
}  // namespace inceres::test
