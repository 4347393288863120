#pragma once

#include <cstdint>
#include <functional>
#include <map>
#include <memory>
#include <utility>
#include <vector>

#include "inceres/export.h"
#include "inceres/problem/factor_graph.h"

namespace inceres {

/// A transaction on a living FactorGraph: collects changes, which FactorGraph::Apply (or
/// IncrementalSolver::Apply) carries out all together or, if anything is wrong with them, not at
/// all. Ids are given out at once, so later calls of the same edit can use them; they belong to the
/// graph only after Apply. One edit at a time: an edit begun before another one was applied is
/// refused.
///
/// Order within an edit: measurements are set, factors go, variables go, variables and factors
/// come, then losses, constants, values, pins, bounds and groups are set. So room that this edit
/// frees is used by the next one.
///
/// Threads: one writer. Nothing here touches the graph, but AddFactor writes the measurement into
/// the family at once, at a place no factor uses.
class INCERES_EXPORT GraphEdit {
 public:
  /// Begins an edit of this graph, which must outlive it and stay where it is.
  explicit GraphEdit(const FactorGraph& graph);
  /// Forgets everything and begins anew on the graph as it is now; memory is kept.
  void Restart();

  /// As FactorGraph::AddVariable. An id of a removed variable of the same ambient size is used
  /// again.
  VariableId AddVariable(const double* values, int ambient_size, Role role,
                         std::shared_ptr<const Manifold> manifold = nullptr);
  /// As FactorGraph::AddBorrowedConstant.
  VariableId AddBorrowedConstant(const double* values, int ambient_size);
  /// Removes the variable and, like Ceres, every factor that touches it.
  void RemoveVariable(VariableId id) { removed_variables_.push_back(id); }

  /// Connects a factor whose measurement the caller puts into the family, at the index returned,
  /// before Apply. `variables` has family.num_slots() entries.
  FactorId Connect(FamilyId family, const VariableId* variables,
                   std::shared_ptr<const Loss> loss = nullptr);
  /// The same, and places the measurement: edit.AddFactor(reprojections, {x, y}, {camera, point},
  /// loss). If the handle is not of a family of this graph, the factor's index is −1, and the edit
  /// is refused. (A family of your own needs a Measurement and Place(index, measurement), which
  /// overwrites, or at index == size() appends.)
  template <typename Family>
  FactorId AddFactor(const FamilyHandle<Family>& handle,
                     const typename Family::Measurement& measurement,
                     const std::vector<VariableId>& variables,
                     std::shared_ptr<const Loss> loss = nullptr) {
    const FamilyId id = handle.id;
    if (!Knows("AddFactor", id, handle.family.get())) {
      return {id, -1, -1};
    }
    const FactorId factor = Connect(id, variables.data(), variables.size(), std::move(loss));
    handle->Place(factor.index, measurement);
    return factor;
  }
  /// Removes the factor. Its measurement stays in the family, unused, until the place is given to
  /// another one.
  void RemoveFactor(FactorId id) { removed_factors_.push_back(id); }

  /// Replaces the factor's loss; null: ½‖f‖².
  void SetLoss(FactorId id, std::shared_ptr<const Loss> loss) {
    losses_.emplace_back(id, std::move(loss));
  }
  /// Replaces the measurement of a factor, which is one of the handle's family, when the edit is
  /// applied.
  template <typename Family>
  void SetMeasurement(FactorId id, const FamilyHandle<Family>& handle,
                      const typename Family::Measurement& measurement) {
    if (Knows("SetMeasurement", id.family, handle.family.get())) {
      measurements_.emplace_back(
          id, [handle, measurement, id] { handle->Place(id.index, measurement); });
    }
  }
  /// Tells that the caller has changed, in his own family, what the factor measures.
  void MeasurementChanged(FactorId id) { measurements_.emplace_back(id, nullptr); }
  /// Thousands of these per edit are cheap: a constant is a mask over the system, its factors are
  /// not evaluated again.
  void SetConstant(VariableId id, bool constant) { constants_.emplace_back(id, constant); }
  /// New values for a variable the graph owns; its factors are linearized anew.
  void SetValues(VariableId id, const double* values);
  /// As FactorGraph::PinLinearization; the variable's factors are linearized anew. A null pointer
  /// lets go of it.
  void PinLinearization(VariableId id, const double* values);
  /// As FactorGraph::SetBounds: ambient size each, copied; a null pointer means none on that side,
  /// both lift them. Lower bounds must lie below upper ones. An IncrementalSolver moves values that
  /// are outside to the nearest bound, unless they are constant, and takes bounds of values in Rⁿ
  /// only: without a manifold, or with an EuclideanManifold or a SubsetManifold.
  void SetBounds(VariableId id, const double* lower, const double* upper);
  /// As FactorGraph::SetEliminationGroup. An IncrementalSolver orders that part of the factor anew
  /// which knows the frame: cheap for one that has just come. A group below 0 is refused.
  void SetEliminationGroup(VariableId id, int group) { groups_.emplace_back(id, group); }

