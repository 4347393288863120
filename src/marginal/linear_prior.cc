#include <algorithm>
#include <cassert>
#include <cmath>

#include "inceres/solver/marginalization.h"

namespace inceres {

// The factor e(x) = e₀ + J δ with δ = (x ⊟ x₀) block by block (docs/algorithms.md,
// "Marginalization"; Leutenegger et al. 2015, section 3.5). J is frozen: it is copied as the
// tangent Jacobian at every x, so that JᵀJ, the information that the marginalized factors had, is
// the same in all iterations (HasConstantJacobian). A family has priors of one shape, of which each
// has its own x₀, J and e₀.

namespace {

std::vector<FactorFamily::Slot> SlotsOf(const LinearPrior& prior) {
  std::vector<FactorFamily::Slot> slots;
  slots.reserve(prior.blocks.size());
  for (const LinearPrior::Block& block : prior.blocks) {
    // The Jacobian that slots speak of is the tangent one: the prior knows its manifolds by itself.
    slots.push_back({static_cast<int>(block.x0.size()), block.tangent_size});
  }
  return slots;
}

// x ⊟ x₀ in the tangent space at x₀, where J was made: e is linear in this and in nothing else.
bool Subtract(const LinearPrior::Block& block, const double* x, double* delta) {
  if (block.manifold != nullptr) {
    // It may be undefined, as between opposite points of a sphere.
    return block.manifold->Minus(x, block.x0.data(), delta);
  }
  std::transform(x, x + block.x0.size(), block.x0.begin(), delta,
                 [](double a, double b) { return a - b; });
  return true;
}

}  // namespace

// Of J, all blocks side by side.
int LinearPrior::num_columns() const {
  int columns = 0;
  for (const Block& block : blocks) {
    columns += block.tangent_size;
  }
  return columns;
}

// Of the prior only its sizes are taken; others of the same shape share the family.
LinearPriorFamily::LinearPriorFamily(const LinearPrior& shape)
    : FactorFamily(static_cast<int>(shape.e0.size()), SlotsOf(shape)),
      num_columns_(shape.num_columns()) {
}

// Equal sizes block by block; which manifolds they are on may differ, for a prior brings its own.
bool LinearPriorFamily::Fits(const LinearPrior& prior) const {
  const std::vector<Slot> slots = SlotsOf(prior);
  bool fits = static_cast<int>(slots.size()) == num_slots() &&
              static_cast<int>(prior.e0.size()) == residual_size();
  for (int s = 0; fits && s < num_slots(); ++s) {
    const Slot& other = slots[static_cast<std::size_t>(s)];
    fits = slot(s).ambient_size == other.ambient_size && slot(s).tangent_size == other.tangent_size;
  }
  return fits;
}

void LinearPriorFamily::Place(int index, const LinearPrior& prior) {
  assert(Fits(prior) && prior.J.size() == prior.e0.size() * static_cast<std::size_t>(num_columns_));
  PlaceIn(&priors_, index, prior);
}

EvaluationFailure LinearPriorFamily::Evaluate(const FactorBatch& batch) const {
  // Evaluate may run on several threads at once, so δ is on the stack of each, and nothing is
  // allocated for priors of usual size.
  constexpr int kInline = 256;
  double stack[kInline];
  std::vector<double> heap(num_columns_ > kInline ? static_cast<std::size_t>(num_columns_) : 0);
  EvaluationFailure failure;
  for (int i = batch.begin; i < batch.end && !failure.failed(); ++i) {
    failure = EvaluateOne(i, batch, heap.empty() ? stack : heap.data());
  }
  return failure;
}

// Cost: rows times columns, as a product with J. The tangent Jacobian of e is J ∂(x ⊟ x₀)/∂x, and J
// is taken for it at every x: exact at x₀, and for Euclidean blocks everywhere; beyond that it is
// what keeps the information that the prior has frozen.
EvaluationFailure LinearPriorFamily::EvaluateOne(int i, const FactorBatch& batch,
                                                 double* delta) const {
  const LinearPrior& prior = priors_[static_cast<std::size_t>(i)];
  const double* const* parameters = batch.parameters + static_cast<std::ptrdiff_t>(i) * num_slots();
  double* next = delta;
  for (int s = 0; s < num_slots(); ++s) {
    // δ of all variables one behind the other, as J has its columns.
    if (!Subtract(prior.blocks[static_cast<std::size_t>(s)], parameters[s], next)) {
      return {i,
              "a variable is too far from where the prior was linearized for their difference to "
              "be defined"};
    }
    next += slot(s).tangent_size;
  }
  double* e = batch.residuals + static_cast<std::ptrdiff_t>(i) * residual_size();
  // One test for the whole residual: a sum with an entry that is not finite is not finite either.
  double sum = 0.0;
  const double* J = prior.J.data();
  for (std::size_t r = 0; r < prior.e0.size(); ++r, J += num_columns_) {
    double J_delta = 0.0;
    for (int c = 0; c < num_columns_; ++c) {
      J_delta += J[c] * delta[c];
    }
    e[r] = prior.e0[r] + J_delta;
    sum += e[r];
  }
  if (!std::isfinite(sum)) {
    return {i, "a residual is not finite"};
  }
  // From here on J moves from block to block: each slot takes its columns of every row.
  J = prior.J.data();
  for (int s = 0; batch.jacobians != nullptr && s < num_slots(); J += slot(s++).tangent_size) {
    // A constant, or a slot whose Jacobian nobody wants.
    if (!batch.tangent_maps[static_cast<std::ptrdiff_t>(i) * num_slots() + s]->wanted()) {
      continue;
    }
    const JacobianView& view = batch.jacobians[s];
    for (int r = 0; r < residual_size(); ++r) {
      std::copy_n(
          J + static_cast<std::ptrdiff_t>(r) * num_columns_, slot(s).tangent_size,
          view.data + i * view.factor_stride + static_cast<std::ptrdiff_t>(r) * view.row_stride);
    }
  }
  return {};
}

const LinearPrior* FindLinearPrior(const FactorGraph& graph, FactorId factor) {
  if (!graph.HasFactor(factor.family, factor.index)) {
    return nullptr;
  }
  // A user's family may be derived from LinearPriorFamily, and counts.
  const auto* family = dynamic_cast<const LinearPriorFamily*>(&graph.family(factor.family));
  return family == nullptr ? nullptr : &family->prior(factor.index);
}

}  // namespace inceres
