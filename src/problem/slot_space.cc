#include "problem/slot_space.h"

#include <algorithm>
#include <cmath>
#include <cstddef>
#include <functional>
#include <typeinfo>
#include <vector>

#include "inceres/problem/manifolds.h"

namespace inceres::internal {

// Which manifolds a family's own tangent Jacobians are right for. By what a manifold does and not
// by its class: VINS's pose, whose PlusJacobian claims to be [I; 0], or a product of R³ and a
// rotation move as PoseManifold does.
//
// Compared are derivatives at zero, by central differences along each coordinate: the difference of
// the two ends is 2 kStep times ∂(x ⊞ δ)/∂δ, and its own error is the same for two manifolds that
// agree to third order. One point is enough, for it is no special one; a manifold made to differ
// elsewhere would get past it.

namespace {

// For central differences: their own error is some step² ~ 1e-8, rounding 1e-12; spaces that differ
// do so by a tenth and more.
constexpr double kStep = 1e-4;
constexpr double kTolerance = 1e-6;

// The built-in manifold of a space, which is what others are held against; null of kAny, and of
// kEuclidean, whose manifold has any size.
const Manifold* ManifoldOf(SlotSpace space) {
  // In the order of the enumeration. Never destroyed, for solves may run while the process ends.
  static const Manifold* const kManifolds[] = {nullptr, nullptr, new PoseManifold,
                                               new LeftPoseManifold, new SimilarityManifold};
  return kManifolds[static_cast<std::size_t>(space)];
}

// No coordinate is 0 or that of another; a quaternion has length 1, and a scale is positive. Poses
// and similarities have a position of three values and then the quaternion; the scale comes last.
std::vector<double> PointIn(SlotSpace space, int size) {
  std::vector<double> x(static_cast<std::size_t>(size));
  for (std::size_t k = 0; k < x.size(); ++k) {
    x[k] = 0.3 + std::sin(1.0 + static_cast<double>(k));
  }
  if (space != SlotSpace::kEuclidean) {
    const double norm = std::sqrt(x[3] * x[3] + x[4] * x[4] + x[5] * x[5] + x[6] * x[6]);
    std::for_each(x.begin() + 3, x.begin() + 7, [norm](double& entry) { entry /= norm; });
  }
  return x;
}

// Where x comes to by ±kStep along one coordinate of the tangent space: their difference. False
// where Plus fails at either end; δ is zero again afterwards.
bool Move(const Manifold& manifold, const std::vector<double>& x, std::vector<double>* delta,
          std::size_t column, std::vector<double>* moved) {
  std::vector<double> back(x.size());
  moved->resize(x.size());
  (*delta)[column] = kStep;
  const bool ahead = manifold.Plus(x.data(), delta->data(), moved->data());
  (*delta)[column] = -kStep;
  const bool done = manifold.Plus(x.data(), delta->data(), back.data()) && ahead;
  (*delta)[column] = 0.0;
  std::transform(moved->begin(), moved->end(), back.begin(), moved->begin(), std::minus<>());
  return done;
}

}  // namespace

// Sizes first, in the space and in the tangent: a manifold that holds coordinates has fewer. A
// tolerance of 10⁻⁶ of the derivative is far above the errors of the differences and far below what
// tells two conventions apart.
bool MovesIn(SlotSpace space, const Manifold& manifold) {
  if (space == SlotSpace::kAny) {
    return true;
  }
  const EuclideanManifold euclidean(manifold.AmbientSize());
  const Manifold* const built_in = ManifoldOf(space);
  const Manifold& wanted = built_in != nullptr ? *built_in : euclidean;
  // The exact class: one that is derived from a built-in may have another Plus, and is compared.
  if (typeid(manifold) == typeid(wanted)) {
    return true;
  }
  if (manifold.AmbientSize() != wanted.AmbientSize() ||
      manifold.TangentSize() != wanted.TangentSize()) {
    return false;
  }
  const std::vector<double> x = PointIn(space, manifold.AmbientSize());
  std::vector<double> delta(static_cast<std::size_t>(manifold.TangentSize()), 0.0);
  std::vector<double> given, known;
  for (std::size_t column = 0; column < delta.size(); ++column) {
    if (!Move(manifold, x, &delta, column, &given) || !Move(wanted, x, &delta, column, &known)) {
      return false;
    }
    for (std::size_t k = 0; k < x.size(); ++k) {
      // Negated, so that NaN fails.
      if (!(std::abs(given[k] - known[k]) <= kTolerance * 2.0 * kStep)) {
        return false;
      }
    }
  }
  return true;
}

bool CouldMoveInSlot(const FactorGraph& graph, VariableId id, const FactorFamily& family,
                     int slot) {
  const Manifold* const manifold = graph.manifold(id);
  return graph.TangentSize(id) == family.slot(slot).tangent_size &&
         (manifold == nullptr || MovesIn(family.Space(slot), *manifold));
}

const char* NameOf(SlotSpace space) {
  switch (space) {
    case SlotSpace::kEuclidean:
      return "values in Rⁿ, which need no manifold";
    case SlotSpace::kPose:
      return "a pose on PoseManifold";
    case SlotSpace::kLeftPose:
      return "a pose on LeftPoseManifold";
    case SlotSpace::kSimilarity:
      return "a similarity on SimilarityManifold";
    case SlotSpace::kAny:
      break;
  }
  return "anything";
}

}  // namespace inceres::internal
