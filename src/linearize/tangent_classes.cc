#include "linearize/tangent_classes.h"

#include <algorithm>

#include "inceres/problem/ambient_family.h"

namespace inceres::internal {
namespace {

bool IsIdentity(const TangentMap& map) {
  if (map.ambient_size != map.tangent_size) {
    return false;
  }
  for (int r = 0; r < map.ambient_size; ++r) {
    for (int c = 0; c < map.tangent_size; ++c) {
      if (map.plus_jacobian[r * map.tangent_size + c] != (r == c ? 1.0 : 0.0)) {
        return false;
      }
    }
  }
  return true;
}

// Finds for each column its single unit entry; false if there is a column without that form, of which and those after it nothing
// is known.
bool FindSelection(const TangentMap& map, int* selection) {
  std::fill_n(selection, map.tangent_size, -1);
  for (int c = 0; c < map.tangent_size; ++c) {
    for (int r = 0; r < map.ambient_size; ++r) {
      const double entry = map.plus_jacobian[r * map.tangent_size + c];
      if (entry == 0.0) {
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
bool IsUnitRow(const TangentMap& map, int k) {
  const double* row = map.plus_jacobian + k * map.tangent_size;
  for (int c = 0; c < map.tangent_size; ++c) {
    if (c != k && row[c] != 0.0) {
      return false;
    }
  }
  return true;
}

// Of the columns whose unit entry is known.
int CountIdentityColumns(const TangentMap& map, const int* selection) {
  int count = 0;
  while (count < map.tangent_size && selection[count] == count && IsUnitRow(map, count)) {
    ++count;
  }
  return count;
}

}  // namespace

const char* EvaluatePlusJacobian(const Manifold& manifold, const double* x, int count, double* M) {
  MarkUnwritten(M, count);
  if (!manifold.PlusJacobian(x, M)) {
    return "returned false";
  }
  return AreWritten(M, count) ? nullptr : "has an entry that is not finite or was not written";
}

void ClassifyTangentMap(TangentMap* map, int* selection) {
  if (IsIdentity(*map)) {
    map->kind = TangentMap::Kind::kIdentity;
  } else if (FindSelection(*map, selection)) {
    map->kind = TangentMap::Kind::kSelection;
    map->selection = selection;
    map->num_identity_columns = 0;
    while (map->num_identity_columns < map->tangent_size && selection[map->num_identity_columns] == map->num_identity_columns) {
      ++map->num_identity_columns;
    }
  } else {
    map->kind = TangentMap::Kind::kDense;
    map->num_identity_columns = CountIdentityColumns(*map, selection);
  }
}

}  // namespace inceres::internal