  /// Whether nothing has been asked for since it began.
  bool empty() const;
  /// What is wrong with a handle, or an id, that a call was given: the edit is refused for it.
  const Status& misuse() const { return misuse_; }

  /// A variable that the edit adds. This and what follows is what Apply reads.
  struct NewVariable {
    VariableId id;                             ///< given out by AddVariable
    int ambient_size;                          ///< doubles that store it
    std::size_t values;                        ///< offset into values(), unless borrowed
    const double* borrowed;                    ///< where a borrowed constant lies
    bool is_borrowed;                          ///< whether its values stay where they are
    bool has_values;                           ///< false: the caller passed null
    Role role;                                 ///< what the solver does with it
    std::shared_ptr<const Manifold> manifold;  ///< null: Euclidean
  };
  /// A factor that the edit adds.
  struct NewFactor {
    FactorId id;                       ///< index -1 if there is no such family
    std::size_t variables;             ///< offset into factor_variables()
    std::size_t num_variables;         ///< given by the caller
    std::shared_ptr<const Loss> loss;  ///< null: ½‖f‖²
  };
  /// Bounds to set: offsets into values(), kNoValues where there is none on that side or the id is
  /// not there.
  struct NewBounds {
    VariableId id;      ///< the variable
    std::size_t lower;  ///< offset of its lower bounds
    std::size_t upper;  ///< offset of its upper bounds
  };
  /// In the order of the calls; so are all lists below.
  const std::vector<NewVariable>& new_variables() const { return new_variables_; }
  /// Factors to come.
  const std::vector<NewFactor>& new_factors() const { return new_factors_; }
  /// What NewFactor::variables points into.
  const std::vector<VariableId>& factor_variables() const { return factor_variables_; }
  /// What all offsets to values point into.
  const std::vector<double>& values() const { return values_; }
  /// Variables to go.
  const std::vector<VariableId>& removed_variables() const { return removed_variables_; }
  /// Factors to go by themselves; those of removed variables are not listed.
  const std::vector<FactorId>& removed_factors() const { return removed_factors_; }
  /// Losses to set.
  const std::vector<std::pair<FactorId, std::shared_ptr<const Loss>>>& losses() const {
    return losses_;
  }
  /// Measurements that change, with what places them; null: the caller has done so.
  const std::vector<std::pair<FactorId, std::function<void()>>>& measurements() const {
    return measurements_;
  }
  /// Variables to hold or to set free.
  const std::vector<std::pair<VariableId, bool>>& constants() const { return constants_; }
  /// Offsets into values(), kNoValues where the caller passed null or an id that is not there.
  const std::vector<std::pair<VariableId, std::size_t>>& new_values() const { return new_values_; }
  /// The same; kNoValues lets go.
  const std::vector<std::pair<VariableId, std::size_t>>& pins() const { return pins_; }
  /// Bounds to set or to lift.
  const std::vector<NewBounds>& bounds() const { return bounds_; }
  /// Groups to put variables into.
  const std::vector<std::pair<VariableId, int>>& elimination_groups() const { return groups_; }
  /// an offset that points to no values
  static constexpr std::size_t kNoValues = static_cast<std::size_t>(-1);
  /// The graph it was begun on.
  const FactorGraph& graph() const { return *graph_; }
  /// The graph's revision when the edit began.
  std::int64_t revision() const { return revision_; }

 private:
  // Whether the graph has the family under this id; misuse_ says it if not.
  bool Knows(const char* call, FamilyId id, const FactorFamily* given);
  VariableId NextVariable(int ambient_size, bool borrowed);
  std::int32_t NextPlace(FamilyId family);
  FactorId Connect(FamilyId family, const VariableId* variables, std::size_t num_variables,
                   std::shared_ptr<const Loss> loss);
  int AmbientSize(VariableId id) const;
  std::size_t Store(VariableId id, const double* values);

  const FactorGraph* graph_;
  std::int64_t revision_;
  Status misuse_;
  int num_appended_variables_ = 0;
  // by ambient size and whether borrowed: taken from the free ids
  std::map<std::pair<int, bool>, int> reused_variables_;
  // by family: taken from the free places, appended
  std::map<FamilyId, std::pair<int, int>> places_;
  std::vector<NewVariable> new_variables_;
  std::vector<NewFactor> new_factors_;
  std::vector<VariableId> factor_variables_;
  std::vector<double> values_;
  std::vector<VariableId> removed_variables_;
  std::vector<FactorId> removed_factors_;
  std::vector<std::pair<FactorId, std::shared_ptr<const Loss>>> losses_;
  std::vector<std::pair<FactorId, std::function<void()>>> measurements_;
  std::vector<std::pair<VariableId, bool>> constants_;
  std::vector<std::pair<VariableId, std::size_t>> new_values_;
  std::vector<std::pair<VariableId, std::size_t>> pins_;
  std::vector<NewBounds> bounds_;
  std::vector<std::pair<VariableId, int>> groups_;
};

}  // namespace inceres
