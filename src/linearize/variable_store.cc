#include "linearize/variable_store.h"

#include "simd/kernels.h"

namespace inceres::internal {

// Values in chunks that are never freed or moved, current and candidate side by side. Places in
// the padded step are handed out in quads, and those of removed variables go back to a list by
// their number of quads: the padded vectors do not grow while a window slides.

namespace {

constexpr int kChunk = 8192;  // values

std::size_t NumQuads(int tangent_size) {
  return static_cast<std::size_t>(PadToQuad(tangent_size) / kQuad);
}

}  // namespace

// Until it enters it counts as constant: its map has no columns.
void VariableStore::Add(const FactorGraph& graph, VariableId id) {
  while (id >= static_cast<VariableId>(variables_.size()) * kVariablesPerChunk) {
    variables_.push_back(std::make_unique<Variable[]>(kVariablesPerChunk));
  }
  Variable& variable = At(id);
  variable.tangent.Set(graph, id, /*wanted=*/false);
  if (graph.StateOffset(id) < 0) {
    // never written: its tangent size is 0
    // The owner's memory; constants are read where they are.
    variable.current = variable.candidate = const_cast<double*>(graph.Values(id));
    return;
  }
  const int size = graph.AmbientSize(id);
  // The room of an id stays with it, for ids are used again for equal ambient sizes only.
  if (variable.room == nullptr) {
    variable.room = Allocate(2 * size);
  }
  variable.current = variable.room;
  variable.candidate = variable.room + size;
  Set(id, graph.Values(id));
}

// With a step of its own from here on.
void VariableStore::Enter(const FactorGraph& graph, VariableId id) {
  Variable& variable = At(id);
  variable.tangent.Set(graph, id, /*wanted=*/true);
  const std::size_t quads = NumQuads(graph.TangentSize(id));
  if (quads < free_quads_.size() && !free_quads_[quads].empty()) {
    variable.quad = free_quads_[quads].back();
    free_quads_[quads].pop_back();
  } else {
    variable.quad = num_quads_;
    num_quads_ += static_cast<std::int32_t>(quads);
  }
}

// Its values stay where they are.
void VariableStore::Remove(VariableId id) {
  // By the size it entered with, which the tangent map has.
  Variable& variable = At(id);
  if (variable.quad < 0) {
    return;
  }
  const std::size_t quads = NumQuads(variable.tangent.map().tangent_size);
  free_quads_.resize(std::max(free_quads_.size(), quads + 1));
  free_quads_[quads].push_back(variable.quad);
  variable.quad = -1;
}

// Candidate and current are equal between steps.
void VariableStore::Set(VariableId id, const double* values) {
  Variable& variable = At(id);
  const int size = variable.tangent.map().ambient_size;
  std::copy_n(values, size, variable.current);
  std::copy_n(values, size, variable.candidate);
  variable.tangent.MarkMoved();
}

// Chunks, for a vector would move what pointers point to.
double* VariableStore::Allocate(int size) {
  if (chunks_.empty() || used_ + size > capacity_) {
    // What is left of the last chunk is lost; a variable larger than a chunk has one by itself.
    capacity_ = std::max(kChunk, size);
    chunks_.push_back(std::make_unique<double[]>(capacity_));
    used_ = 0;
  }
  double* values = chunks_.back().get() + used_;
  used_ += size;
  return values;
}

}  // namespace inceres::internal
