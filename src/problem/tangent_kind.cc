#include "problem/tangent_kind.h"

#include <algorithm>
#include <cstddef>

// What kind of matrix M = ∂(x ⊞ δ)/∂δ is (docs/algorithms.md, "Linearization"). An identity or a
// selection of columns makes J M a copy; only a dense M needs a product. The kind is found from the
// numbers, by exact comparison with 0 and 1, so that user manifolds need not declare it.

namespace inceres::internal {
namespace {

double EntryOf(const TangentMap& map, int row, int column) {
  return map.plus_jacobian[std::ptrdiff_t{row} * map.tangent_size + column];
}

// Finds for each column its single unit entry, by exact comparison: a column that is nearly a unit
// vector is none. False if there is a column without that form, of which and those after it nothing
// is known.
bool FindSelection(const TangentMap& map, int* selection) {
  std::fill_n(selection, map.tangent_size, -1);
  for (int c = 0; c < map.tangent_size; ++c) {
    for (int r = 0; r < map.ambient_size; ++r) {
      const double entry = EntryOf(map, r, c);
      if (entry == 0.0) {
        // A zero is no entry; a second nonzero one, or one that is not 1, makes the column no
        // selection.
        continue;
      }
      if (entry != 1.0 || selection[c] >= 0) {
        selection[c] = -1;
        return false;
      }
      selection[c] = r;
    }
    if (selection[c] < 0) {
      return false;
    }
  }
  return true;
}

// Row k of M is that of the identity, whose entry there is known.
// Together with a unit column k: the product then copies column k and leaves it out of all others.
bool IsUnitRow(const TangentMap& map, int k) {
  for (int c = 0; c < map.tangent_size; ++c) {
    if (c != k && EntryOf(map, k, c) != 0.0) {
      return false;
    }
  }
  return true;
}

// Of the columns whose unit entry is known.
// Whether a column is a unit vector is known from FindSelection, its row is looked at here.
int CountIdentityColumns(const TangentMap& map, const int* selection) {
  int count = 0;
  while (count < map.tangent_size && selection[count] == count && IsUnitRow(map, count)) {
    ++count;
  }
  return count;
}

}  // namespace

// From the cheapest kind to the dearest: J M is a copy, a copy of columns, a product.
void ClassifyTangentMap(TangentMap* map, int* selection) {
  const bool selects = FindSelection(*map, selection);
  const int num_identity_columns = CountIdentityColumns(*map, selection);
  if (selects && num_identity_columns == map->ambient_size &&
      num_identity_columns == map->tangent_size) {
    map->kind = TangentMap::Kind::kIdentity;
    return;
  }
  map->num_identity_columns = num_identity_columns;
  if (selects) {
    map->kind = TangentMap::Kind::kSelection;
    map->selection = selection;
  } else {
    map->kind = TangentMap::Kind::kDense;
  }
}

}  // namespace inceres::internal
