// Groups of a living problem's frames. (That the factor keeps to them, whatever is edited:
// RandomEdits.)
#include <string>
#include <vector>

#include <gtest/gtest.h>

#include "inceres/solver/incremental_solver.h"
#include "incremental/incremental_bundle.h"

namespace inceres::test {
namespace {

// The last one comes last, whatever else is new: what its covariance needs of the factor is its
// end.
TEST(GroupedUpdate, AFrameOfTheHighestGroupStaysAtTheEnd) {
  IncrementalOptions options;
  options.batch_share = 2.0;
  IncrementalBundle bundle(options, 3);
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
  IncrementalBundle bundle(IncrementalOptions(), 3);
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
