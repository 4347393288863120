// What Structure() says of S: on problems whose blocks and changes are known beforehand.

#include <memory>
#include <utility>
#include <vector>

#include <gtest/gtest.h>

#include "inceres/solver/incremental_solver.h"
#include "support/test_families.h"

namespace inceres {
namespace {

using test::FunctionFamily;

// x_b − x_a = 1, x_0 = 0 and, from each of its frames, landmark − x_a = 2: all linear, so nothing
// is ever linearized twice.
class Chain {
 public:
  Chain() : solver(NeverInBatch()), edit(solver.graph()) {
    ties_ = solver.AddFamily(
        test::ScalarFamily([](double a, double b) { return b - a - 1.0; }, -1.0, 1.0));
    prior_ = solver.AddFamily(test::ScalarFamily([](double x) { return x; }, 1.0));
    edit.Restart();
  }
  VariableId AddFrame() { return edit.AddVariable(&start_, 1, Role::kFrame); }
  FactorId Tie(VariableId a, VariableId b) { return edit.AddFactor(ties_, 0, {a, b}); }
  void AddPrior(VariableId frame) { edit.AddFactor(prior_, 0, {frame}); }
  void AddLandmark(const std::vector<VariableId>& frames) {
    const VariableId landmark = edit.AddVariable(&start_, 1, Role::kLandmark);
    for (const VariableId frame : frames) {
      Tie(frame, landmark);
    }
  }
  void Apply() {
    const Status status = solver.Apply(edit);
    ASSERT_TRUE(status.ok()) << status.message;
    edit.Restart();
  }
  UpdateSummary Update() {
    Apply();
    const UpdateSummary summary = solver.Update();
    EXPECT_EQ(summary.termination, Termination::kConvergence) << summary.message;
    return summary;
  }

  IncrementalSolver solver;
  GraphEdit edit;

 private:
  // An Update that the batch solver ends leaves S to the next one.
  static IncrementalOptions NeverInBatch() {
    IncrementalOptions options;
    options.batch_share = 1.0;
    return options;
  }

  const double start_ = 0.5;
  FamilyHandle<FunctionFamily> ties_;
  FamilyHandle<FunctionFamily> prior_;
};

std::vector<std::pair<int, int>> Pairs(const ReducedStructure& structure) {
  std::vector<std::pair<int, int>> pairs;
  for (const ReducedStructure::Block& block : structure.blocks) {
    pairs.emplace_back(block.row, block.column);
  }
  return pairs;
}

TEST(ReducedStructure, NamesTheBlocksAndWhatTheLastUpdateChanged) {
  using P = std::vector<std::pair<int, int>>;
  Chain chain;
  std::vector<VariableId> x;
  for (int i = 0; i < 6; ++i) {
    x.push_back(chain.AddFrame());
    if (i > 0) {
      chain.Tie(x[i - 1], x[i]);
    }
  }
  chain.AddPrior(x[0]);
  chain.AddLandmark({x[0], x[2]});
  EXPECT_TRUE(chain.solver.Structure().frames.empty()) << "nothing was applied yet";
  chain.Update();
  ReducedStructure structure = chain.solver.Structure();
  EXPECT_EQ(structure.frames, x);
  EXPECT_EQ(Pairs(structure), (P{{1, 0}, {2, 0}, {2, 1}, {3, 2}, {4, 3}, {5, 4}}));
  EXPECT_EQ(structure.changed, std::vector<bool>(6, true));

  chain.Update();  // nothing to do
  EXPECT_EQ(chain.solver.Structure().changed, std::vector<bool>(6, false));

  x.push_back(chain.AddFrame());
  chain.Tie(x[5], x[6]);
  chain.AddLandmark({x[4], x[6]});
  chain.Update();
  structure = chain.solver.Structure();
  EXPECT_EQ(structure.frames, x);
  EXPECT_EQ(Pairs(structure), (P{{1, 0}, {2, 0}, {2, 1}, {3, 2}, {4, 3}, {5, 4}, {6, 4}, {6, 5}}));
  EXPECT_EQ(structure.changed, (std::vector<bool>{false, false, false, false, true, true, true}));
}

TEST(ReducedStructure, FollowsRemovals) {
  Chain chain;
  const VariableId a = chain.AddFrame();
  const VariableId b = chain.AddFrame();
  const VariableId c = chain.AddFrame();
  const VariableId d = chain.AddFrame();
  for (const VariableId frame : {a, b, c, d}) {
    chain.AddPrior(frame);
  }
  chain.Tie(a, b);
  chain.Tie(b, c);
  chain.Tie(c, d);
  chain.Update();
  chain.edit.RemoveVariable(b);
  chain.Update();
  const ReducedStructure structure = chain.solver.Structure();
  EXPECT_EQ(structure.frames, (std::vector<VariableId>{a, -1, c, d}));
  EXPECT_EQ(Pairs(structure), (std::vector<std::pair<int, int>>{{3, 2}}));
  EXPECT_EQ(structure.changed, (std::vector<bool>{true, true, true, false}))
      << "the removal counts, though no Update ran then";
}

TEST(ReducedStructure, IsEmptyWhereTheOptionsAreNotValid) {
  IncrementalOptions options;
  options.max_num_iterations = -1;
  EXPECT_TRUE(IncrementalSolver(options).Structure().frames.empty());
}

}  // namespace
}  // namespace inceres
