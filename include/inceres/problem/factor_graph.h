#pragma once

#include <algorithm>
#include <cstdint>
#include <functional>
#include <memory>
#include <string>
#include <type_traits>
#include <utility>
#include <vector>

#include "inceres/export.h"
#include "inceres/problem/factor_family.h"
#include "inceres/problem/graph_tables.h"
#include "inceres/problem/losses.h"
#include "inceres/problem/manifolds.h"
#include "inceres/status.h"

namespace inceres {

/// A family in a graph, with its type: AddFactor takes it, so that the compiler refuses a
/// measurement of another family. Converts to the family's id. Copies of the graph know it too.
template <typename Family>
struct FamilyHandle {
  /// -1, or a null family: none, which AddFactor refuses
  FamilyId id = -1;
  std::shared_ptr<Family> family;  ///< the family itself, shared with the graph

  /// The id, for calls that take one.
  operator FamilyId() const { return id; }  // NOLINT(google-explicit-constructor): it is one
  /// The family itself.
  Family& operator*() const { return *family; }
  /// The family itself.
  Family* operator->() const { return family.get(); }
};

class GraphEdit;
namespace internal {

class GraphRestorer;

// Counts the changes of a graph's structure. An assignment is one, and gives a number that neither
// graph has had: edits that were begun on what is assigned to are of another one.
class Revision {
 public:
  Revision() = default;
  Revision(const Revision& other) = default;
  Revision& operator=(const Revision& other) noexcept {
    value_ = std::max(value_, other.value_) + 1;
    return *this;
  }
  ~Revision() = default;
  Revision& operator++() {
    ++value_;
    return *this;
  }
  std::int64_t value() const { return value_; }

 private:
  std::int64_t value_ = 0;
};

template <typename Family, typename = void>
struct CanPlace : std::false_type {};
template <typename Family>
struct CanPlace<Family, std::void_t<decltype(std::declval<Family&>().Place(
                            0, std::declval<const typename Family::Measurement&>()))>>
    : std::true_type {};

/// Gives the family's factor at `index`, its next one, its measurement: where an edit that was
/// refused has left one there, in that one's place.
template <typename Family>
void AddMeasurement(Family* family, int index, const typename Family::Measurement& measurement) {
  if constexpr (CanPlace<Family>::value) {
    if (family->size() > index) {
      family->Place(index, measurement);
      return;
    }
  }
  family->Add(measurement);
}

}  // namespace internal

/// The problem  min_x ½ Σ_j ρ_j(‖f_j(x)‖²): variables on manifolds, factors grouped in families,
/// losses, constants.
///
/// The graph owns the values of its variables (one contiguous *state*) and the connections of its
/// factors. It reports nothing while it is built; Validate(), which every solve calls first, names
/// what is wrong. A call that cannot be carried out at all (no such family, fewer or more variables
/// than a factor has slots) changes nothing but what Validate() says. Ids are dense: 0, 1, 2, … in
/// order of addition.
///
/// A graph that lives on is changed by transactions (GraphEdit, graph_edit.h), which are checked as
/// a whole and can remove. Ids then have gaps: what is removed leaves its id free, with its room in
/// the state or its place in the family, for something later of the same size or family.
/// num_variables() and NumFactors() go on counting ids and places, free ones included.
///
/// A copy has its own variables and connections, but shares the families, and with them the
/// measurements: it is for reading and solving. After a copy was made add, remove or measure anew
/// factors of a family in one of the two graphs only. Whichever does so writes its measurements
/// into the family, at the place of its next factor or of one that it has removed, and the other
/// graph, which may have a factor at that place, has another measurement there without being told.
///
/// Threads: one writer; concurrent reads are fine. Graphs share nothing; copies share families.
/// Source: Dellaert & Kaess, "Factor Graphs for Robot Perception", 2017.
class INCERES_EXPORT FactorGraph {
 public:
  /// Adds a variable with ambient_size values, which are copied (they must not lie in this graph's
  /// own state). A null manifold means Euclidean. Cost: no allocation beyond the growth of two
  /// vectors.
  VariableId AddVariable(const double* values, int ambient_size, Role role,
                         std::shared_ptr<const Manifold> manifold = nullptr);

