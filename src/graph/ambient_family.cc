#include "inceres/graph/ambient_family.h"

#include <algorithm>

namespace inceres {
namespace {

void CopyRows(const double* J_ambient, int num_rows, int size, double* J_tangent, int row_stride) {
  for (int r = 0; r < num_rows; ++r) {
    std::copy_n(J_ambient + static_cast<std::ptrdiff_t>(r) * size, size, J_tangent + static_cast<std::ptrdiff_t>(r) * row_stride);
  }
}

void SelectColumns(const TangentMap& map, const double* J_ambient, int num_rows, double* J_tangent, int row_stride) {
  for (int r = 0; r < num_rows; ++r) {
    const double* from = J_ambient + static_cast<std::ptrdiff_t>(r) * map.ambient_size;
    double* to = J_tangent + static_cast<std::ptrdiff_t>(r) * row_stride;
    for (int c = 0; c < map.tangent_size; ++c) {
      to[c] = from[map.selection[c]];
    }
  }
}

// kWidth columns of the product from column `first` on, summed in registers. The sum over k runs upwards from zero, as in a
// plain matrix product, so that results agree with Ceres's to the last bit.
template <int kWidth>
void MultiplyColumns(const TangentMap& map, int first, const double* J_ambient, int num_rows, double* J_tangent, int row_stride) {
  for (int r = 0; r < num_rows; ++r) {
    const double* from = J_ambient + static_cast<std::ptrdiff_t>(r) * map.ambient_size;
    const double* M = map.plus_jacobian + first;
    double sum[kWidth] = {};
    for (int k = 0; k < map.ambient_size; ++k, M += map.tangent_size) {
      for (int c = 0; c < kWidth; ++c) {
        sum[c] += from[k] * M[c];
      }
    }
    std::copy_n(sum, kWidth, J_tangent + static_cast<std::ptrdiff_t>(r) * row_stride + first);
  }
}

void Multiply(const TangentMap& map, const double* J_ambient, int num_rows, double* J_tangent, int row_stride) {
  int c = 0;
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

void ProjectToTangentSpace(const TangentMap& map, const double* J_ambient, int num_rows, double* J_tangent, int row_stride) {
  switch (map.kind) {
    case TangentMap::Kind::kConstant:
    case TangentMap::Kind::kUnwanted:
      return;
    case TangentMap::Kind::kIdentity:
      return CopyRows(J_ambient, num_rows, map.tangent_size, J_tangent, row_stride);
    case TangentMap::Kind::kSelection:
      return SelectColumns(map, J_ambient, num_rows, J_tangent, row_stride);
    case TangentMap::Kind::kDense:
      return Multiply(map, J_ambient, num_rows, J_tangent, row_stride);
  }
}

}  // namespace inceres
