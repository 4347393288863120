// Whatever is edited, an Update ends at the minimum that a batch solve finds, and a solver that
// never knew what was there before: with any options and any solver of the reduced system, under
// losses, within bounds, and with frames in groups, whose order the factor keeps.

#include <algorithm>
#include <cmath>
#include <map>
#include <memory>
#include <set>
#include <string>
#include <vector>

#include <gtest/gtest.h>

#include "inceres/problem/losses.h"
#include "incremental/incremental_bundle.h"
#include "linear/eigen_ldlt_solver.h"
#include "linear/group_pairs.h"
#include "support/dense_oracle.h"

namespace inceres::test {
namespace {

using EditKinds = std::vector<EditKind>;

EditKinds operator+(EditKinds kinds, const EditKinds& more) {
  kinds.insert(kinds.end(), more.begin(), more.end());
  return kinds;
}

// After kinds of the last, some landmarks are seen too little to be determined.
const EditKinds kAdding{EditKind::kGrow, EditKind::kMeasurements, EditKind::kValues,
                        EditKind::kConstants};
const EditKinds kMoving =
    kAdding + EditKinds{EditKind::kLosses, EditKind::kSlide, EditKind::kRemove};
const EditKinds kAll = kMoving + EditKinds{EditKind::kViews};

struct EditsCase {
  std::string name;
  EditKinds kinds;
  IncrementalOptions options;
  std::shared_ptr<const Loss> loss = nullptr;  // of all views that come
  unsigned num_seeds = 6;
  // Whether there is one minimum. Bounds cut the basin, losses on all views make several, and to
  // landmarks that are hardly determined the way is long.
  bool from_start = false;
};

// batch_share 1: the batch solver never helps.
IncrementalOptions TightOptions(ReducedSolverKind kind = ReducedSolverKind::kAutomatic) {
  IncrementalOptions options;
  options.reduced_solver = kind;
  options.function_tolerance = 1e-9;
  options.max_num_iterations = 300;
  options.batch_share = 1.0;
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

class RandomEdits : public testing::TestWithParam<EditsCase> {
 protected:
  bool Has(EditKind kind) const {
    const EditKinds& kinds = GetParam().kinds;
    return std::find(kinds.begin(), kinds.end(), kind) != kinds.end();
  }

  void Begin(IncrementalBundle* bundle) const {
    bundle->Grow(8, 30, 3, GetParam().loss);
    if (Has(EditKind::kBounds)) {
      bundle->BoundSome(bundle->frames(), 2);
      bundle->BoundSome(bundle->landmarks(), 2);
    }
    for (std::size_t k = 0; Has(EditKind::kGroups) && k < bundle->frames().size(); ++k) {
      bundle->edit().SetEliminationGroup(bundle->frames()[k], bundle->random().Below(3));
    }
    bundle->Apply();
  }

  void ExpectMinimum(IncrementalBundle* bundle, UpdateSummary* summary) const {
    const FactorGraph before = bundle->Graph();
    *summary = bundle->solver.Update();
    ASSERT_EQ(summary->termination, Termination::kConvergence) << summary->message;
    ASSERT_NEAR(summary->initial_cost, CostAt(before, before.state()),
                1e-9 * summary->initial_cost);
    ASSERT_EQ(bundle->solver.graph().num_factors(), bundle->num_factors());
    ASSERT_EQ(summary->final_cost, bundle->solver.cost());
    const double minimum = bundle->SolveInBatch(/*from_values_held=*/true).final_cost;
    ASSERT_LE(summary->final_cost - minimum, 1e-6 * minimum);
    const double fresh = bundle->FreshMinimum(TightOptions(), /*from_values_held=*/true);
    ASSERT_LE(summary->final_cost - fresh, 1e-6 * fresh);
    if (GetParam().from_start) {
      ASSERT_NEAR(bundle->SolveInBatch(/*from_values_held=*/false).final_cost, minimum,
                  1e-6 * minimum);
      ASSERT_NEAR(bundle->FreshMinimum(TightOptions()), minimum, 1e-6 * minimum);
    }
  }
};

TEST_P(RandomEdits, EndAtTheMinimum) {
  constexpr int kRounds = 25;
  for (unsigned seed = 1; seed <= GetParam().num_seeds; ++seed) {
    IncrementalBundle bundle(GetParam().options, seed);
    Begin(&bundle);
    int num_pcg_iterations = 0;
    int most_on_bounds = 0;
    int num_changed = 0;
    double cost = 0.0;
    for (int round = 0; round < kRounds; ++round) {
      SCOPED_TRACE("seed " + std::to_string(seed) + ", round " + std::to_string(round));
      UpdateSummary summary;
      ASSERT_NO_FATAL_FAILURE(ExpectMinimum(&bundle, &summary));
      num_pcg_iterations += summary.num_pcg_iterations;
      most_on_bounds = std::max(most_on_bounds, CountOnBounds(bundle.Graph()));
      num_changed += std::fabs(summary.final_cost - cost) > 1e-3 * cost ? 1 : 0;
      cost = summary.final_cost;
      if (Has(EditKind::kGroups) && summary.num_factored_rows > 0) {
        ASSERT_EQ(CountMisplacedFrames(bundle.solver), 0);
      }
      bundle.EditAtRandom(GetParam().kinds, GetParam().loss);
    }
    EXPECT_EQ(num_pcg_iterations > 0, GetParam().options.reduced_solver == ReducedSolverKind::kPcg);
    EXPECT_EQ(most_on_bounds > 3, Has(EditKind::kBounds));
    EXPECT_GT(num_changed, kRounds / 4);
  }
}

EditsCase Robust(const char* name, void (*set)(IncrementalOptions*),
                 const EditKinds& kinds = kAll) {
  IncrementalOptions options = TightOptions();
  set(&options);
  return {name, kinds, options, std::make_shared<HuberLoss>(0.2)};
}
EditsCase Pinned(const char* name, ReducedSolverKind kind,
                 const ReducedSolverFactory& factory = nullptr) {
  IncrementalOptions options = TightOptions(kind);
  options.reduced_solver_factory = factory;
  return {name, kAll + EditKinds(2, EditKind::kPin), options};
}
EditsCase Grouped(const char* name, ReducedSolverKind kind) {
  return {name, kAll + EditKinds(3, EditKind::kGroups), TightOptions(kind)};
}
EditsCase Bounded() {
  IncrementalOptions options;  // with the tolerance that is the default
  options.batch_share = 2.0;
  return {"Bounded", kMoving + EditKinds(3, EditKind::kBounds), options, nullptr, 12};
}
EditsCase FromTheStart() {
  const EditKinds kinds = kAdding + EditKinds{EditKind::kLosses, EditKind::kPin};
  return {"FromTheStart", kinds, TightOptions(), nullptr, 12, true};
}

using Options = IncrementalOptions;
using Kind = ReducedSolverKind;

INSTANTIATE_TEST_SUITE_P(
    Cases, RandomEdits,
    testing::Values(
        FromTheStart(), Bounded(),
        // Neither gets far with landmarks that are hardly determined.
        Robust(
            "ThesisDamping", [](Options* o) { o->damping = DampingForm::kThesis; }, kAdding),
        Robust(
            "NoLandmarkPasses", [](Options* o) { o->max_landmark_refinements = 0; }, kAdding),
        Robust("StepSizeRule",
               [](Options* o) { o->relinearization = RelinearizationRule::kStepSize; }),
        Robust("NoNewFrameSteps", [](Options* o) { o->max_new_frame_steps = 0; }),
        Robust("NothingTruncated", [](Options* o) { o->truncation_share = 0.0; }),
        Robust("AlwaysRebuilt", [](Options* o) { o->rebuild = RebuildPolicy::kAlways; }),
        Robust("NeverRebuilt", [](Options* o) { o->rebuild = RebuildPolicy::kNever; }),
        Pinned("Automatic", Kind::kAutomatic), Pinned("Resumed", Kind::kResumed),
        Pinned("Dense", Kind::kDense), Pinned("Sparse", Kind::kSparse), Pinned("Pcg", Kind::kPcg),
        Pinned("Own", Kind::kAutomatic, [] { return std::make_unique<EigenLdltSolver>(); }),
        Grouped("GroupedAutomatic", Kind::kAutomatic), Grouped("GroupedResumed", Kind::kResumed),
        Grouped("GroupedDense", Kind::kDense), Grouped("GroupedSparse", Kind::kSparse)),
    [](const auto& instance) { return instance.param.name; });

}  // namespace
}  // namespace inceres::test
