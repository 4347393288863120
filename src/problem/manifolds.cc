// The manifolds of plain vectors: Euclidean, subset, product, sphere. Those with rotations are in
// rotation_manifolds.cc.
#include "inceres/problem/manifolds.h"

#include <algorithm>
#include <cmath>
#include <cstddef>
#include <cstdint>
#include <cstring>
#include <limits>
#include <utility>

#include "inceres/problem/rotation.h"

namespace inceres {

// EuclideanManifold is for components of a ProductManifold; a Euclidean variable needs none.
bool EuclideanManifold::Plus(const double* x, const double* delta, double* x_plus_delta) const {
  for (int k = 0; k < size_; ++k) {
    x_plus_delta[k] = x[k] + delta[k];
  }
  return true;
}

bool EuclideanManifold::PlusJacobian(const double* /*x*/, double* jacobian) const {
  const std::ptrdiff_t size = size_;
  std::fill_n(jacobian, size * size, 0.0);
  for (std::ptrdiff_t k = 0; k < size; ++k) {
    jacobian[k * size + k] = 1.0;
  }
  return true;
}

bool EuclideanManifold::Minus(const double* y, const double* x, double* delta) const {
  for (int k = 0; k < size_; ++k) {
    delta[k] = y[k] - x[k];
  }
  return true;
}

// An index that is not there cannot be refused in a constructor: valid_ makes the calls fail
// instead.
SubsetManifold::SubsetManifold(int size, const std::vector<int>& constant_indices) : size_(size) {
  std::vector<char> constant(static_cast<std::size_t>(std::max(size, 0)), 0);
  // A flag per coordinate: indices may come in any order, and twice.
  for (const int index : constant_indices) {
    if (index < 0 || index >= size) {
      valid_ = false;
    } else {
      constant[static_cast<std::size_t>(index)] = 1;
    }
  }
  for (int k = 0; k < size; ++k) {
    if (constant[static_cast<std::size_t>(k)] == 0) {
      free_.push_back(k);
    }
  }
}

bool SubsetManifold::Plus(const double* x, const double* delta, double* x_plus_delta) const {
  // Nothing to copy where the result takes the place of x.
  std::copy_n(x, x == x_plus_delta ? 0 : size_, x_plus_delta);
  for (const int k : free_) {
    x_plus_delta[k] += *delta++;
  }
  return valid_;
}

bool SubsetManifold::PlusJacobian(const double* /*x*/, double* jacobian) const {
  const std::ptrdiff_t tangent_size = TangentSize();
  // Unit vectors: the tangent map is classified as a selection, and projection is a copy.
  std::fill_n(jacobian, size_ * tangent_size, 0.0);
  for (std::ptrdiff_t c = 0; c < tangent_size; ++c) {
    jacobian[free_[static_cast<std::size_t>(c)] * tangent_size + c] = 1.0;
  }
  return valid_;
}

// What is held constant is not looked at, even if it differs.
bool SubsetManifold::Minus(const double* y, const double* x, double* delta) const {
  for (const int k : free_) {
    *delta++ = y[k] - x[k];
  }
  return valid_;
}

// Null components have no size; the calls say that they are wrong. What is too large for an int is
// as large as that: no variable has so many values.
ProductManifold::ProductManifold(std::vector<std::shared_ptr<const Manifold>> components)
    : components_(std::move(components)) {
  std::int64_t ambient_size = 0;
  std::int64_t tangent_size = 0;
  for (const std::shared_ptr<const Manifold>& component : components_) {
    if (component != nullptr) {
      ambient_size += component->AmbientSize();
      tangent_size += component->TangentSize();
    }
  }
  constexpr std::int64_t kMost = std::numeric_limits<int>::max();
  ambient_size_ = static_cast<int>(std::min(ambient_size, kMost));
  tangent_size_ = static_cast<int>(std::min(tangent_size, kMost));
}

// Values and tangent vectors are next to one another, in the order of the components.
bool ProductManifold::Plus(const double* x, const double* delta, double* x_plus_delta) const {
  for (const std::shared_ptr<const Manifold>& component : components_) {
    if (component == nullptr) {
      return false;
    }
    // A component without degrees of freedom is a constant: its Plus is never called, only its
    // values are kept.
    if (component->TangentSize() == 0) {
      std::copy_n(x, x == x_plus_delta ? 0 : component->AmbientSize(), x_plus_delta);
    } else if (!component->Plus(x, delta, x_plus_delta)) {
      return false;
    }
    x += component->AmbientSize();
    delta += component->TangentSize();
    x_plus_delta += component->AmbientSize();
  }
  return true;
}

bool ProductManifold::Minus(const double* y, const double* x, double* delta) const {
  for (const std::shared_ptr<const Manifold>& component : components_) {
    // A component without degrees of freedom has nothing to say of the difference.
    if (component == nullptr || (component->TangentSize() > 0 && !component->Minus(y, x, delta))) {
      return false;
    }
    y += component->AmbientSize();
    x += component->AmbientSize();
    delta += component->TangentSize();
  }
  return true;
}

bool ProductManifold::PlusJacobian(const double* x, double* jacobian) const {
  // Block diagonal: each component has its own rows and columns.
  const std::ptrdiff_t row_stride = tangent_size_;
  int first_column = 0;
  for (const std::shared_ptr<const Manifold>& component : components_) {
    if (component == nullptr) {
      return false;
    }
    const int rows = component->AmbientSize();
    const int columns = component->TangentSize();
    // The component writes its block without gaps at the start of its own rows; from the last row
    // up, each is then moved to its place. A row's place never lies before its source, nor over the
    // source of an earlier row, so no scratch is needed.
    if (columns > 0 && !component->PlusJacobian(x, jacobian)) {
      return false;
    }
    for (int r = rows - 1; r >= 0; --r) {
      double* row = jacobian + r * row_stride;
      double* block = row + first_column;
      std::memmove(block, jacobian + std::ptrdiff_t{r} * columns,
                   static_cast<std::size_t>(columns) * sizeof(double));
      std::fill(row, block, 0.0);
      std::fill(block + columns, row + row_stride, 0.0);
    }
    x += rows;
    jacobian += rows * row_stride;
    first_column += columns;
  }
  return true;
}

namespace {

// The basis B of the complement of x: the first n − 1 columns of the Householder reflection that
// takes e_n to ∓u, u = x/‖x‖. With v = u ± e_n:  B_ij = δ_ij − v_i u_j / (1 + |u_n|).  The sign is
// u_n's, so that nothing cancels.
struct Complement {
  Complement(const double* x, int n) {
    for (int k = 0; k < n; ++k) {
      norm = std::hypot(norm, x[k]);  // neither overflows nor underflows on the way
    }
    // Never 0: at x_n = 0 either sign will do.
    sign = x[n - 1] < 0.0 ? -1.0 : 1.0;
    // 1 / (1 + |u_n|) is between ½ and 1: nothing is divided by a small number.
    scale = 1.0 / (1.0 + std::fabs(x[n - 1]) / norm);
  }
  double norm = 0.0;
  double sign = 1.0;
  double scale = 0.0;
};

}  // namespace

bool SphereManifold::Plus(const double* x, const double* delta, double* x_plus_delta) const {
  const int n = size_;
  // For x = 0 norm is 0 and the result NaN; the return value says so.
  const Complement basis(x, n);
  double delta_squared = 0.0;
  double u_dot_delta = 0.0;
  // B δ = δ − v (u·δ) / (1 + |u_n|), with v = u ± e_n: O(n), the matrix is never formed.
  for (int j = 0; j < n - 1; ++j) {
    delta_squared += delta[j] * delta[j];
    u_dot_delta += x[j] / basis.norm * delta[j];
  }
  const double angle = std::sqrt(delta_squared);
  const double cosine = std::cos(angle);
  // Sinc is smooth at 0, so δ = 0 gives x exactly.
  const double reach = basis.norm * Sinc(delta_squared, angle);
  const double along_v = u_dot_delta * basis.scale;
  for (int i = 0; i < n; ++i) {
    const double v = x[i] / basis.norm + (i == n - 1 ? basis.sign : 0.0);
    const double B_delta = (i < n - 1 ? delta[i] : 0.0) - v * along_v;
    x_plus_delta[i] = cosine * x[i] + reach * B_delta;
  }
  return basis.norm > 0.0;
}

// At δ = 0: ‖x‖ B. The tangent vector is an angle, so the radius comes in.
bool SphereManifold::PlusJacobian(const double* x, double* jacobian) const {
  const int n = size_;
  const Complement basis(x, n);
  for (int i = 0; i < n; ++i) {
    const double v = x[i] / basis.norm + (i == n - 1 ? basis.sign : 0.0);
    for (int j = 0; j < n - 1; ++j) {
      const double B = (i == j ? 1.0 : 0.0) - v * basis.scale * x[j] / basis.norm;
      jacobian[std::ptrdiff_t{i} * (n - 1) + j] = basis.norm * B;
    }
  }
  return basis.norm > 0.0;
}

// With s = Bᵀ y / ‖y‖ and c = u · y / ‖y‖ the angle between x and y is atan2(‖s‖, c), along s.
bool SphereManifold::Minus(const double* y, const double* x, double* delta) const {
  const int n = size_;
  const Complement basis(x, n);
  double y_norm = 0.0;
  double cosine = 0.0;
  double v_dot_y = 0.0;
  // One pass for ‖y‖, u·y and v·y.
  for (int i = 0; i < n; ++i) {
    const double u = x[i] / basis.norm;
    y_norm = std::hypot(y_norm, y[i]);
    cosine += u * y[i];
    v_dot_y += (u + (i == n - 1 ? basis.sign : 0.0)) * y[i];
  }
  double sine = 0.0;
  for (int j = 0; j < n - 1; ++j) {
    // Bᵀ y, by the same formula as B δ.
    delta[j] = y[j] - x[j] / basis.norm * basis.scale * v_dot_y;
    sine = std::hypot(sine, delta[j]);
  }
  // At x = 0 or y = 0 there is no direction, and at the antipode every direction leads there.
  const bool defined = basis.norm > 0.0 && y_norm > 0.0 && (sine > 0.0 || cosine > 0.0);
  // At y = x, where the angle is 0, the limit of angle / ‖Bᵀy‖ is 1 / ‖y‖.
  const double stretch = sine > 0.0 ? std::atan2(sine, cosine) / sine : 1.0 / y_norm;
  for (int j = 0; j < n - 1; ++j) {
    delta[j] *= stretch;
  }
  return defined;
}

}  // namespace inceres