  /// Adds a constant whose values are *borrowed*: read in place at each evaluation, never written.
  /// `values` must outlive the graph's last solve. Its tangent size is 0 and it stays constant
  /// whatever SetConstant says.
  VariableId AddBorrowedConstant(const double* values, int ambient_size);

  /// Adds a family; its factors are connected with Connect, in the family's order. −1 if it is
  /// null.
  FamilyId AddFamily(std::shared_ptr<const FactorFamily> family);

  /// The same, of a family whose type is known: the handle is what AddFactor takes.
  template <typename Family>
  FamilyHandle<Family> AddFamily(std::shared_ptr<Family> family) {
    const FamilyId id = AddFamily(std::shared_ptr<const FactorFamily>(family));
    return {id, std::move(family)};
  }

  /// Connects the family's next factor to one variable per slot, with a loss (null: ½‖f‖²). Returns
  /// the factor's index in the family, or −1 if there is no such family. `variables` has
  /// family.num_slots() entries. Cost: no allocation beyond the growth of a vector; losses cost
  /// nothing while no factor of the family has one.
  int Connect(FamilyId family, const VariableId* variables,
              std::shared_ptr<const Loss> loss = nullptr);

  /// Connects several of the family's next factors at once, in less time than one after the other:
  /// num_slots variables each, and a loss each or no losses at all, else none is connected. Takes
  /// the vectors' memory over where the family has no factors yet.
  void ConnectMany(FamilyId family, std::vector<VariableId> variables,
                   std::vector<std::shared_ptr<const Loss>> losses = {});

  /// Adds the measurement to the family and connects it: graph.AddFactor(reprojections, {x, y},
  /// {camera, point}, loss). Returns the factor's index in the family; −1, and adds no measurement,
  /// if the handle is not of a family of this graph or `variables` not one for each of its slots.
  /// (A family of your own needs a Measurement and Add(measurement), which appends; and, if it
  /// serves edits, too, Place(index, measurement), for an edit that was refused or given up has
  /// left its measurement in the family.)
  template <typename Family>
  int AddFactor(const FamilyHandle<Family>& handle, const typename Family::Measurement& measurement,
                const std::vector<VariableId>& variables,
                std::shared_ptr<const Loss> loss = nullptr) {
    if (!CanAddFactor(handle.id, handle.family.get(), variables)) {
      return -1;
    }
    const FamilyId id = handle.id;
    internal::AddMeasurement(handle.family.get(), NumFactors(id), measurement);
    return Connect(id, variables.data(), std::move(loss));
  }

