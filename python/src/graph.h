#pragma once

#include <algorithm>
#include <atomic>
#include <map>
#include <memory>
#include <string>
#include <thread>
#include <vector>

#include "arrays.h"
#include "family.h"
#include "inceres/problem/factor_graph.h"

namespace inceres::python {

/// The families that a graph or solver was given, by their ids in the core. A solver that
/// marginalizes adds families of its own, which are not among them.
class Families {
 public:
  /// Adds a family to the core, a FactorGraph or an IncrementalSolver. Raises if it belongs to
  /// another one.
  template <typename Core>
  FamilyId Add(const std::shared_ptr<Family>& family, Core* core) {
    Take(family.get());
    const FamilyId id = core->AddFamily(family->core());
    families_.emplace(id, family);
    return id;
  }
  Family& at(FamilyId id) const;
  const std::map<FamilyId, std::shared_ptr<Family>>& all() const { return families_; }

 private:
  static void Take(Family* family);

  std::map<FamilyId, std::shared_ptr<Family>> families_;
};

/// Keeps other threads, and callbacks, away from what is being solved without the GIL.
class Occupation {
 public:
  /// Raises RuntimeError while somebody solves; who is asking tells what he wanted.
  void RefuseIfBusy(const char* call) const;
  /// The same, but the thread that solves may: from its callbacks.
  void RefuseOtherThreads(const char* call) const;

  class Guard {
   public:
    Guard(Occupation* occupation, const char* call) : occupation_(occupation) {
      occupation_->RefuseIfBusy(call);
      occupation_->thread_ = std::this_thread::get_id();
      occupation_->busy_ = true;
    }
    ~Guard() { occupation_->busy_ = false; }
    Guard(const Guard&) = delete;
    Guard& operator=(const Guard&) = delete;

   private:
    Occupation* occupation_;
  };

 private:
  // Written with the GIL held.
  std::atomic<bool> busy_{false};
  std::thread::id thread_;
};

struct Graph {
  FactorGraph core;
  Families families;
  Occupation occupation;
};

/// What comes in for factors to be added: checked, ready to be placed.
struct FactorBatchInput {
  std::size_t count = 0;
  std::vector<VariableId> variables;  // num_slots each
  DoubleArray measurements;           // (count, num_columns)
  int num_columns = 0;
  std::vector<std::shared_ptr<const Loss>> losses;  // empty: none; else one each

  const double* Row(std::size_t i) const {
    return measurements.data() + i * static_cast<std::size_t>(num_columns);
  }
  std::shared_ptr<const Loss> LossOf(std::size_t i) const {
    return losses.empty() ? nullptr : losses[i];
  }
};

/// None, one loss for all, or a sequence of `count` losses and Nones. Empty for None.
std::vector<std::shared_ptr<const Loss>> ToLosses(const py::object& loss, std::size_t count);
/// Ids of variables in [0, num_variables).
FactorBatchInput ToFactors(const Family& family, const py::object& variables,
                           const py::object& measurements, const py::object& loss,
                           std::int64_t num_variables);
/// (count, m) with a number of columns the family has; a U of all its entries is upper triangular.
DoubleArray ToMeasurements(const Family& family, const py::object& measurements, std::size_t count);

Role ToRole(const std::string& name);
/// What Values(id) gives, a row an id.
template <typename ValuesOf>
py::array_t<double> StackValues(const FactorGraph& graph, const std::vector<VariableId>& ids,
                                const ValuesOf& values_of) {
  const int size = CommonAmbientSize(graph, ids);
  py::array_t<double> result(
      {static_cast<py::ssize_t>(ids.size()), static_cast<py::ssize_t>(size)});
  double* to = result.mutable_data();
  for (const VariableId id : ids) {
    to = std::copy_n(values_of(id), size, to);
  }
  return result;
}

/// One flag for all, or one each.
std::vector<char> ToFlags(const py::object& value, const char* name, std::size_t count);

/// A side of bounds: None is none; one row is all variables'.
std::vector<double> ToBounds(const py::object& value, const char* name, std::size_t count,
                             std::size_t size);
/// set(id, lower, upper) for each of these variables, of one ambient size; null where there are
/// none.
template <typename Set>
void ApplyBounds(const FactorGraph& graph, const std::vector<VariableId>& ids,
                 const py::object& lower, const py::object& upper, const Set& set) {
  const auto size = static_cast<std::size_t>(CommonAmbientSize(graph, ids));
  const std::vector<double> low = ToBounds(lower, "lower", ids.size(), size);
  const std::vector<double> high = ToBounds(upper, "upper", ids.size(), size);
  for (std::size_t i = 0; i < ids.size(); ++i) {
    set(ids[i], low.empty() ? nullptr : low.data() + i * size,
        high.empty() ? nullptr : high.data() + i * size);
  }
}

/// A row of values a variable, added to a FactorGraph or by a GraphEdit; their ids.
template <typename Target>
IdArray AddVariablesTo(Target* target, const py::object& values, const std::string& role,
                       const std::shared_ptr<Manifold>& manifold, const py::object& constant) {
  const DoubleArray rows = ToMatrix(values, "values", manifold ? manifold->AmbientSize() : -1);
  const auto count = static_cast<std::size_t>(rows.shape(0));
  const std::vector<char> held = ToFlags(constant, "constant", count);
  const Role as = ToRole(role);
  const auto size = static_cast<int>(rows.shape(1));
  std::vector<VariableId> ids;
  for (std::size_t i = 0; i < count; ++i) {
    ids.push_back(
        target->AddVariable(rows.data() + i * static_cast<std::size_t>(size), size, as, manifold));
    if (held[i] != 0) {
      target->SetConstant(ids.back(), true);
    }
  }
  return ToIdArray(ids);
}

}  // namespace inceres::python
