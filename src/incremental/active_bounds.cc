#include "incremental/active_bounds.h"

#include <algorithm>
#include <cstddef>

#include "inceres/problem/manifolds.h"
#include "problem/find_fault.h"
#include "simd/kernels.h"

namespace inceres::internal {
namespace {

bool IsSelection(const Manifold* manifold) {
  return manifold == nullptr || dynamic_cast<const EuclideanManifold*>(manifold) != nullptr ||
         dynamic_cast<const SubsetManifold*>(manifold) != nullptr;
}

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
  const auto* subset = dynamic_cast<const SubsetManifold*>(graph_.manifold(id));
  for (int k = 0; k < graph_.TangentSize(id); ++k) {
    const int at = subset != nullptr ? subset->free_indices()[static_cast<std::size_t>(k)] : k;
    visit(k, at, bounds->lower[static_cast<std::size_t>(at)],
          bounds->upper[static_cast<std::size_t>(at)]);
  }
}

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
    variables_.Reject(id);
  }
  return moved;
}

bool ActiveBounds::IsDue(VariableId id, std::int32_t quad, const double* downhill) const {
  const char* now = held(quad);
  const double* x = variables_.current(id);
  bool due = false;
  ForEachCoordinate(id, [&](int k, int at, double lower, double upper) {
    due = due || PointsOut(x[at], lower, upper, downhill[k]) != (now != nullptr && now[k] != 0);
  });
  return due;
}

bool ActiveBounds::Hold(VariableId id, std::int32_t quad, const double* downhill) {
  if (!IsDue(id, quad, downhill)) {
    return false;
  }
  const std::size_t first = static_cast<std::size_t>(quad) * kQuad;
  const auto size = static_cast<std::size_t>(PadToQuad(graph_.TangentSize(id)));
  held_.resize(std::max(held_.size(), first + size), 0);
  const double* x = variables_.current(id);
  ForEachCoordinate(id, [&](int k, int at, double lower, double upper) {
    char& entry = held_[first + static_cast<std::size_t>(k)];
    const bool out = PointsOut(x[at], lower, upper, downhill[k]);
    num_held_ += (out ? 1 : 0) - entry;
    entry = static_cast<char>(out);
  });
  return true;
}

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

bool ActiveBounds::CutOff(VariableId id, std::int32_t quad, double* step) const {
  bool cut = false;
  const char* out = held(quad);
  const double* x = variables_.current(id);
  ForEachCoordinate(id, [&](int k, int at, double lower, double upper) {
    if (out != nullptr && out[k] != 0) {
      step[k] = 0.0;
      return;
    }
    const double allowed = std::clamp(step[k], lower - x[at], upper - x[at]);
    cut = cut || allowed != step[k];
    step[k] = allowed;
  });
  return cut;
}

void ActiveBounds::Land(VariableId id, const double* step) {
  const double* x = variables_.current(id);
  double* moved = variables_.candidate(id);
  ForEachCoordinate(id, [&](int k, int at, double lower, double upper) {
    if (step[k] <= lower - x[at]) {
      moved[at] = lower;
    } else if (step[k] >= upper - x[at]) {
      moved[at] = upper;
    }
  });
}

}  // namespace inceres::internal