  /// Holds a variable where it is, or sets it free. Requires an id that exists.
  void SetConstant(VariableId id, bool constant) { variables_.SetConstant(id, constant); }
  /// Changes what the solver does with a variable. Requires an id that exists.
  void SetRole(VariableId id, Role role) { variables_.SetRole(id, role); }
  /// When the frame is eliminated from the reduced system: of two frames that its factor couples,
  /// the one of the lower group goes first, and what others' elimination does to a frame of a high
  /// group is done before its turn. All are in group 0 unless told otherwise; within a group the
  /// solver orders. What it is for: frames whose covariances are asked for, or which change with
  /// each Update, in the highest group, where the factor ends; frames that one knows to separate a
  /// problem above what they separate. A group each is a complete order. The result is the same up
  /// to rounding; a bad order costs fill.
  ///
  /// Honored by the Cholesky factors, dense or sparse, of batch and incremental solves. Landmarks
  /// go before all frames: their group counts only where they are treated as frames. Validate()
  /// refuses a group below 0. Source: constrained AMD (Amestoy, Davis & Duff, ACM TOMS 30(3),
  /// 2004); Ceres's ParameterBlockOrdering, GTSAM's constrained keys.
  void SetEliminationGroup(VariableId id, int group) { variables_.SetGroup(id, group); }
  /// Keeps the variable's values within bounds of ambient size each, which are copied; null means
  /// none on that side, and both null lift them. The batch Solve honors them: it projects the
  /// start, and every point it tries is x ⊞ δ clamped entry by entry, so the values of a variable
  /// with a manifold stay within their bounds but may leave the manifold, as in Ceres. They go with
  /// the variable when an edit removes it. Validate() refuses a lower bound that is not below its
  /// upper, and a constant outside its bounds. Cost: one node of a map for a bounded variable.
  void SetBounds(VariableId id, const double* lower, const double* upper) {
    variables_.SetBounds(id, lower, upper);
  }
  /// First-estimate Jacobians: from now on factors are linearized with this variable at these
  /// values (ambient size, copied) and the others where they are or are pinned; residuals and costs
  /// stay those of the current values. Null lets go of it. What it is for: a variable that a
  /// marginalization prior holds is linearized in one point only, so that no information appears
  /// along directions that nothing measured. A pinned variable costs its factors a second,
  /// cost-only evaluation a linearization. Its tangent coordinates at both points must mean the
  /// same, as in vector spaces and groups; those of a SphereManifold do not. Source: Huang,
  /// Mourikis & Roumeliotis, "A first-estimates Jacobian EKF for improving SLAM consistency", 2008.
  void PinLinearization(VariableId id, const double* values) { variables_.Pin(id, values); }
  /// Null means ½‖f‖².
  void SetLoss(FamilyId family, int factor, std::shared_ptr<const Loss> loss) {
    factors_.SetLoss(family, factor, std::move(loss));
  }
  /// Overwrites the values of a variable the graph owns; borrowed values are their owner's to
  /// change, so those are left alone.
  void SetValues(VariableId id, const double* values) { variables_.SetValues(id, values); }
  /// Memory for so many variables, of so many values together.
  void Reserve(int num_variables, int num_values) { variables_.Reserve(num_variables, num_values); }

  /// Carries out an edit begun on this graph: Check, then Commit. On an error, which names the id
  /// at fault, nothing has changed. Cost: proportional to the edit and the degrees of the variables
  /// it removes or frees; the first such edit makes one pass over the factors (TrackFactors).
  Status Apply(const GraphEdit& edit);
  /// The first half of Apply, for a caller with caches: says whether the edit can be carried out,
  /// and which factors it removes, those that go with their variables included, each once. Changes
  /// nothing that can be seen, but it reserves what Commit needs; so it counts as writing. In the
  /// steady state it allocates nothing, but for factors of more than 256 slots. `removed` is empty
  /// after an error.
  Status Check(const GraphEdit& edit, std::vector<FactorId>* removed);
  /// The second half: carries out an edit that Check has passed, with the factors it named, on the
  /// graph as it was then. Cannot fail and allocates nothing, but for PlaceMeasurements, with which
  /// it begins: what a family throws there leaves the graph unchanged.
  void Commit(const GraphEdit& edit, const std::vector<FactorId>& removed);
  /// Places the measurements that the edit which Check has passed last sets, once: the one part of
  /// an edit that runs code of the user's, for a caller who does what cannot be undone before he
  /// calls Commit. What it throws passes through; measurements placed before it stay.
  void PlaceMeasurements(const GraphEdit& edit);

  /// Grows with every change of structure (AddVariable, AddFamily, Connect, Apply, an assignment):
  /// an edit begun at another one is refused.
  std::int64_t revision() const { return revision_.value(); }

  /// Keeps from now on a list of each variable's factors: two links a slot. One pass over the
  /// factors; later calls cost nothing.
  void TrackFactors() { factors_.KeepLists(num_variables()); }
  /// Whether the lists are kept and complete: a factor that named a variable before it was added is
  /// in none until TrackFactors is called again.
  bool TracksFactors() const { return factors_.lists().kept() && !factors_.lists().has_gaps(); }
  /// Calls f(FactorId) for every factor that touches the variable, the last connected first. Needs
  /// TrackFactors() before it.
  template <typename F>
  void ForEachFactorOf(VariableId id, F&& f) const {
    for (auto touch = factors_.lists().First(id); touch.family >= 0;) {
      const auto next = factors_.lists().Next(touch);
      f(FactorId{touch.family, touch.entry / family(touch.family).num_slots()});
      touch = next;
    }
  }

