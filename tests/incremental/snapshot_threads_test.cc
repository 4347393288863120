// Snapshots: what other threads read of a solver that goes on.
#include <atomic>
#include <thread>
#include <vector>

#include <gtest/gtest.h>

#include "incremental/incremental_bundle.h"
#include "incremental/latest_value.h"

namespace inceres {
namespace {

using test::IncrementalBundle;

IncrementalOptions Publishing() {
  IncrementalOptions options;
  options.publish_snapshots = true;
  return options;
}

TEST(Snapshot, HoldsWhatTheLastUpdateEndedWith) {
  IncrementalBundle bundle(Publishing());
  ValueSnapshot snapshot;
  EXPECT_FALSE(bundle.solver.ReadSnapshot(&snapshot));
  EXPECT_EQ(snapshot.number(), 0);
  for (int update = 1; update <= 5; ++update) {
    bundle.Grow(2, 10, 3);
    if (update == 3) {
      bundle.RemoveVariable(bundle.landmarks().front());
      bundle.Apply();
    }
    const UpdateSummary summary = bundle.solver.Update();
    ASSERT_TRUE(bundle.solver.ReadSnapshot(&snapshot));
    EXPECT_EQ(snapshot.number(), update);
    EXPECT_EQ(snapshot.cost(), summary.final_cost);
    EXPECT_EQ(snapshot.termination(), summary.termination);
    const FactorGraph& graph = bundle.solver.graph();
    ASSERT_EQ(snapshot.num_variables(), graph.num_variables());
    for (VariableId id = 0; id < graph.num_variables(); ++id) {
      if (!graph.HasVariable(id)) {
        EXPECT_EQ(snapshot.Values(id), nullptr);
        continue;
      }
      const double* held = bundle.solver.Values(id);
      for (int k = 0; k < graph.AmbientSize(id); ++k) {
        EXPECT_EQ(snapshot.Values(id)[k], held[k]);
      }
    }
    EXPECT_EQ(snapshot.Values(-1), nullptr);
    EXPECT_EQ(snapshot.Values(graph.num_variables()), nullptr);
  }
}

// A copy: later edits and Updates leave it alone.
TEST(Snapshot, StaysAsItIs) {
  IncrementalBundle bundle(Publishing());
  bundle.Grow(4, 20, 3);
  bundle.solver.Update();
  ValueSnapshot snapshot;
  ASSERT_TRUE(bundle.solver.ReadSnapshot(&snapshot));
  const double value = *snapshot.Values(0);
  const int size = snapshot.num_variables();
  bundle.Grow(4, 20, 3);
  bundle.solver.Update();
  EXPECT_EQ(*snapshot.Values(0), value);
  EXPECT_EQ(snapshot.num_variables(), size);
}

TEST(Snapshot, IsNotTakenUnlessAskedFor) {
  IncrementalOptions options;
  IncrementalBundle bundle(options);
  bundle.Grow(4, 20, 3);
  bundle.solver.Update();
  ValueSnapshot snapshot;
  EXPECT_FALSE(bundle.solver.ReadSnapshot(&snapshot));
  options.publish_snapshots = true;
  bundle.solver.SetOptions(options);
  bundle.solver.Update();
  EXPECT_TRUE(bundle.solver.ReadSnapshot(&snapshot));
}

// Readers see whole values, never older ones than before, and the last one in the end.
TEST(SnapshotThreads, ReadersOfALatestValueSeeWholeValuesInOrder) {
  constexpr int kLast = 20000;
  internal::LatestValue<std::vector<int>> latest;
  std::atomic<bool> torn{false};
  const auto read = [&] {
    std::vector<int> value;
    for (int seen = 0; seen < kLast;) {
      latest.Read([&value](const std::vector<int>& newest) { value = newest; });
      for (const int entry : value) {
        torn = torn || entry != value.front();
      }
      if (!value.empty()) {
        torn = torn || value.front() < seen;
        seen = value.front();
      }
    }
  };
  std::thread first(read), second(read);
  for (int k = 1; k <= kLast; ++k) {
    latest.Draft()->assign(50, k);
    latest.Publish();
  }
  first.join();
  second.join();
  EXPECT_FALSE(torn);
}

// While a solver is edited and updated, two threads read: each snapshot's values belong to its cost,
// and numbers never fall.
TEST(SnapshotThreads, AreConsistentWhileTheSolverWorks) {
  IncrementalBundle bundle(Publishing());
  std::atomic<bool> done{false}, wrong{false};
  std::vector<std::vector<ValueSnapshot>> seen(2);
  const auto read = [&](std::vector<ValueSnapshot>* all) {
    ValueSnapshot snapshot;
    std::int64_t number = 0;
    while (!done) {
      if (bundle.solver.ReadSnapshot(&snapshot) && snapshot.number() != number) {
        wrong = wrong || snapshot.number() < number;
        number = snapshot.number();
        all->push_back(snapshot);
      }
    }
  };
  std::thread first(read, &seen[0]), second(read, &seen[1]);
  std::vector<ValueSnapshot> written(1);
  for (int update = 1; update <= 12; ++update) {
    bundle.Grow(2, 12, 3);
    bundle.solver.Update();
    written.emplace_back();
    EXPECT_TRUE(bundle.solver.ReadSnapshot(&written.back()));
  }
  done = true;
  first.join();
  second.join();
  EXPECT_FALSE(wrong);
  for (const std::vector<ValueSnapshot>& all : seen) {
    for (const ValueSnapshot& snapshot : all) {
      const ValueSnapshot& same = written[static_cast<std::size_t>(snapshot.number())];
      EXPECT_EQ(snapshot.cost(), same.cost());
      ASSERT_EQ(snapshot.num_variables(), same.num_variables());
      for (VariableId id = 0; id < same.num_variables(); ++id) {
        EXPECT_EQ(*snapshot.Values(id), *same.Values(id));
      }
    }
  }
}

}  // namespace
}  // namespace inceres
