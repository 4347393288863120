#pragma once

#include <memory>
#include <string>
#include <vector>

#include <gtest/gtest.h>

#include "inceres/problem/graph_edit.h"
#include "inceres/problem/losses.h"
#include "problem/blank_family.h"
#include "problem/graph_dump.h"

namespace inceres {

// A graph that is in order, for tests of what is refused. Variables 0 (frame, 2 values), 1 to 3
// (landmarks, 3 values, the last constant), 4 (borrowed, 2 values). Views: factors 0 to 2 between
// the frame and each landmark. Pairs: factor 0 between 1 and 3. Of the other families none.
struct GraphToBreak {
  using Slots = std::vector<FactorFamily::Slot>;

  GraphToBreak() {
    graph.AddVariable(kValues, 2, Role::kFrame);
    for (int l = 0; l < 3; ++l) {
      graph.AddFactor(views, {}, {0, graph.AddVariable(kValues, 3, Role::kLandmark)});
    }
    graph.AddBorrowedConstant(kValues, 2);
    graph.SetConstant(3, true);
    graph.AddFactor(pairs, {}, {1, 3}, std::make_shared<HuberLoss>(1.0));
  }

  FamilyHandle<BlankFamily> Add(Slots slots) {
    return graph.AddFamily(std::make_shared<BlankFamily>(1, std::move(slots)));
  }

  static constexpr double kValues[9] = {1.0, 2.0, 3.0, 4.0, 5.0, 6.0, 7.0, 8.0, 9.0};
  FactorGraph graph;
  const FamilyHandle<BlankFamily> views = Add({{2, 2}, {3, 3}});
  const FamilyHandle<BlankFamily> pairs = Add({{3, 3}, {3, 3}});
  const FamilyHandle<BlankFamily> triples = Add({{2, 2}, {3, 3}, {2, 2}});
  const FamilyHandle<BlankFamily> turns = Add({{4, 3}, {4, 3}});
};

inline void ExpectInvalid(const Status& status, const std::string& expected) {
  EXPECT_EQ(status.code, StatusCode::kInvalidArgument);
  EXPECT_NE(status.message.find(expected), std::string::npos)
      << "message: " << status.message << "\nexpected: " << expected;
}

// Anything still marked as going or constant would get in the way of an edit that concerns
// everything.
inline void ExpectNoMarksLeft(FactorGraph* graph) {
  const std::string before = Dump(*graph);
  GraphEdit all(*graph);
  for (VariableId id = 0; id < graph->num_variables(); ++id) {
    if (graph->HasVariable(id) && graph->IsConstant(id) && graph->StateOffset(id) >= 0) {
      all.SetConstant(id, false);
    } else if (graph->HasVariable(id)) {
      all.RemoveVariable(id);
    }
  }
  std::vector<FactorId> removed;
  const Status status = graph->Check(all, &removed);
  EXPECT_TRUE(status.ok()) << status.message;
  EXPECT_EQ(static_cast<int>(removed.size()), graph->num_factors());
  EXPECT_EQ(Dump(*graph), before);
}

inline void ExpectRefused(FactorGraph* graph, const GraphEdit& edit, const std::string& expected) {
  const std::string before = Dump(*graph);
  std::vector<FactorId> removed = {{0, 0}};
  ExpectInvalid(graph->Check(edit, &removed), expected);
  EXPECT_TRUE(removed.empty());
  EXPECT_FALSE(graph->Apply(edit).ok());
  EXPECT_EQ(Dump(*graph), before) << expected;
  EXPECT_TRUE(graph->Validate().ok());
  ExpectNoMarksLeft(graph);
}

}  // namespace inceres