  /// Ids given out, those of removed variables included.
  int num_variables() const { return variables_.size(); }
  /// Variables that are not removed.
  int num_live_variables() const { return num_variables() - variables_.num_removed(); }
  /// Whether the id is that of a variable that is there.
  bool HasVariable(VariableId id) const { return variables_.Has(id); }
  /// Variables ever added, under whatever id.
  std::int64_t num_added_variables() const { return variables_.num_added(); }
  /// How many variables were added before it: tells a variable from a removed one that had its id.
  std::int64_t VariableSerial(VariableId id) const { return variables_[id].serial; }
  /// Families, empty ones included.
  int num_families() const { return factors_.size(); }
  /// Factors of all families; free places do not count.
  int num_factors() const { return factors_.num_factors(); }

  /// Doubles that store the variable. This and what follows require ids that exist.
  int AmbientSize(VariableId id) const { return variables_[id].ambient_size; }
  /// Its degrees of freedom.
  int TangentSize(VariableId id) const { return variables_[id].tangent_size; }
  /// What the solver does with it.
  Role role(VariableId id) const { return variables_[id].role; }
  /// Its SetEliminationGroup; 0 unless told otherwise.
  int elimination_group(VariableId id) const { return variables_[id].group; }
  /// Whether any variable is in another group than 0.
  bool HasEliminationGroups() const { return variables_.num_grouped() > 0; }
  /// True if held constant by SetConstant, borrowed, or of tangent size 0; of a removed variable
  /// too.
  bool IsConstant(VariableId id) const {
    return variables_[id].constant || variables_[id].tangent_size == 0;
  }
  /// Null if no value of the variable is bounded.
  const VariableBounds* bounds(VariableId id) const {
    const auto found = variables_.bounds().find(id);
    return found == variables_.bounds().end() ? nullptr : &found->second;
  }
  /// Whether any variable has bounds.
  bool HasBounds() const { return !variables_.bounds().empty(); }
  /// The space it lives on; null: Euclidean.
  const Manifold* manifold(VariableId id) const { return variables_[id].manifold.get(); }
  /// For whoever outlives the graph or the variable.
  const std::shared_ptr<const Manifold>& shared_manifold(VariableId id) const {
    return variables_[id].manifold;
  }
  /// Where the variable is linearized; null if where it is.
  const double* PinnedValues(VariableId id) const {
    const auto found = variables_.pins().find(id);
    return found == variables_.pins().end() ? nullptr : found->second.data();
  }
  /// Whether any variable is pinned.
  bool HasPins() const { return !variables_.pins().empty(); }
  /// Its values, wherever they are kept.
  const double* Values(VariableId id) const { return ValuesIn(state().data(), id); }

  /// The family of this id.
  const FactorFamily& family(FamilyId id) const { return *factors_[id].family; }
  /// Number of *connected* factors of the family: of its places, if some of them are free.
  int NumFactors(FamilyId id) const { return factors_[id].num_factors; }
  /// Its places that removed factors have left free.
  int NumFreePlaces(FamilyId id) const { return static_cast<int>(factors_[id].free_places.size()); }
  /// Whether there is a factor at this place.
  bool HasFactor(FamilyId id, int factor) const { return factors_.HasFactor(id, factor); }
  /// The variables of factor i: num_slots entries, all -1 at a free place.
  const VariableId* Variables(FamilyId id, int factor) const {
    const internal::FamilyRecord& record = factors_[id];
    return record.variables.data() +
           internal::IndexOf(factor) * internal::IndexOf(record.family->num_slots());
  }
  /// The factor's loss; null means ½‖f‖².
  const Loss* loss(FamilyId id, int factor) const {
    const internal::FamilyRecord& record = factors_[id];
    return record.losses.empty() ? nullptr : record.losses[internal::IndexOf(factor)].get();
  }
  /// True if any factor of the family has a loss.
  bool HasLosses(FamilyId id) const { return !factors_[id].losses.empty(); }
  /// Of each place of the family, null without one; null if no factor of it has a loss.
  const std::shared_ptr<const Loss>* losses(FamilyId id) const {
    return HasLosses(id) ? factors_[id].losses.data() : nullptr;
  }

