#include "linearize/point_pair.h"

#include <algorithm>
#include <functional>
#include <string>

namespace inceres::internal {

// Current point and candidate. The states are two vectors whose memory never moves, for factors
// hold pointers into one of them. Accepting swaps what they are called; who evaluates at the other
// point than the last time has their values swapped, which are far fewer than pointers.
// PlusJacobian is called in the order of ids in the layout, on one thread, for the current point
// and for a candidate once its cost is asked for, as Ceres does (docs/ceres_contract.md,
// "Evaluation"); an accepted candidate brings its maps.

// Both states begin as the graph's: constants, and variables that nothing moves, are written by no
// step and are the same in both.
PointPair::PointPair(const FactorGraph& graph, const Layout& layout)
    : graph_(&graph), layout_(layout), current_(graph.state()), candidate_(graph.state()) {
  BuildTangents();
  BuildBounds();
}

// In place, as all pointers stay good. Tangent maps are those of the old values until they are
// computed.
void PointPair::Rebind(const FactorGraph& graph) {
  graph_ = &graph;
  SetCurrent(graph.state());
  // Both: what does not move is never copied from one to the other.
  std::copy(graph.state().begin(), graph.state().end(), candidate_.begin());
  bounds_.clear();
  BuildBounds();
}

// curved_ has the variables whose map depends on the point, in the order of the layout, so that
// PlusJacobian is called in one order. Maps of the others are shared: a pass over the factors then
// reads few maps instead of one a variable.
void PointPair::BuildTangents() {
  const auto is_curved = [this](VariableId id) {
    return layout_.position[id] >= 0 && graph_->manifold(id) != nullptr &&
           graph_->TangentSize(id) > 0;
  };
  maps_.resize(graph_->num_variables());
  for (VariableId id = 0; id < graph_->num_variables(); ++id) {
    if (!is_curved(id)) {
      const bool moves = layout_.position[id] >= 0;
      const auto [flat, is_new] =
          flat_.try_emplace({graph_->AmbientSize(id), graph_->TangentSize(id), moves});
      if (is_new) {
        flat->second.Set(*graph_, id, /*wanted=*/moves);
      }
      maps_[id] = &flat->second.map();
    }
  }
  for (const VariableId id : layout_.variables) {
    if (is_curved(id)) {
      curved_.push_back(id);
    } else if (graph_->manifold(id) == nullptr) {
      AddFlat(id);
    }
  }
  tangents_.resize(curved_.size());
  for (std::size_t k = 0; k < curved_.size(); ++k) {
    tangents_[k].Set(*graph_, curved_[k], /*wanted=*/true);
    maps_[curved_[k]] = &tangents_[k].map();
  }
}

// Values that lie one after the other in the state and in the packed vector are one run, so x + δ
// of a bundle of landmarks is one loop. Where variables were added in another order than the layout
// has, runs are short and many.
void PointPair::AddFlat(VariableId id) {
  const std::int64_t offset = graph_->StateOffset(id);
  const int packed = layout_.packed_offset[layout_.position[id]];
  const bool goes_on = !flat_runs_.empty() &&
                       flat_runs_.back().offset + flat_runs_.back().size == offset &&
                       flat_runs_.back().packed + flat_runs_.back().size == packed;
  if (!goes_on) {
    flat_runs_.push_back({offset, packed, 0});
  }
  flat_runs_.back().size += graph_->AmbientSize(id);
}

// Bounds are the graph's and stay there; only of variables that move is there anything to clamp.
void PointPair::BuildBounds() {
  for (std::size_t i = 0; graph_->HasBounds() && i < layout_.variables.size(); ++i) {
    if (const VariableBounds* bounds = graph_->bounds(layout_.variables[i])) {
      // The table exists only where there are bounds.
      bounds_.resize(layout_.variables.size());
      bounds_[i] = bounds;
    }
  }
}

void PointPair::SetCurrent(const std::vector<double>& state) {
  std::copy(state.begin(), state.end(), current_.begin());  // in place: factors point into it
}

// Plus is called in the order of the layout and not concurrently, as Ceres promises for manifolds.
bool PointPair::MoveCandidate(const double* delta) {
  for (const FlatRun& run : flat_runs_) {
    const double* const x = current_.data() + run.offset;
    std::transform(x, x + run.size, delta + run.packed, candidate_.data() + run.offset,
                   std::plus<>());
  }
  for (Tangent& tangent : tangents_) {
    tangent.DropCandidate();
  }
  for (const VariableId id : curved_) {
    const std::int64_t offset = graph_->StateOffset(id);
    if (!graph_->manifold(id)->Plus(current_.data() + offset,
                                    delta + layout_.packed_offset[layout_.position[id]],
                                    candidate_.data() + offset)) {
      return false;
    }
  }
  // Bounds hold for values, and are applied after Plus, as in Ceres.
  for (std::size_t i = 0; i < bounds_.size(); ++i) {
    if (bounds_[i] != nullptr) {
      ClampToBounds(*bounds_[i], candidate_.data() + graph_->StateOffset(layout_.variables[i]));
    }
  }
  return true;
}

// No value is copied and no pointer changes.
void PointPair::AcceptCandidate() {
  current_.swap(candidate_);
  points_to_candidate_ = !points_to_candidate_;
  // Others' maps are the identity everywhere.
  for (Tangent& tangent : tangents_) {
    tangent.AcceptCandidate();
  }
}

// Values and names are swapped, both: afterwards current_ is the vector that it was not, with the
// values that it had, and factors' pointers lead to the other point. Cost: a pass over the values,
// and none where a solve evaluates the same point again.
void PointPair::PointTo(bool candidate) {
  if (points_to_candidate_ != candidate) {
    std::swap_ranges(current_.begin(), current_.end(), candidate_.begin());
    current_.swap(candidate_);
    points_to_candidate_ = candidate;
  }
}

// compute(tangent, id, x) of all that have a manifold; it returns what is wrong.
template <typename Compute>
// The first fault ends it, as Ceres calls nothing more after one.
Status PointPair::ComputeTangentsAt(const std::vector<double>& state, const Compute& compute) {
  for (std::size_t k = 0; k < curved_.size(); ++k) {
    const VariableId id = curved_[k];
    if (const char* fault = compute(&tangents_[k], id, graph_->ValuesIn(state.data(), id))) {
      return Status::Error(
          StatusCode::kEvaluationFailed,
          "PlusJacobian of the manifold of variable " + std::to_string(id) + " " + fault);
    }
  }
  return Status::Ok();
}

Status PointPair::ComputeTangents() {
  return ComputeTangentsAt(current_, [this](Tangent* tangent, VariableId id, const double* x) {
    return tangent->Compute(*graph_, id, x);
  });
}

Status PointPair::ComputeCandidateTangents() {
  return ComputeTangentsAt(candidate_, [this](Tangent* tangent, VariableId id, const double* x) {
    return tangent->ComputeCandidate(*graph_, id, x);
  });
}

// Of a curved variable there are two maps, at the current point and at the candidate.
std::int64_t PointPair::Bytes() const {
  auto bytes = static_cast<std::int64_t>(sizeof(double) * current_.size() * 2 +
                                         sizeof(FlatRun) * flat_runs_.capacity());
  for (const VariableId id : curved_) {
    // Two matrices each.
    bytes += static_cast<std::int64_t>(sizeof(double) * 2 * graph_->AmbientSize(id) *
                                       graph_->TangentSize(id));
  }
  return bytes;
}

}  // namespace inceres::internal
