#pragma once

#include <array>
#include <cstddef>
#include <string>
#include <utility>
#include <vector>

#include "inceres/problem/ambient_family.h"

namespace inceres {

/// In place of a number of residuals: it is given when the program runs.
constexpr int kDynamicResiduals = 0;

/// Factors that are functors of one type, kept by value, for variables of Ns values each: what
/// AutoDiffFamily and NumericDiffFamily have in common. Derived supplies EvaluateOne, as
/// AmbientFamily has it.
///
/// Threads: functors are called concurrently if the solver runs with several; Add and Place are for
/// one writer.
///
/// @tparam Functor copyable
/// @tparam kResiduals residuals of a factor, ≥ 1, or kDynamicResiduals
/// @tparam Ns values of each of its variables
template <typename Derived, typename Functor, int kResiduals, int... Ns>
class FunctorFamily : public AmbientFamily<Derived> {
 public:
  /// What Add and Place take.
  using Measurement = Functor;
  /// One a variable: degrees of freedom.
  using TangentSizes = std::array<int, sizeof...(Ns)>;

  /// What error messages call a factor, and the tangent sizes of its variables, where they have
  /// manifolds.
  explicit FunctorFamily(std::string name = "functor", const TangentSizes& tangent_sizes = {Ns...})
      : AmbientFamily<Derived>(kResiduals, Slots(tangent_sizes)), name_(std::move(name)) {
    static_assert(kResiduals > 0, "say how many residuals: (num_residuals, name)");
  }
  /// The same for kDynamicResiduals. Requires num_residuals ≥ 1.
  explicit FunctorFamily(int num_residuals, std::string name = "functor",
                         const TangentSizes& tangent_sizes = {Ns...})
      : AmbientFamily<Derived>(num_residuals, Slots(tangent_sizes)), name_(std::move(name)) {
    static_assert(kResiduals == kDynamicResiduals, "the type says how many residuals: (name)");
  }

  /// Memory for so many factors.
  void Reserve(std::size_t num_factors) { functors_.reserve(num_factors); }
  /// Appends a factor.
  void Add(Functor functor) { functors_.push_back(std::move(functor)); }
  /// Puts the functor at an index: one in use or the next one.
  void Place(int index, const Functor& functor) { this->PlaceIn(&functors_, index, functor); }
  /// The functor at an index.
  const Functor& at(int index) const { return functors_[static_cast<std::size_t>(index)]; }

  /// Factors of the family.
  int size() const override { return static_cast<int>(functors_.size()); }
  /// What error messages call a factor.
  const char* Name() const override { return name_.c_str(); }

 private:
  static std::vector<FactorFamily::Slot> Slots(const TangentSizes& tangent_sizes) {
    constexpr TangentSizes kAmbientSizes = {Ns...};
    std::vector<FactorFamily::Slot> slots;
    for (std::size_t s = 0; s < sizeof...(Ns); ++s) {
      slots.push_back({kAmbientSizes[s], tangent_sizes[s]});
    }
    return slots;
  }

  std::string name_;
  std::vector<Functor> functors_;
};

}  // namespace inceres
