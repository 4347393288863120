#include "inceres/problem/check_jacobians.h"

#include <algorithm>
#include <cmath>
#include <cstddef>

#include "base/option_rules.h"
#include "problem/family_check.h"
#include "problem/find_fault.h"
#include "problem/slot_space.h"

// Compares the Jacobians that factors write with derivatives of their residuals, by Ridders' method
// (family_check.cc, ridders.h). Here are the three ways in (a family of a graph, all families, a
// factor without a graph), the choice of factors and the texts. A factor is checked in the tangent
// space, at the values it has, so that a wrong plus-Jacobian shows as well as a wrong formula.
// Losses play no part: they are applied after what is checked.

namespace inceres {
namespace {

using internal::FamilyCheck;
using internal::Invalid;
using internal::SlotPoint;

// Constants are checked as if they were free, if they could be: of one whose tangent space is not
// the slot's there is nothing to compare, nor of a borrowed one, which has none.
std::vector<SlotPoint> PointIn(const FactorGraph& graph, FamilyId id, int factor) {
  const FactorFamily& family = graph.family(id);
  std::vector<SlotPoint> point;
  point.reserve(static_cast<std::size_t>(family.num_slots()));
  const VariableId* variables = graph.Variables(id, factor);
  for (int s = 0; s < family.num_slots(); ++s) {
    const VariableId variable = variables[s];
    point.push_back(
        {graph.Values(variable), graph.manifold(variable),
         graph.TangentSize(variable) > 0 && internal::CouldMoveInSlot(graph, variable, family, s)});
  }
  return point;
}

// A failure is in the report.
void CheckFamily(const FactorGraph& graph, FamilyId id, const JacobianCheckOptions& options,
                 JacobianReport* report) {
  const int num_places = graph.NumFactors(id);
  // Evenly spread: every step-th place, rounded up, so that at most max_factors are looked at.
  const int step = std::max(
      1, num_places / options.max_factors + (num_places % options.max_factors > 0 ? 1 : 0));
  FamilyCheck check(graph.family(id), id, options, report);
  for (int factor = 0; factor < num_places; factor += step) {
    // A free place has no variables to look at.
    if (!graph.HasFactor(id, factor)) {
      continue;
    }
    const std::vector<SlotPoint> point = PointIn(graph, id, factor);
    if (check.Check(factor, point)) {
      continue;
    }
    std::vector<const double*> values;
    values.reserve(point.size());
    for (const SlotPoint& slot : point) {
      values.push_back(slot.values);
    }
    report->status = Status::Error(
        StatusCode::kEvaluationFailed,
        // Where Evaluate has failed at the point itself it names the culprit; where residuals
        // beside the point cannot be evaluated, or a manifold fails, only the place is known.
        check.failure().failed()
            ? graph.DescribeFailure(id, check.failure(), values.data())
            : graph.DescribeFactor(id, factor) + ": cannot evaluate " + check.what_failed());
    return;
  }
}

// One report over so many families: counts add up, and the worst entry is that of all.
JacobianReport CheckFamilies(const FactorGraph& graph, FamilyId first, int count,
                             const JacobianCheckOptions& options) {
  JacobianReport report;
  report.status = options.Validate();
  if (report.status.ok() && (first < 0 || first > graph.num_families() - count)) {
    report.status = Invalid("CheckJacobians: there is no family " + std::to_string(first));
  }
  // Connections and values are looked at first, for Evaluate may rely on them.
  report.status = report.status.ok() ? graph.Validate() : report.status;
  // The first failure ends it: a report with a status is of no use beyond that.
  for (FamilyId id = first; report.status.ok() && id < first + count; ++id) {
    CheckFamily(graph, id, options, &report);
  }
  // The name is made once, of the worst factor only.
  if (report.status.ok() && report.worst.factor >= 0) {
    report.factor_name = graph.DescribeFactor(report.worst.family, report.worst.factor);
  }
  return report;
}

}  // namespace

// A tolerance may be infinite, a step may not.
Status JacobianCheckOptions::Validate() const {
  return internal::OptionRules("JacobianCheckOptions")
      .Positive("tolerance", tolerance)
      .Require(relative_step > 0.0 && std::isfinite(relative_step), "relative_step", relative_step,
               "> 0")
      .AtLeastOne("max_factors", max_factors)
      .status();
}

// For a log or the output of a test: counts, then the entry to look at first.
std::string JacobianReport::ToString() const {
  if (!status.ok()) {
    return status.message;
  }
  std::string text = std::to_string(num_wrong) + " of " + std::to_string(num_entries) +
                     " entries wrong, in " + std::to_string(num_factors) + " factors";
  if (num_uncertain > 0) {
    text += "; " + std::to_string(num_uncertain) + " uncertain";
  }
  // Without a wrong entry the worst is still told: it says how far from the tolerance the family
  // is.
  if (worst.factor >= 0) {
    text += std::string("; ") + (num_wrong > 0 ? "worst" : "least exact") + ": " + factor_name +
            ", slot " + std::to_string(worst.slot) + ", row " + std::to_string(worst.row) +
            ", column " + std::to_string(worst.column) + ": " +
            internal::NumberText(worst.analytic) + " where the numeric derivative is " +
            internal::NumberText(worst.numeric);
  }
  return text;
}

JacobianReport CheckJacobians(const FactorGraph& graph, FamilyId family,
                              const JacobianCheckOptions& options) {
  return CheckFamilies(graph, family, 1, options);
}

JacobianReport CheckJacobians(const FactorGraph& graph, const JacobianCheckOptions& options) {
  return CheckFamilies(graph, 0, graph.num_families(), options);
}

JacobianReport CheckJacobians(const FactorFamily& family, int factor,
                              const std::vector<const double*>& values,
                              const std::vector<const Manifold*>& manifolds,
                              const JacobianCheckOptions& options) {
  JacobianReport report;
  report.status = options.Validate();
  const auto num_slots = static_cast<std::size_t>(family.num_slots());
  const std::string name = "factor " + std::to_string(factor) + " of " + family.Name();
  if (report.status.ok() && (factor < 0 || factor >= family.size())) {
    report.status = Invalid("CheckJacobians: there is no " + name);
  } else if (report.status.ok() && (values.size() != num_slots ||
                                    (!manifolds.empty() && manifolds.size() != num_slots))) {
    report.status = Invalid("CheckJacobians: " + name + " has " + std::to_string(num_slots) +
                            " slots: as many values are needed, and as many manifolds or none");
  }
  std::vector<SlotPoint> point(num_slots);
  for (std::size_t s = 0; report.status.ok() && s < num_slots; ++s) {
    const FactorFamily::Slot& slot = family.slot(static_cast<int>(s));
    point[s] = {values[s], manifolds.empty() ? nullptr : manifolds[s], true};
    const Manifold* manifold = point[s].manifold;
    const int ambient = manifold == nullptr ? slot.ambient_size : manifold->AmbientSize();
    // Without manifolds tangent and ambient sizes must be the same.
    const int tangent = manifold == nullptr ? slot.ambient_size : manifold->TangentSize();
    if (values[s] == nullptr || ambient != slot.ambient_size || tangent != slot.tangent_size) {
      report.status = Invalid(
          "CheckJacobians: slot " + std::to_string(s) + " of " + name +
          (values[s] == nullptr ? " has no values" : " is of other sizes than its manifold"));
    }
  }
  if (!report.status.ok()) {
    return report;
  }
  FamilyCheck check(family, -1, options, &report);
  report.factor_name = name;
  if (!check.Check(factor, point)) {
    const char* reason = check.failure().failed() ? check.failure().reason : "cannot be evaluated";
    report.status = Status::Error(StatusCode::kEvaluationFailed,
                                  name + ": " + reason + " " + check.what_failed());
  }
  return report;
}

}  // namespace inceres
