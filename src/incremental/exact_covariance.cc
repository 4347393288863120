#include "incremental/exact_covariance.h"

#include <algorithm>
#include <string>

#include "problem/find_fault.h"

namespace inceres::internal {
namespace {

// Covariances at the values of now (docs/algorithms.md, "From a live factor"): H x = e by
// conjugate gradients (Hestenes & Stiefel 1952) with M = H + Λ as it was linearized, eliminated
// and factored earlier. Where the values have not moved since, M⁻¹H is the identity but for the
// damping, and a few iterations do. H is never formed; a product is a pass over the Jacobians.
//
// The layout of the evaluator has no landmarks, so it counts quads in an order of its own; all
// vectors here are laid out as the system's padded ones, and quad_of_ translates. Padding stays
// zero: no Jacobian and no substitution writes there.

// A direction in which H has less than this share of the damped system's curvature is open: at a
// damping of 1e-8 its variance would be 1e12 times what it is with all else known.
constexpr double kOpen = 1e-4;

// The graph's layout of the values, with those that the system has now.
std::vector<double> StateOf(const FactorGraph& graph, const IncrementalSystem& system) {
  std::vector<double> state = graph.state();
  for (VariableId id = 0; id < graph.num_variables(); ++id) {
    if (graph.HasVariable(id) && graph.StateOffset(id) >= 0) {
      std::copy_n(system.variables().current(id), graph.AmbientSize(id),
                  state.begin() + graph.StateOffset(id));
    }
  }
  return state;
}

}  // namespace

// The evaluator has its own points and Jacobians: the system's cached ones, on which steps rest,
// stay as they are.
ExactCovariance::ExactCovariance(const FactorGraph& graph, const IncrementalSystem& system,
                                 const LiveFactor& factor)
    : graph_(graph),
      system_(system),
      factor_(factor),
      layout_(graph, /*eliminate_landmarks=*/false),
      evaluator_(graph, layout_, system.executor()) {
  evaluator_.points().SetCurrent(StateOf(graph, system));
  // Both layouts pad each variable to the same number of quads, so that one shift a variable does.
  quad_of_.resize(layout_.quad_offset.back());
  for (std::size_t k = 0; k < layout_.variables.size(); ++k) {
    for (std::int32_t q = layout_.quad_offset[k]; q < layout_.quad_offset[k + 1]; ++q) {
      quad_of_[q] = system.variables().quad(layout_.variables[k]) + q - layout_.quad_offset[k];
    }
  }
}

// No candidate was evaluated here, so the tangent maps of this point are not known yet.
Status ExactCovariance::Linearize() {
  double cost = 0.0;
  return evaluator_.EvaluateJacobians(/*known_point=*/false, &cost);
}

// Σ Jᵀ J v over the factors, by the system's quads.
// Two passes over a factor's entries, J v and then Jᵀ(J v), with J as projected and corrected for
// its loss.
ExactCovariance::Vector ExactCovariance::Product(const Vector& v) const {
  Vector product = Vector::Zero(v.size());
  std::vector<double> J_v;
  for (const Linearization& family : evaluator_.families()) {
    J_v.resize(family.residual_size);
    for (int i = 0; i < family.num_factors; ++i) {
      // A pass over the slots' blocks, visit(row, entry, its place in the system's vectors): J v
      // and Jᵀ u are two of these, with the same addressing.
      const auto for_each_entry = [&](const auto& visit) {
        for (int s = 0; s < family.num_slots; ++s) {
          const std::int32_t quad = family.tangent_offsets[family.Entry(i) + s];
          // A constant has no quad.
          if (quad < 0) {
            continue;
          }
          const SlotJacobians& slot = family.slots[s];
          const double* J = slot.data + std::ptrdiff_t{i} * slot.factor_stride;
          const std::ptrdiff_t first = std::ptrdiff_t{quad_of_[quad]} * kQuad;
          for (int r = 0; r < family.residual_size; ++r, J += slot.row_stride) {
            for (int c = 0; c < slot.columns; ++c) {
              visit(r, J[c], first + c);
            }
          }
        }
      };
      std::fill(J_v.begin(), J_v.end(), 0.0);
      for_each_entry([&](int r, double J, std::ptrdiff_t at) { J_v[r] += J * v[at]; });
      for_each_entry([&](int r, double J, std::ptrdiff_t at) { product[at] += J * J_v[r]; });
    }
  }
  return product;
}

// Preconditioned conjugate gradients from x = 0. On return r = e − H x by its recurrence, which
// the caller uses.
Status ExactCovariance::Solve(double tolerance, int max_iterations, Vector* r, Vector* x) {
  Vector z = Vector::Zero(r->size());
  Status status = SolveDamped(system_, factor_, r->data(), z.data());
  Vector p = z;
  double rz = r->dot(z), energy = 0.0;
  x->setZero(r->size());
  // Each iteration adds α rᵀz to xᵀHx, so `energy` is xᵀHx so far, and rᵀM⁻¹r is about the squared
  // error in the norm of the energy. Their ratio does not depend on the units of the variables.
  for (int i = 0; status.ok() && rz > tolerance * energy; ++i) {
    // Not converged is no answer here: a variance too small would pass for a certain one.
    if (i == max_iterations) {
      return Status::Error(StatusCode::kUnavailable,
                           "conjugate gradients have not converged after " + std::to_string(i) +
                               " iterations: next to nothing holds the variable, or the factor is "
                               "too old (Update first)");
    }
    const Vector H_p = Product(p);
    const double curvature = p.dot(H_p);
    // pᵀHp against rᵀz, which is zᵀMz with z = M⁻¹r: the share of the damped curvature that H has
    // there. The negation refuses NaN, too.
    if (!(curvature > kOpen * rz)) {
      return Status::Error(StatusCode::kSingular,
                           "the gauge is free, or the variable is not determined by its factors");
    }
    const double alpha = rz / curvature;
    *x += alpha * p;
    *r -= alpha * H_p;
    energy += alpha * rz;
    ++num_iterations_;
    z.setZero();
    status = SolveDamped(system_, factor_, r->data(), z.data());
    const double next = r->dot(z);
    // The direction of steepest descent in the norm of M, made conjugate to the ones before.
    p = z + next / rz * p;
    rz = next;
  }
  // A comparison with NaN has ended the loop: the factor or the right-hand side is not finite.
  return status.ok() && !(rz <= tolerance * energy)
             ? Status::Error(StatusCode::kUnavailable, "the factor has values that are not finite")
             : status;
}

Status ExactCovariance::Compute(const std::vector<VariableId>& ids, double tolerance,
                                int max_iterations, Eigen::MatrixXd* joint) {
  std::vector<std::ptrdiff_t> places;
  // Each scalar has its place in the padded vectors, and a variable to be named if it is
  // undetermined.
  std::vector<VariableId> owners;
  for (const VariableId id : ids) {
    for (int k = 0; k < graph_.TangentSize(id); ++k) {
      owners.push_back(id);
      places.push_back(std::ptrdiff_t{system_.variables().quad(id)} * kQuad + k);
    }
  }
  const auto size = static_cast<Eigen::Index>(places.size());
  const std::ptrdiff_t num_entries = std::ptrdiff_t{system_.variables().num_quads()} * kQuad;
  Eigen::MatrixXd X(num_entries, size), R(num_entries, size);
  // One solve for each scalar of the requested variables.
  for (Eigen::Index c = 0; c < size; ++c) {
    Vector r = Vector::Zero(num_entries), x;
    r[places[c]] = 1.0;
    Status solved = Solve(tolerance, max_iterations, &r, &x);
    if (!solved.ok()) {
      solved.message.insert(
          0, VariableName(owners[static_cast<std::size_t>(c)]) + " has no covariance: ");
      return solved;
    }
    X.col(c) = x;
    R.col(c) = r;
  }
  // Σ_ij = x_iᵀe_j, corrected by x_iᵀr_j: the first-order error of x_j cancels, and what is left
  // is the product of the errors of x_i and x_j.
  *joint = X.transpose() * R;
  for (Eigen::Index i = 0; i < size; ++i) {
    joint->row(i) += X.row(places[i]);
  }
  // X and R have errors of their own, so that it is symmetric up to the tolerance only.
  *joint = (0.5 * (*joint + joint->transpose())).eval();
  return Status::Ok();
}

}  // namespace inceres::internal
