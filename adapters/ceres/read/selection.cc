#include "adapters/ceres/read/selection.h"

#include <algorithm>
#include <numeric>

#include "adapters/ceres/read/index.h"

namespace inceres::internal {
namespace {

bool IsBounded(const ParameterBlockView& block) {
  return block.reduced() && block.bounds != BoundsKind::kNone;
}

// Each column of the Jacobian has a 1 and nothing else: the rows of these, if no two are one.
std::optional<std::vector<int>> UnitRows(const std::vector<double>& jacobian, int num_columns) {
  std::vector<int> rows(At(num_columns), -1);
  const int num_rows = static_cast<int>(jacobian.size()) / num_columns;
  for (int row = 0; row < num_rows; ++row) {
    const double* entries = jacobian.data() + At(row) * At(num_columns);
    int found = -1;
    for (int column = 0; column < num_columns; ++column) {
      if (entries[column] == 0.0) {
        continue;
      }
      if (entries[column] != 1.0 || found >= 0 || rows[At(column)] >= 0) {
        return std::nullopt;
      }
      rows[At(column)] = row;
      found = column;
    }
  }
  const bool complete = std::none_of(rows.begin(), rows.end(), [](int row) { return row < 0; });
  return complete ? std::make_optional(rows) : std::nullopt;
}

// The Jacobian is that of one point: a step of some length shows a manifold that turns elsewhere.
bool AddsToThese(const ParameterBlockView& block, const std::vector<int>& moved) {
  const double* x = block.values;
  std::vector<double> expected(x, x + block.ambient_size), delta, result(expected);
  for (std::size_t k = 0; k < moved.size(); ++k) {
    delta.push_back(0.25 + 0.125 * static_cast<double>(k));
    expected[At(moved[k])] += delta.back();
  }
  return block.manifold->Plus(x, delta.data(), result.data()) && result == expected;
}

}  // namespace

std::optional<std::vector<int>> MovedValues(const ParameterBlockView& block) {
  std::vector<int> all(At(block.tangent_size));
  std::iota(all.begin(), all.end(), 0);
  if (block.manifold == nullptr || block.tangent_size == 0) {
    return all;
  }
  std::vector<double> jacobian(At(block.ambient_size) * At(block.tangent_size), 0.0);
  if (!PlusJacobianOf(*block.manifold, block.values, jacobian.data())) {
    return std::nullopt;
  }
  std::optional<std::vector<int>> moved = UnitRows(jacobian, block.tangent_size);
  // Ascending, as a SubsetManifold has them.
  return moved && std::is_sorted(moved->begin(), moved->end()) && AddsToThese(block, *moved)
             ? moved
             : std::nullopt;
}

const ParameterBlockView* FindBoundsOnManifold(const ProblemView& view) {
  const auto found = std::find_if(
      view.blocks.begin(), view.blocks.end(),
      [](const ParameterBlockView& block) { return IsBounded(block) && !MovedValues(block); });
  return found == view.blocks.end() ? nullptr : &*found;
}

bool HasBounds(const ProblemView& view) {
  return std::any_of(view.blocks.begin(), view.blocks.end(), IsBounded);
}

}  // namespace inceres::internal
