#pragma once

#include <string>
#include <vector>

#include "inceres/problem/factor_graph.h"
#include "inceres/problem/graph_edit.h"
#include "problem/edit_state.h"
#include "problem/find_fault.h"

namespace inceres::internal {

/// An edit drawn into marks on the variables and places it concerns: each is then seen as it would
/// be afterwards, while the graph is as it was. The destructor wipes the marks.
class EditMarks {
 public:
  EditMarks(const EditedGraph& graph, const GraphEdit& edit, std::vector<FactorId>* removed)
      : graph_(graph), edit_(edit), removed_(*removed) {}
  ~EditMarks();
  EditMarks(const EditMarks&) = delete;
  EditMarks& operator=(const EditMarks&) = delete;

  /// Draws all of the edit, and lists the factors that go, those of removed variables included.
  /// Finds what can be seen to be wrong meanwhile: ids that are not there, or go twice.
  Status Draw();

  /// A variable, and a place, as the edit leaves them.
  Sight See(VariableId id) const;
  PlaceState PlaceOf(FactorId id) const { return graph_.factors->PlaceOf(id); }
  /// The records of the variables that come, in the order of the edit.
  const std::vector<VariableRecord>& comers() const { return graph_.scratch->comers; }
  /// Whether the edit sets free a variable of the graph; true once for each.
  bool IsFreed(VariableId id);

  /// Whether an id that `call` was given is there. `may_come`: it may be one that the edit adds.
  Status CheckVariableId(const char* call, VariableId id, bool may_come) const;
  Status CheckFactorId(const char* call, FactorId id, bool may_come) const;
  std::string FactorName(FactorId id) const;

 private:
  void MarkComers();
  Status MarkGoingFactors();
  Status MarkGoingVariables();
  void MarkCascade();
  Status MarkConstants();
  VariableMark& mark(VariableId id) const { return graph_.scratch->marks[IndexOf(id)]; }

  const EditedGraph graph_;
  const GraphEdit& edit_;
  std::vector<FactorId>& removed_;
};

/// Room for all that Commit does of an edit that keeps the rules, and what it would have to make.
void PrepareCommit(const EditedGraph& graph, const GraphEdit& edit,
                   const std::vector<FactorId>& removed, const EditMarks& marks);

}  // namespace inceres::internal
