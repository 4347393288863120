#include "adapters/ceres/read/factor_shapes.h"

#include <cstdint>
#include <unordered_map>

#include "adapters/ceres/read/index.h"

namespace inceres::internal {
namespace {

FactorFamily::Slot SlotOf(const ParameterBlockView& block) {
  // A block without degrees of freedom is always constant; a family's slot has at least one.
  return {block.ambient_size, block.tangent_size > 0 ? block.tangent_size : block.ambient_size};
}

bool HasShape(const ProblemView& view, const ResidualBlockView& residual,
              const FactorShape& shape) {
  if (residual.num_residuals != shape.num_residuals ||
      residual.num_slots != static_cast<int>(shape.slots.size())) {
    return false;
  }
  const int* blocks = view.SlotsOf(residual);
  for (std::size_t s = 0; s < shape.slots.size(); ++s) {
    const FactorFamily::Slot slot = SlotOf(view.block(blocks[s]));
    if (slot.ambient_size != shape.slots[s].ambient_size ||
        slot.tangent_size != shape.slots[s].tangent_size) {
      return false;
    }
  }
  return true;
}

std::uint64_t HashShape(const ProblemView& view, const ResidualBlockView& residual) {
  std::uint64_t hash = static_cast<std::uint64_t>(residual.num_residuals);
  for (int s = 0; s < residual.num_slots; ++s) {
    const FactorFamily::Slot slot = SlotOf(view.block(view.SlotsOf(residual)[s]));
    hash = (hash ^ static_cast<std::uint64_t>(slot.ambient_size * 4096 + slot.tangent_size)) *
           UINT64_C(0x100000001b3);
  }
  return hash;
}

FactorShape MakeShape(const ProblemView& view, const ResidualBlockView& residual, int first_place) {
  FactorShape shape;
  shape.num_residuals = residual.num_residuals;
  shape.first_place = first_place;
  shape.slots.reserve(static_cast<std::size_t>(residual.num_slots));
  for (int s = 0; s < residual.num_slots; ++s) {
    shape.slots.push_back(SlotOf(view.block(view.SlotsOf(residual)[s])));
  }
  return shape;
}

}  // namespace

ShapeTable FindShapes(const ProblemView& view) {
  ShapeTable table;
  table.shape_of.assign(view.residuals.size(), -1);
  std::unordered_multimap<std::uint64_t, int> shapes_by_hash;
  int previous = -1;
  for (const int r : view.moving) {
    const ResidualBlockView& residual = view.residuals[At(r)];
    if (!residual.like_previous &&
        (previous < 0 || !HasShape(view, residual, table.shapes[At(previous)]))) {
      const std::uint64_t hash = HashShape(view, residual);
      const auto [first, last] = shapes_by_hash.equal_range(hash);
      previous = -1;
      for (auto it = first; it != last && previous < 0; ++it) {
        previous = HasShape(view, residual, table.shapes[static_cast<std::size_t>(it->second)])
                       ? it->second
                       : -1;
      }
      if (previous < 0) {
        previous = static_cast<int>(table.shapes.size());
        shapes_by_hash.emplace(hash, previous);
        table.shapes.push_back(MakeShape(view, residual, table.num_places));
        table.num_places += residual.num_slots;
      }
    }
    table.shape_of[At(r)] = previous;
  }
  return table;
}

}  // namespace inceres::internal
