#pragma once

#include <string>
#include <vector>

#include "inceres/problem/factor_graph.h"
#include "inceres/problem/graph_edit.h"
#include "problem/edited_graph.h"
#include "problem/find_fault.h"

namespace inceres::internal {

/// An edit against its graph. It is drawn into marks on the variables and places it concerns: each
/// is then seen as it would be afterwards, while the graph is as it was. The destructor wipes the
/// marks.
class EditCheck {
 public:
  EditCheck(const EditedGraph& edited, const GraphEdit& edit, std::vector<FactorId>* removed)
      : edited_(edited), graph_(*edited.graph), edit_(edit), removed_(*removed) {}
  ~EditCheck();
  EditCheck(const EditCheck&) = delete;
  EditCheck& operator=(const EditCheck&) = delete;

  /// Draws the marks, then looks at the rules, one kind of wish after the other, in the order of
  /// the edit: the first one that is broken is told. Lists the factors that go.
  Status Check();

  /// A variable as the edit leaves it.
  Sight See(VariableId id) const;

 private:
  // Draws all of the edit, and lists the factors that go, those of removed variables included.
  // Finds what can be seen to be wrong meanwhile: ids that are not there, or go twice.
  Status Draw();
  void MarkComers();
  Status MarkGoingFactors();
  Status MarkGoingVariables();
  void MarkCascade();
  Status MarkConstants();
  VariableMark& mark(VariableId id) const { return edited_.scratch->marks[IndexOf(id)]; }
  // A place as the edit leaves it.
  PlaceState PlaceOf(FactorId id) const { return edited_.factors->PlaceOf(id); }
  // Whether the edit sets free a variable of the graph; true once for each.
  bool IsFreed(VariableId id);

  // Whether an id that `call` was given is there. `may_come`: it may be one that the edit adds.
  Status CheckVariableId(const char* call, VariableId id, bool may_come) const;
  Status CheckFactorId(const char* call, FactorId id, bool may_come) const;
  std::string FactorName(FactorId id) const;

  Status CheckComingVariables();
  Status CheckComingFactors();
  Status CheckFreedVariables();
  Status CheckFactorSettings();
  Status CheckNewValues();
  Status CheckPins();
  Status CheckBounds();
  Status CheckGroups();
  Status CheckFactor(FactorId id, const VariableId* ids) const;
  Status CheckFreedFactors(VariableId id) const;

  const EditedGraph edited_;
  const FactorGraph& graph_;
  const GraphEdit& edit_;
  std::vector<FactorId>& removed_;
};

/// What the rule says of the first in the list that breaks it.
template <typename List, typename Rule>
Status CheckEach(const List& list, const Rule& rule) {
  for (const auto& each : list) {
    Status status = rule(each);
    if (!status.ok()) {
      return status;
    }
  }
  return Status::Ok();
}

/// Room for all that Commit does of an edit that keeps the rules, and what it would have to make.
void PrepareCommit(const EditedGraph& graph, const GraphEdit& edit,
                   const std::vector<FactorId>& removed, const EditCheck& check);

}  // namespace inceres::internal
