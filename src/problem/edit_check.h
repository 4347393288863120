#pragma once

#include <string>
#include <vector>

#include "inceres/problem/factor_graph.h"
#include "inceres/problem/graph_edit.h"
#include "problem/edit_state.h"
#include "problem/find_fault.h"

namespace inceres::internal {

/// One check of an edit against its graph. The edit is first drawn into marks on the variables and
/// places it concerns; every rule is then looked at with the marks laid over the graph, so in the
/// state the edit would lead to. The destructor wipes the marks.
class EditCheck {
 public:
  EditCheck(FactorGraph* graph, const GraphEdit& edit, std::vector<FactorId>* removed)
      : graph_(*graph), edits_(*graph->edits_), edit_(edit), removed_(*removed) {}
  ~EditCheck();
  EditCheck(const EditCheck&) = delete;
  EditCheck& operator=(const EditCheck&) = delete;

  /// The edit must have been begun on this graph at its present revision.
  Status Run();

  /// Places the measurements that a checked edit sets, if that was not done yet: the one part of an
  /// edit that runs code of the user's, and so goes ahead of all that cannot be undone. What it
  /// throws passes through: graphs have not changed, measurements placed before it stay.
  static void PlaceMeasurements(FactorGraph* graph, const GraphEdit& edit);

 private:
  using Graph = FactorGraph;

  void MarkComers();
  Status MarkGoingFactors();
  Status MarkGoingVariables();
  void MarkCascade();
  Status MarkConstants();
  Status CheckComingVariables() const;
  Status CheckComingFactors() const;
  Status CheckFreedVariables();
  Status CheckFreedFactors(VariableId id) const;
  Status CheckFactorSettings() const;
  Status CheckNewValues() const;
  Status CheckPins() const;
  Status CheckBounds() const;
  Status CheckGroups() const;
  void ReserveVariables() const;
  void ReserveFactors() const;
  void PreparePins() const;
  void PrepareBounds() const;

  Place PlaceOf(FactorId id) const;
  Place& MutablePlace(FactorId id);
  Sight See(VariableId id) const;
  Status CheckFactor(FactorId id, const VariableId* ids) const;
  Status CheckVariableId(const char* call, VariableId id, bool may_come) const;
  Status CheckFactorId(const char* call, FactorId id, bool may_come) const;
  std::string FactorName(FactorId id) const;

  Graph& graph_;
  EditState& edits_;
  const GraphEdit& edit_;
  std::vector<FactorId>& removed_;
};

}  // namespace inceres::internal
