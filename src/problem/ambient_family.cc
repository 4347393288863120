#include "inceres/problem/ambient_family.h"

#include <algorithm>
#include <cmath>
#include <cstring>

#include "simd/kernels.h"

// From ambient Jacobians, as formulas and user code write them, to tangent ones: J_tangent =
// J_ambient M with M = ∂(x ⊞ δ)/∂δ (docs/algorithms.md, "Linearization"). The map was classified
// once for its variable, so most calls are copies. Where a product is needed, its sums run over k
// upward as Ceres's do.
//
// What nobody has written is found without a flag per entry: memory is filled with an impossible
// value beforehand (kUnwritten), and a look at the sum of magnitudes tells that all is finite and
// written. Only if the sum is too large to tell are entries looked at one by one.

namespace inceres {
namespace {

// The kernels have the constant under a name of their own.
static_assert(kUnwritten == internal::kUnwrittenEntry);

// M = [I; 0]: the first columns as they are. Rows of the destination are row_stride apart.
void CopyColumns(int ambient_size, int columns, const double* J_ambient, int num_rows,
                 double* J_tangent, int row_stride) {
  for (int r = 0; r < num_rows; ++r) {
    std::copy_n(J_ambient + static_cast<std::ptrdiff_t>(r) * ambient_size, columns,
                J_tangent + static_cast<std::ptrdiff_t>(r) * row_stride);
  }
}

// M has a unit vector in every column: no arithmetic, so not even a zero of another sign.
void SelectColumns(const TangentMap& map, const double* J_ambient, int num_rows, double* J_tangent,
                   int row_stride) {
  for (int r = 0; r < num_rows; ++r) {
    const double* from = J_ambient + static_cast<std::ptrdiff_t>(r) * map.ambient_size;
    double* to = J_tangent + static_cast<std::ptrdiff_t>(r) * row_stride;
    for (int c = 0; c < map.tangent_size; ++c) {
      to[c] = from[map.selection[c]];
    }
  }
}

// kWidth columns of the product from column `first` on, summed in registers. The sum over k runs
// upward, as in a plain matrix product, so that results agree with Ceres's to the last bit; where
// M is the identity there is nothing to add.
template <int kWidth>
void MultiplyColumns(const TangentMap& map, int first, const double* J_ambient, int num_rows,
                     double* J_tangent, int row_stride) {
  for (int r = 0; r < num_rows; ++r) {
    const double* from = J_ambient + static_cast<std::ptrdiff_t>(r) * map.ambient_size;
    // The first rows of M are those of the identity columns, whose product is a copy.
    const double* M = map.plus_jacobian +
                      static_cast<std::ptrdiff_t>(map.num_identity_columns) * map.tangent_size +
                      first;
    double sum[kWidth] = {};
    for (int k = map.num_identity_columns; k < map.ambient_size; ++k, M += map.tangent_size) {
      for (int c = 0; c < kWidth; ++c) {
        sum[c] += from[k] * M[c];
      }
    }
    std::copy_n(sum, kWidth, J_tangent + static_cast<std::ptrdiff_t>(r) * row_stride + first);
  }
}

// The same sums where all sizes are known: M has kIdentity identity columns.
template <int kAmbient, int kTangent, int kIdentity>
void MultiplyFixed(const double* M, const double* J_ambient, int num_rows, double* J_tangent,
                   int row_stride) {
  for (int r = 0; r < num_rows; ++r, J_ambient += kAmbient, J_tangent += row_stride) {
    double sum[kTangent - kIdentity] = {};
    for (int k = kIdentity; k < kAmbient; ++k) {
      for (int c = kIdentity; c < kTangent; ++c) {
        sum[c - kIdentity] += J_ambient[k] * M[k * kTangent + c];
      }
    }
    // Constant sizes, so that these become plain moves.
    std::memcpy(J_tangent, J_ambient, kIdentity * sizeof(double));
    std::memcpy(J_tangent + kIdentity, sum, sizeof(sum));
  }
}

// Of a dense map: that of a pose [p, q] with an added position, or of a quaternion by itself.
bool IsPose(const TangentMap& map) {
  return map.ambient_size == 7 && map.tangent_size == 6 && map.num_identity_columns == 3;
}

bool IsQuaternion(const TangentMap& map) {
  return map.ambient_size == 4 && map.tangent_size == 3 && map.num_identity_columns == 0;
}

void Multiply(const TangentMap& map, const double* J_ambient, int num_rows, double* J_tangent,
              int row_stride) {
  if (IsPose(map)) {
    return MultiplyFixed<7, 6, 3>(map.plus_jacobian, J_ambient, num_rows, J_tangent, row_stride);
  }
  if (IsQuaternion(map)) {
    return MultiplyFixed<4, 3, 0>(map.plus_jacobian, J_ambient, num_rows, J_tangent, row_stride);
  }
  int c = map.num_identity_columns;
  if (c > 0) {
    CopyColumns(map.ambient_size, c, J_ambient, num_rows, J_tangent, row_stride);
  }
  // Six, three or one column at a time: the sums of a group stay in registers.
  for (; c + 6 <= map.tangent_size; c += 6) {
    MultiplyColumns<6>(map, c, J_ambient, num_rows, J_tangent, row_stride);
  }
  for (; c + 3 <= map.tangent_size; c += 3) {
    MultiplyColumns<3>(map, c, J_ambient, num_rows, J_tangent, row_stride);
  }
  for (; c < map.tangent_size; ++c) {
    MultiplyColumns<1>(map, c, J_ambient, num_rows, J_tangent, row_stride);
  }
}

}  // namespace

// Chosen once per slot, not per factor.
internal::TakeFunction internal::FindTake(int num_rows, int ambient_size, int columns) {
  return BestKernels().find_take(num_rows, ambient_size, columns);
}

namespace {

// The Jacobians of neighboring factors, whose maps are alike. False, and nothing done, if they are
// for who takes one by one.
bool TakeTogether(const internal::AmbientSlot& slot, const TangentMap* const* maps, int map_stride,
                  int count) {
  const TangentMap& map = *maps[0];
  // Nobody wrote them.
  if (map.kind == TangentMap::Kind::kConstant) {
    return true;
  }
  if (map.copies()) {
    return slot.take != nullptr && slot.take(count, slot.values, slot.num_rows, slot.J_tangent,
                                             slot.factor_stride, slot.row_stride);
  }
  if (map.kind != TangentMap::Kind::kDense || (!IsPose(map) && !IsQuaternion(map))) {
    return false;
  }
  const double* M[internal::kMostTaken];
  for (int n = 0; n < count; ++n) {
    M[n] = maps[std::ptrdiff_t{n} * map_stride]->plus_jacobian;
  }
  const internal::Kernels& kernels = internal::BestKernels();
  const auto take = IsPose(map) ? kernels.take_poses : kernels.take_quaternions;
  return take(M, count, slot.values, slot.num_rows, slot.J_tangent, slot.factor_stride,
              slot.row_stride);
}

}  // namespace

int internal::TakeAlike(const AmbientSlot& slot, const TangentMap* const* maps, int map_stride,
                        int count) {
  if (count == 0 || TakeTogether(slot, maps, map_stride, count)) {
    return -1;
  }
  for (int n = 0; n < count; ++n) {
    const double* const J = slot.values + std::ptrdiff_t{n} * slot.size;
    const TangentMap& map = *maps[std::ptrdiff_t{n} * map_stride];
    if (map.wanted() && !AreAllWritten(J, slot.size)) {
      return n;
    }
    ProjectToTangentSpace(map, J, slot.num_rows, slot.J_tangent + n * slot.factor_stride,
                          slot.row_stride);
  }
  return -1;
}

// From one entry that is not zero to the next: slots between the two are zero. That of a constant
// is not, for nobody has written it.
int internal::TakeNonzero(const AmbientSlot* slots, const TangentMap* const* maps, int num_slots,
                          int size, std::ptrdiff_t i, bool* zero_blocks) {
  const auto find_nonzero = BestKernels().find_nonzero;
  const double* const values = num_slots > 0 ? slots[0].values : nullptr;
  int nonzero = find_nonzero(values, 0, size);
  int end = 0;
  for (int s = 0; s < num_slots; ++s) {
    end += slots[s].size;
    zero_blocks[s] = nonzero >= end;
    if (nonzero >= end) {
      continue;
    }
    AmbientSlot slot = slots[s];
    slot.J_tangent += i * slot.factor_stride;
    if (TakeAlike(slot, maps + s, 1, 1) >= 0) {
      return s;
    }
    nonzero = find_nonzero(values, end, size);
  }
  return -1;
}

void internal::MarkManyUnwritten(double* values, int count) {
  BestKernels().mark_unwritten(values, count);
}

bool AreAllWritten(const double* values, int count) {
  if (internal::BestKernels().are_ordinary(values, count)) {
    return true;  // as almost all are; NaN and infinity are not
  }
  // A finite entry may be too large for the quick test, and is fine all the same.
  return std::all_of(values, values + count,
                     [](double value) { return std::isfinite(value) && value != kUnwritten; });
}

void ProjectToTangentSpace(const TangentMap& map, const double* J_ambient, int num_rows,
                           double* J_tangent, int row_stride) {
  // kIdentity is always a copy; of kSelection those that take the first columns.
  if (map.copies()) {
    CopyColumns(map.ambient_size, map.tangent_size, J_ambient, num_rows, J_tangent, row_stride);
    return;
  }
  switch (map.kind) {
    case TangentMap::Kind::kConstant:
    case TangentMap::Kind::kUnwanted:
    case TangentMap::Kind::kIdentity:  // is a copy
      return;
    case TangentMap::Kind::kSelection:
      return SelectColumns(map, J_ambient, num_rows, J_tangent, row_stride);
    case TangentMap::Kind::kDense:
      return Multiply(map, J_ambient, num_rows, J_tangent, row_stride);
  }
}

}  // namespace inceres
