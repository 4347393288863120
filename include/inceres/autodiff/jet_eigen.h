#pragma once

#include <limits>

#include <Eigen/Core>

#include "inceres/autodiff/jet_math.h"

/// Jets as numbers in Eigen's vectors, matrices, quaternions and maps of the two:
/// `Eigen::Map<const Eigen::Quaternion<T>> q(pose)`. Optional, and headers only: include it before
/// functors that use Eigen; autodiff/jet.h needs no Eigen.
// NOLINTBEGIN(readability-identifier-naming): the names are Eigen's
namespace Eigen {

/// What Eigen wants to know about a number. Source: Eigen's page "Using custom scalar types".
template <int N>
struct NumTraits<inceres::jets::Jet<N>> {
  using Real = inceres::jets::Jet<N>;        ///< there are no complex Jets
  using NonInteger = inceres::jets::Jet<N>;  ///< the same
  using Nested = inceres::jets::Jet<N>;      ///< kept by value in expressions
  using Literal = inceres::jets::Jet<N>;     ///< of constants in formulas

  /// Traits; costs are relative to those of a double.
  enum {
    IsComplex = 0,             ///< real
    IsInteger = 0,             ///< no integer
    IsSigned = 1,              ///< has a sign
    ReadCost = 1,              ///< of a double
    AddCost = 1,               ///< of a double
    MulCost = 3,               ///< two products and a sum
    HasFloatingPoint = 1,      ///< of double
    RequireInitialization = 1  ///< has constructors
  };

  /// Division costs as much as multiplication.
  template <bool Vectorized>
  struct Div {
    /// Traits.
    enum {
      AVX = 0,  ///< no vector instruction
      Cost = 3  ///< as a product
    };
  };

  static Real epsilon() { return Real(std::numeric_limits<double>::epsilon()); }      ///< of double
  static Real dummy_precision() { return Real(1e-12); }                               ///< of double
  static Real highest() { return Real((std::numeric_limits<double>::max)()); }        ///< of double
  static Real lowest() { return Real(std::numeric_limits<double>::lowest()); }        ///< of double
  static Real infinity() { return Real(std::numeric_limits<double>::infinity()); }    ///< of double
  static Real quiet_NaN() { return Real(std::numeric_limits<double>::quiet_NaN()); }  ///< of double
  static int digits10() { return NumTraits<double>::digits10(); }                     ///< of double
};

/// A Jet and a double make a Jet.
template <typename BinaryOp, int N>
struct ScalarBinaryOpTraits<inceres::jets::Jet<N>, double, BinaryOp> {
  using ReturnType = inceres::jets::Jet<N>;  ///< of the operation
};
/// A double and a Jet make a Jet.
template <typename BinaryOp, int N>
struct ScalarBinaryOpTraits<double, inceres::jets::Jet<N>, BinaryOp> {
  using ReturnType = inceres::jets::Jet<N>;  ///< of the operation
};

}  // namespace Eigen
// NOLINTEND(readability-identifier-naming)
