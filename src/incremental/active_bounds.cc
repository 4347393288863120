#include "incremental/active_bounds.h"

#include <algorithm>
#include <cstddef>

#include "inceres/problem/manifolds.h"
#include "problem/find_fault.h"
#include "simd/kernels.h"

namespace inceres::internal {

// Bounds as a projected Gauss–Newton method (Bertsekas 1982; docs/algorithms.md, "One Update of
// incremental mode", bounds). The active set has the coordinates that lie on a bound while −g
// points out of the box; they have no row in the model. The others step as if they were free and
// are cut off one by one, which is a projection because the box is a product of intervals.
//
// What is kept is one flag per tangent coordinate, laid out as the padded vectors, and the number
// of flags that are set. Values lie on a bound to the last bit or not at all: membership is a
// comparison of doubles without a tolerance, so Land writes the bound itself and not the sum of
// value and step.

namespace {

// Whether each tangent coordinate is one of the ambient ones, so that a bound of a value is a bound
// of a step. On any other manifold ⊞ mixes coordinates, and a box in the ambient space is none in
// the tangent space.
bool IsSelection(const Manifold* manifold) {
  return manifold == nullptr || dynamic_cast<const EuclideanManifold*>(manifold) != nullptr ||
         dynamic_cast<const SubsetManifold*>(manifold) != nullptr;
}

// The manifold that the variable will have once the edit is carried out. The last entry of an id
// counts, for the edit may remove a variable and use its id again.
const Manifold* ManifoldOf(const GraphEdit& edit, VariableId id) {
  const auto& added = edit.new_variables();
  const auto found =
      std::find_if(added.rbegin(), added.rend(),
                   [id](const GraphEdit::NewVariable& variable) { return variable.id == id; });
  if (found != added.rend()) {
    return found->manifold.get();
  }
  return edit.graph().HasVariable(id) ? edit.graph().manifold(id) : nullptr;
}

}  // namespace

// Asked before anything of the edit is carried out, since an edit is all or nothing.
Status ActiveBounds::Check(const GraphEdit& edit) {
  for (const GraphEdit::NewBounds& bounds : edit.bounds()) {
    if (!IsSelection(ManifoldOf(edit, bounds.id))) {
      return Invalid("SetBounds: " + VariableName(bounds.id) +
                     " is on a manifold; an IncrementalSolver has bounds of values in Rⁿ, some of "
                     "which may be constant");
    }
  }
  return Status::Ok();
}

// Calls visit(tangent coordinate, ambient one, lower bound, upper bound).
template <typename Visit>
void ActiveBounds::ForEachCoordinate(VariableId id, const Visit& visit) const {
  const VariableBounds* bounds = any() ? graph_.bounds(id) : nullptr;
  if (bounds == nullptr) {
    return;
  }
  // The k-th tangent coordinate of a SubsetManifold is its k-th free value; elsewhere the two are
  // equal.
  const auto* subset = dynamic_cast<const SubsetManifold*>(graph_.manifold(id));
  for (int k = 0; k < graph_.TangentSize(id); ++k) {
    const int at = subset != nullptr ? subset->free_indices()[static_cast<std::size_t>(k)] : k;
    visit(k, at, bounds->lower[static_cast<std::size_t>(at)],
          bounds->upper[static_cast<std::size_t>(at)]);
  }
}

// The flags grow with the first variable that is held: a place beyond their end is held by nobody.
// With nobody held the answer is null, and callers skip their masks.
const char* ActiveBounds::held(std::int32_t quad) const {
  const std::size_t first = static_cast<std::size_t>(quad) * kQuad;
  return num_held_ > 0 && first < held_.size() ? held_.data() + first : nullptr;
}

bool ActiveBounds::Confine(VariableId id) {
  bool moved = false;
  double* x = variables_.current(id);
  ForEachCoordinate(id, [&](int /*k*/, int at, double lower, double upper) {
    const double within = std::clamp(x[at], lower, upper);
    moved = moved || within != x[at];
    x[at] = within;
  });
  if (moved) {
    // Current and candidate are equal between steps.
    variables_.Reject(id);
  }
  return moved;
}

// The membership test without its effect, for a gradient that a step has just turned.
bool ActiveBounds::IsDue(VariableId id, std::int32_t quad, const double* downhill) const {
  const char* now = held(quad);
  const double* x = variables_.current(id);
  bool due = false;
  ForEachCoordinate(id, [&](int k, int at, double lower, double upper) {
    due = due || PointsOut(x[at], lower, upper, downhill[k]) != (now != nullptr && now[k] != 0);
  });
  return due;
}

// `downhill` is b of a frame and η of a landmark. For a frame that is the gradient with the
// landmarks at their minimum, since b is reduced.
bool ActiveBounds::HoldAtBounds(VariableId id, std::int32_t quad, const double* downhill) {
  if (!IsDue(id, quad, downhill)) {
    return false;
  }
  const std::size_t first = static_cast<std::size_t>(quad) * kQuad;
  const auto size = static_cast<std::size_t>(PadToQuad(graph_.TangentSize(id)));
  // Whole quads, so that readers of a padded row never leave the vector.
  held_.resize(std::max(held_.size(), first + size), 0);
  const double* x = variables_.current(id);
  ForEachCoordinate(id, [&](int k, int at, double lower, double upper) {
    char& entry = held_[first + static_cast<std::size_t>(k)];
    const bool out = PointsOut(x[at], lower, upper, downhill[k]);
    // A char of 0 or 1 counts by itself: the sum moves only where the flag does.
    num_held_ += (out ? 1 : 0) - entry;
    entry = static_cast<char>(out);
  });
  return true;
}

// Bounds are not looked at: they may be gone from the graph already.
bool ActiveBounds::Release(std::int32_t quad, int size) {
  const int before = num_held_;
  const std::size_t first = static_cast<std::size_t>(quad) * kQuad;
  for (std::size_t k = first; k < std::min(held_.size(), first + static_cast<std::size_t>(size));
       ++k) {
    num_held_ -= held_[k];
    held_[k] = 0;
  }
  return num_held_ != before;
}

// The step is shortened before landmarks are substituted back and before the model is asked, so
// that the gain ratio is of the step that is taken.
bool ActiveBounds::CutOffAtBounds(VariableId id, std::int32_t quad, double* step) const {
  bool cut = false;
  const char* out = held(quad);
  const double* x = variables_.current(id);
  ForEachCoordinate(id, [&](int k, int at, double lower, double upper) {
    // Held: the model has no row of it, and what it says of the step is nothing but rounding.
    // Zeroing it does not count as cutting off.
    if (out != nullptr && out[k] != 0) {
      step[k] = 0.0;
      return;
    }
    // Both ends are differences to the present value: a value on a bound leaves exactly zero that
    // way.
    const double allowed = std::clamp(step[k], lower - x[at], upper - x[at]);
    cut = cut || allowed != step[k];
    step[k] = allowed;
  });
  return cut;
}

// x + (upper − x) need not be `upper` in floating point, and the membership test compares to the
// bit.
void ActiveBounds::LandAtBounds(VariableId id, const double* step) {
  const double* x = variables_.current(id);
  double* moved = variables_.candidate(id);
  ForEachCoordinate(id, [&](int k, int at, double lower, double upper) {
    // The very differences that CutOff clamps to, so that equality holds for all that was cut off.
    if (step[k] <= lower - x[at]) {
      moved[at] = lower;
    } else if (step[k] >= upper - x[at]) {
      moved[at] = upper;
    }
  });
}

}  // namespace inceres::internal