  /// What the next edit takes: the id of the k-th removed variable of this ambient size, or the
  /// k-th free place of a family, the one freed last first; -1 when there are no more.
  VariableId FreeVariable(int ambient_size, bool borrowed, int k) const {
    return variables_.FreeId(ambient_size, borrowed, k);
  }
  /// The k-th free place of a family, the one freed last first; −1 when there are no more.
  std::int32_t FreePlace(FamilyId id, int k) const { return factors_.FreePlace(id, k); }
  /// How many factors had the place and are removed.
  std::int32_t Generation(FamilyId id, std::int32_t place) const {
    return factors_.Generation(id, place);
  }

  /// All owned values, one variable after the other in order of addition: what the solver copies,
  /// moves and writes back. The room of a removed variable holds zeros.
  const std::vector<double>& state() const { return variables_.state(); }
  /// The same, to be written by whoever minimizes.
  std::vector<double>& mutable_state() { return variables_.mutable_state(); }
  /// Offset of the variable's values in the state, or -1 if they are borrowed.
  std::int64_t StateOffset(VariableId id) const { return variables_[id].offset; }
  /// The values of a variable in a given state vector (in borrowed memory for a borrowed constant).
  const double* ValuesIn(const double* state, VariableId id) const {
    const internal::VariableRecord& variable = variables_[id];
    return variable.offset < 0 ? variable.borrowed : state + variable.offset;
  }

  /// Everything that makes the graph unsolvable, first culprit named: a call that could not be
  /// carried out, ids out of range, sizes that do not match a slot (of a constant only the ambient
  /// size counts) or the manifold, a plus-Jacobian of more than 2³¹ − 1 entries, bounds that
  /// nothing can meet, a variable twice in a factor, two variable landmarks in a factor, a variable
  /// landmark of tangent size above 4, a variable that moves in another tangent space than a slot's
  /// (FactorFamily::Space), a group below 0, values or pins that are null or not finite, a family
  /// without residuals or slots, or one that holds more or fewer measurements than were connected
  /// (more is fine once an edit was checked: a refused one may have placed some). Cost: one pass
  /// over factors and values; allocates for the message, and for factors of more than 256 slots.
  Status Validate() const;

  /// "factor 7 of BAL reprojection (variables 3, 112)": for messages.
  std::string DescribeFactor(FamilyId id, int factor) const;
  /// The same, and what went wrong with which number, what the family says of the factor
  /// (FactorFamily::Describe), and the first values of its variables, of which `parameters` holds
  /// one pointer a slot: at the point where it failed.
  std::string DescribeFailure(FamilyId id, const EvaluationFailure& failure,
                              const double* const* parameters) const;
  /// What the user knows a variable by, for DescribeFailure: the address of a parameter block, say.
  /// Null: by its id.
  void SetVariableNames(std::function<std::string(VariableId)> name_of) {
    variable_name_ = std::move(name_of);
  }

 private:
  friend class internal::GraphRestorer;

  bool CanAddFactor(FamilyId id, const FactorFamily* given,
                    const std::vector<VariableId>& variables);
  bool HasFamily(const char* call, FamilyId id);
  bool Misused(std::string message);

  internal::VariableTable variables_;
  internal::FactorTable factors_;
  std::function<std::string(VariableId)> variable_name_;
  Status misuse_;  // the first call that could not be carried out
  internal::Revision revision_;
  bool is_edited_ = false;  // an edit was checked
  internal::EditState edits_;
};

}  // namespace inceres
